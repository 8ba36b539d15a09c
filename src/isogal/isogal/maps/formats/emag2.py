"""EMAG2, the magnetic anomaly of the Earth on a grid of two minutes of arc (Meyer, Saltus &
Chulliat 2017, doi:10.7289/V5H70CVX), as GeoTIFF or CSV whose names begin with ``EMAG2``.

The CSV file has the columns i, j, longitude, latitude, anomaly at sea level, anomaly continued to
4 km, code of the source, error; nT, 99999 where there is none. The whole Earth has 58 million
rows, of which only those of a window are kept."""

from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Asked, FileGrid, Format
from isogal.maps.formats.geotiff import open_raster
from isogal.maps.formats.points import drop_gaps, grid_of_points, numbers

_TIFF = (".tif", ".tiff")
_COLUMNS, _LONGITUDE, _LATITUDE, _ERROR = 8, 2, 3, 7
_SURFACES = {"sealevel": (4, 0.0), "upcont": (5, 4000.0)}
"""Column of the anomaly, and height, m."""
_GAP = 99999.0
_TOGETHER = 500_000
"""Rows that are read at once."""
_RIM = 0.15
"""Around a window, deg: four nodes, of which interpolation needs three."""


def _matches(path: Path) -> bool:
    name = path.name.casefold()
    return name.startswith("emag2") and path.suffix.casefold() in (".csv", *_TIFF)


def _read(path: Path, asked: Asked, window: Window | None) -> FieldMap:
    """Read the surface that is asked for, that of the file's name, or the one at sea level."""
    if path.suffix.casefold() in _TIFF:
        with open_raster(path, asked) as grid:
            height = _SURFACES[_surface(path, None)][1]
            known = replace(grid, quantity="magnetic_anomaly", unit="nT", height=height)
            return known.load(asked, window)
    surface = _surface(path, asked.variable)
    column, height = _SURFACES[surface]
    where = f"{path}:{surface}"
    table = _rows(path, window, where)
    latitude, longitude, values, error = grid_of_points(
        table[:, _LATITUDE],
        table[:, _LONGITUDE],
        *(drop_gaps(table[:, k], _GAP) for k in (column, _ERROR)),
        where=where,
    )
    return FileGrid(
        where=where,
        latitude=latitude,
        longitude=longitude,
        values=values,
        unit="nT",
        quantity="magnetic_anomaly",
        sigma=error if np.isfinite(error[np.isfinite(values)]).all() else 0.0,
        height=height,
    ).load(asked, window)


def _surface(path: Path, asked: str | None) -> str:
    """Return which surface is meant."""
    if asked is None:
        return "upcont" if "upcont" in path.name.casefold() else "sealevel"
    if asked.casefold() not in _SURFACES:
        raise InputError(f"{path}: has no variable '{asked}'; it has {', '.join(_SURFACES)}")
    return asked.casefold()


def _rows(path: Path, window: Window | None, where: str) -> Array:
    """Return the rows (N, 8) of a window."""
    kept: list[Array] = []
    with reading(path), path.open(encoding="ascii", errors="replace") as file:
        while lines := list(islice(file, _TOGETHER)):
            table = numbers(lines, _COLUMNS, where, ",")
            kept.append(table if window is None else _within(table, window))
    if not any(map(len, kept)):
        raise InputError(f"{where}: has no rows in {window.text() if window else 'it'}")
    return np.concatenate(kept)


def _within(table: Array, window: Window) -> Array:
    """Return the rows in a window or near it, their longitudes without a jump."""
    south, north, west, east = np.degrees(window[:4])
    turned = np.remainder(table[:, _LONGITUDE] - (west - _RIM), 360.0)
    latitude = table[:, _LATITUDE]
    inside = (latitude > south - _RIM) & (latitude < north + _RIM)
    inside &= turned < (east - west) % 360.0 + 2.0 * _RIM
    found = table[inside]
    found[:, _LONGITUDE] = west - _RIM + turned[inside]
    return np.asarray(found)


FORMAT = Format("emag2", _matches, _read)
