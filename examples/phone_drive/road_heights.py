"""Make a map of how high roads are of one of the terrain, and say how far they may be off it.

    isogal-python examples/phone_drive/road_heights.py TERRAIN ROADS

TERRAIN is a file that Isogal reads as heights (NetCDF, GeoTIFF, ...), ROADS a NetCDF file. Roads
run in cuttings and on embankments, and nodes far apart say little of what lies between them: a
road is smoother than the terrain at the nodes, and may be off it by more where heights differ
between neighbouring nodes."""

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter, uniform_filter

from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map

LEAST, SHARE, MOST = 5.0, 0.6, 12.0
"""m, share of the relief, m: what a road is off a map of 30 arcsec by where it is flat, where it
is not, and at most."""
SMOOTH = 0.5
"""Cells, 1-sigma of the Gaussian that makes roads of terrain (docs/evidence/drives.md)."""


def with_sigma(terrain: FieldMap) -> FieldMap:
    """Return a map of roads that says its error: a share of the relief between a node and its
    neighbours, and what is left where there is none."""
    terrain_heights = np.asarray(terrain.values, dtype=float)
    known = np.isfinite(terrain_heights)

    def mean(values: np.ndarray, smoother: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Return local means of what is known."""
        share = smoother(known.astype(float))
        total = smoother(np.where(known, values, 0.0))
        return np.where(known, total / np.where(known, share, 1.0), np.nan)

    heights = mean(terrain_heights, lambda one: gaussian_filter(one, SMOOTH, mode="nearest"))
    near, square = (
        mean(one, lambda part: uniform_filter(part, 3)) for one in (heights, heights**2)
    )
    relief = np.sqrt(np.maximum(square - near**2, 0.0))
    sigma = np.hypot(LEAST, np.minimum(SHARE * relief, MOST))
    return replace(terrain, values=heights, sigma=sigma, error_stated=True)


def main() -> None:
    """Convert one map."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("terrain", type=Path, metavar="TERRAIN")
    parser.add_argument("roads", type=Path, metavar="ROADS")
    arguments = parser.parse_args()
    try:
        write_netcdf(with_sigma(load_map(arguments.terrain, "height")), arguments.roads)
    except InputError as error:
        sys.exit(f"road_heights.py: {error}")


if __name__ == "__main__":
    main()
