"""Make map.nc and track.csv of this example, beside this file: part of Isogal's synthetic map, a
straight flight over it, and an inertial navigator that is 540 m off and does not know it."""

import argparse
import csv
from pathlib import Path

import numpy as np

from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.axes import Window
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.synthetic.synthetic_map import synthetic_map
from isogal.seeds import generator

HERE = Path(__file__).resolve().parent
READINGS, INTERVAL = 60, 20.0
NORTH, EAST = 300.0, -450.0
"""m, error of the navigator."""
SIGMA = 0.5
"""mGal, of a reading."""


def main() -> None:
    """Write map.nc and track.csv beside this file."""
    window = Window(*np.radians([-36.75, -36.35, 146.85, 147.45]))
    field_map = synthetic_map("disturbance", window).thinned(2, 2)
    write_netcdf(field_map, HERE / "map.nc")
    share = np.linspace(0.0, 1.0, READINGS)
    latitude = np.radians(-36.65 + 0.2 * share)
    longitude = np.radians(146.95 + 0.4 * share)
    north, east = metres_per_radian(latitude)
    noise = SIGMA * generator(0, 0, "example track").standard_normal(READINGS)
    value = field_map.value(latitude, longitude) / 1e-5 + noise
    with (HERE / "track.csv").open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["time", "latitude", "longitude", "value"])
        for k in range(READINGS):
            rows.writerow(
                [
                    f"{k * INTERVAL:g}",
                    f"{np.degrees(latitude[k] + NORTH / north[k]):.6f}",
                    f"{np.degrees(longitude[k] + EAST / east[k]):.6f}",
                    f"{value[k]:.3f}",
                ]
            )
    print(f"true place of the last reading: {np.degrees(latitude[-1]):.5f}, "
          f"{np.degrees(longitude[-1]):.5f}")  # fmt: skip


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
