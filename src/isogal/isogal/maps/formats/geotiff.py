"""GeoTIFF maps, in any coordinate reference system.

A grid in a projected, rotated or shifted system is resampled to latitude and longitude by cubic
convolution."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from isogal.arrays import Array, Values
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.formats.format import Asked, FileGrid, file_format
from isogal.maps.quantities import quantity_of

if TYPE_CHECKING:
    from rasterio.crs import CRS
    from rasterio.io import DatasetReader

SHIFT_DEG = 5e-5
"""A geographic system within this (5 m) of WGS 84 is taken as it is; others are transformed."""


@contextmanager
def open_raster(path: Path, asked: Asked, kind: str = "GeoTIFF") -> Iterator[FileGrid]:
    """Open a file of a kind that GDAL reads, and find the band that is asked for by its number or
    description, else the only one."""
    import rasterio

    where = str(path)
    if not path.is_file():
        raise InputError(f"{where}: no such file")
    with (
        reading(path, kind),
        rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR", GDAL_PAM_ENABLED="NO"),
        rasterio.open(path) as source,
    ):
        band = _band(source, asked.variable, where)
        numeric = np.dtype(source.dtypes[band - 1]).kind
        if numeric not in "iuf":
            raise InputError(f"{where}: band {band} holds {source.dtypes[band - 1]}, not numbers")
        named = (source.descriptions[band - 1], asked.variable)
        by_name = (quantity_of(text) for text in named if text)
        scale, offset = source.scales[band - 1], source.offsets[band - 1]
        with _geographic(source, _system(source, asked.crs, where), where) as (grid, origin):
            turn, north, east = grid.transform, np.arange(grid.height), np.arange(grid.width)
            south, west = turn.f + turn.e * (grid.height - 0.5), turn.c + turn.a * 0.5
            yield FileGrid(
                where=origin,
                latitude=math.radians(south) + math.radians(-turn.e) * north,
                longitude=math.radians(west) + math.radians(turn.a) * east,
                values=partial(_values, grid, band, scale, offset),
                unit=source.units[band - 1] or None,
                quantity=next((found for found in by_name if found), None),
                quantisation=abs(scale) if numeric in "iu" else 0.0,
            )


def _system(source: "DatasetReader", crs: str | None, where: str) -> "CRS":
    """Return the coordinate reference system, that of the user before that of the file."""
    import rasterio

    if crs is not None:
        try:
            return rasterio.crs.CRS.from_string(crs)
        except rasterio.errors.CRSError:
            raise InputError(f"{where}: crs '{crs}' is not known; give it as EPSG:4326") from None
    if not (source.crs and (source.crs.is_geographic or source.crs.is_projected)):
        raise InputError(
            f"{where}: does not say its coordinate reference system; give crs= (--crs of 'isogal"
            " map convert'), for example EPSG:4326"
        )
    return source.crs


@contextmanager
def _geographic(
    source: "DatasetReader", system: "CRS", where: str
) -> Iterator[tuple["DatasetReader", str]]:
    """Give a file as it is, or resampled where it is no grid of latitude and longitude; and where
    its values are from."""
    import rasterio
    from rasterio.vrt import WarpedVRT

    turn = source.transform
    plain = turn.b == turn.d == 0.0 and turn.a > 0.0 and turn.e < 0.0
    if plain and _is_plain_geographic(system, source):
        yield source, where
        return
    with WarpedVRT(
        source,
        src_crs=system,
        crs="EPSG:4326",
        resampling=rasterio.enums.Resampling.cubic,
        nodata=math.nan,
        dtype="float64",
        tolerance=1e-3,  # cells by which places may be wrong; 20 % slower than with the usual 1/8
    ) as warped:
        if warped.height < 2:
            raise InputError(
                f"{where}: holds a pole or crosses longitude 180; resample it to latitude and"
                " longitude first (gdalwarp)"
            )
        yield warped, f"{where} (from {system.to_string()[:60]})"


def _band(source: "DatasetReader", variable: str | None, where: str) -> int:
    """Return the number of the band that is asked for, from 1."""
    named = [k for k, text in enumerate(source.descriptions, 1) if variable in (text, str(k))]
    only = source.count == 1 and source.descriptions[0] is None
    if (source.count == 1 and variable is None) or (only and quantity_of(variable or "")):
        return 1
    if variable is not None and named:
        return named[0]
    raise InputError(
        f"{where}: has no band '{variable or '(none asked for)'}' but {source.count} bands"
        f" ({source.descriptions}); give variable= (--variable, map.variable) a number or"
        " description"
    )


def _is_plain_geographic(system: "CRS", source: "DatasetReader") -> bool:
    """Tell whether the grid's coordinates are longitude and latitude on WGS 84, or nearly so."""
    import pyproj

    if not system.is_geographic:
        return False
    bounds = source.bounds
    middle = 0.5 * (bounds.left + bounds.right), 0.5 * (bounds.top + bounds.bottom)
    to_wgs84 = pyproj.Transformer.from_crs(
        pyproj.CRS.from_wkt(system.to_wkt()), "EPSG:4326", always_xy=True
    )
    there = to_wgs84.transform(*middle)
    return all(
        abs((b - a + 180.0) % 360.0 - 180.0) < SHIFT_DEG
        for a, b in zip(middle, there, strict=True)
    )


def _values(
    source: "DatasetReader", band: int, scale: float, offset: float, rows: slice, columns: slice
) -> Values:
    """Return some values of a band, whose numbers have a scale and an offset; rows are counted
    from the south, columns from the west."""
    from rasterio.windows import Window

    down = source.height - rows.stop, source.height - rows.start
    cut = Window.from_slices(down, (columns.start, columns.stop))
    raw = source.read(band, window=cut, masked=True)
    values: Array = raw.data.astype(np.float64)
    values *= scale
    values += offset
    values[np.ma.getmaskarray(raw) | ~np.isfinite(values)] = np.nan
    return values[::-1]


FORMAT = file_format("geotiff", (".tif", ".tiff", ".gtiff"), open_raster, crs=True)
