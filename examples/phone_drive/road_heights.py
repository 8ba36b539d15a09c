"""Say on a map of the terrain how far a road may be off it.

    isogal-python examples/phone_drive/road_heights.py TERRAIN ROADS

TERRAIN is a file that Isogal reads as heights (NetCDF, GeoTIFF, ...), ROADS a NetCDF file. Roads
run in cuttings and on embankments, and a map of coarse cells smooths what lies within one: both
are larger where heights differ between neighbouring cells."""

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter

from isogal.maps.field_map import FieldMap
from isogal.maps.formats.netcdf_writing import write_netcdf
from isogal.maps.load import load_map

LEAST, SHARE, MOST = 5.0, 0.6, 12.0
"""m, share of the relief, m: what a road is off a map of 30 arcsec by where it is flat, where it
is not, and at most."""


def with_sigma(terrain: FieldMap) -> FieldMap:
    """Return a map that says its error: a share of the relief between a node and its neighbours,
    and what is left where there is none."""
    heights = np.asarray(terrain.values, dtype=float)
    mean, square = uniform_filter(heights, 3), uniform_filter(heights**2, 3)
    relief = np.sqrt(np.maximum(square - mean**2, 0.0))
    sigma = np.hypot(LEAST, np.minimum(SHARE * relief, MOST))
    return replace(terrain, sigma=sigma, error_stated=True)


def main() -> None:
    """Convert one map."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("terrain", type=Path, metavar="TERRAIN")
    parser.add_argument("roads", type=Path, metavar="ROADS")
    arguments = parser.parse_args()
    write_netcdf(with_sigma(load_map(arguments.terrain, "height")), arguments.roads)


if __name__ == "__main__":
    main()
