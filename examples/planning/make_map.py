"""Make the map of this example: gravity disturbances that are rough, but for a smooth basin in the
middle, in which a navigator finds nothing to hold on to."""

import argparse
from pathlib import Path

import numpy as np

from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.seeds import generator

SOUTH_WEST, NORTH_EAST = (-37.3, 146.4), (-36.1, 148.2)
"""deg."""
STEP = 0.008
"""deg between nodes."""
BASIN, WIDTH = (-36.68, 147.3), 0.32
"""deg: its middle, and how far it reaches."""


def main(path: Path) -> None:
    """Write the map."""
    path.parent.mkdir(parents=True, exist_ok=True)
    latitude = np.arange(SOUTH_WEST[0], NORTH_EAST[0], STEP)
    longitude = np.arange(SOUTH_WEST[1], NORTH_EAST[1], STEP)
    north, east = latitude[:, None] * 111_000.0, longitude * 89_000.0
    random, values = generator(0, 0, "example_roughness"), 0.0 * (north + east)
    for _ in range(40):
        length = random.uniform(6000.0, 25_000.0)
        angle, phase = random.uniform(0.0, 2.0 * np.pi, 2)
        along = np.cos(angle) * north + np.sin(angle) * east
        values += 3e-9 * length * np.sin(2.0 * np.pi * along / length + phase)
    apart = ((latitude[:, None] - BASIN[0]) / 0.3) ** 2 + (longitude - BASIN[1]) ** 2
    values *= 1.0 - 0.97 * np.exp(-0.5 * (apart / WIDTH**2) ** 2)
    axes = np.radians(latitude), np.radians(longitude)
    write_netcdf(FieldMap(*axes, values, "m/s²", "disturbance"), path)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path, nargs="?", default=Path("map.nc"), help="map.nc")
    main(**vars(parser.parse_args()))
