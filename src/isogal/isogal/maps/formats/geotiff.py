"""GeoTIFF maps, in any coordinate reference system."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.assemble import assemble, check_size
from isogal.maps.axes import RegularAxis, Window, part_within
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Format, by_suffix
from isogal.maps.quantities import quantity_of

SHIFT_DEG = 5e-5
"""A geographic system within this (5 m) of WGS 84 is taken as it is; others are transformed."""


def read_geotiff(
    path: str | Path,
    variable: str | None = None,
    window: Window | None = None,
    *,
    quantity: str | None = None,
    unit: str | None = None,
    crs: str | None = None,
) -> FieldMap:
    """Read one band of a GeoTIFF as a map.

    A grid in a projected, rotated or shifted system is resampled to latitude and longitude by
    cubic convolution.

    Parameters
    ----------
    path : path
        File.
    variable : str, optional
        Number or description of the band; None = the only one.
    window : Window, optional
        Only this part is read.
    quantity, unit, crs : str, optional
        What the file does not say; ``crs`` as ``EPSG:28355``.

    Raises
    ------
    InputError
        Not a GeoTIFF, no such band, CRS, unit or quantity not said, impossible numbers, broken
        data.
    """
    import rasterio

    where = str(path)
    if not Path(path).is_file():
        raise InputError(f"{where}: no such file")
    with (
        reading(path, "GeoTIFF"),
        rasterio.Env(GDAL_DISABLE_READDIR_ON_OPEN="EMPTY_DIR", GDAL_PAM_ENABLED="NO"),
        rasterio.open(path) as source,
    ):
        band = _band(source, variable, where)
        kind = np.dtype(source.dtypes[band - 1]).kind
        if kind not in "iuf":
            raise InputError(f"{where}: band {band} holds {source.dtypes[band - 1]}, not numbers")
        named = (source.descriptions[band - 1], variable)
        by_name = (quantity_of(text) for text in named if text)
        scale, offset = source.scales[band - 1], source.offsets[band - 1]
        with _geographic(source, _system(source, crs, where), where) as (grid, origin):
            latitude, longitude, values = _part(grid, band, window, (scale, offset), origin)
        return assemble(
            latitude,
            longitude,
            values,
            unit=unit or source.units[band - 1] or None,
            quantity=quantity or next((found for found in by_name if found), None),
            where=origin,
            quantisation=abs(scale) if kind in "iu" else 0.0,
        )


def _system(source: Any, crs: str | None, where: str) -> Any:
    """Return the coordinate reference system, that of the user before that of the file."""
    import rasterio

    if crs is not None:
        try:
            return rasterio.crs.CRS.from_string(crs)
        except rasterio.errors.CRSError:
            raise InputError(f"{where}: crs '{crs}' is not known; give it as EPSG:4326") from None
    if not source.crs:
        raise InputError(
            f"{where}: does not say its coordinate reference system; give crs= (--crs of 'isogal"
            " map convert'), for example EPSG:4326"
        )
    return source.crs


@contextmanager
def _geographic(source: Any, system: Any, where: str) -> Iterator[tuple[Any, str]]:
    """Give a file as it is, or resampled where it is no grid of latitude and longitude; and where
    its values are from."""
    import rasterio
    from rasterio.vrt import WarpedVRT

    turn = source.transform
    plain = turn.b == turn.d == 0.0 and turn.a > 0.0 and turn.e < 0.0
    if plain and _is_plain_geographic(system, source, where):
        yield source, where
        return
    with WarpedVRT(
        source,
        src_crs=system,
        crs="EPSG:4326",
        resampling=rasterio.enums.Resampling.cubic,
        nodata=math.nan,
        dtype="float64",
    ) as warped:
        yield warped, f"{where} (from {system.to_string()[:60]})"


def _band(source: Any, variable: str | None, where: str) -> int:
    if variable is None:
        if source.count != 1:
            raise InputError(
                f"{where}: has {source.count} bands ({source.descriptions}); give variable="
                " (--variable) a number or description"
            )
        return 1
    if variable.isdecimal() and 1 <= int(variable) <= source.count:
        return int(variable)
    if variable in source.descriptions:
        return int(source.descriptions.index(variable)) + 1
    if source.count == 1 and source.descriptions[0] is None and quantity_of(variable):
        return 1
    raise InputError(
        f"{where}: has no band '{variable}'; bands 1 to {source.count}: {source.descriptions}"
    )


def _is_plain_geographic(system: Any, source: Any, where: str) -> bool:
    """Tell whether the grid's coordinates are longitude and latitude on WGS 84, or nearly so."""
    import pyproj

    if not system.is_geographic:
        return False
    bounds = source.bounds
    if bounds.top > 90.0 + 1e-6 or bounds.bottom < -90.0 - 1e-6:
        raise InputError(
            f"{where}: latitudes {bounds.bottom:.6g} to {bounds.top:.6g} deg; axes swapped, or a"
            " projected CRS?"
        )
    middle = 0.5 * (bounds.left + bounds.right), 0.5 * (bounds.top + bounds.bottom)
    to_wgs84 = pyproj.Transformer.from_crs(
        pyproj.CRS.from_wkt(system.to_wkt()), "EPSG:4326", always_xy=True
    )
    there = to_wgs84.transform(*middle)
    return all(
        abs((b - a + 180.0) % 360.0 - 180.0) < SHIFT_DEG
        for a, b in zip(middle, there, strict=True)
    )


def _part(
    source: Any, band: int, window: Window | None, packing: tuple[float, float], where: str
) -> tuple[Array, Array, NDArray[Any]]:
    """Return latitude (n,) and longitude (m,), rad, and the band's values (n, m) in a window, by
    scale and offset of its numbers."""
    import rasterio.windows

    rows, turn = source.height, source.transform
    latitude = RegularAxis(
        math.radians(turn.f + turn.e * (rows - 0.5)), math.radians(-turn.e), rows
    )
    longitude = RegularAxis(
        math.radians(turn.c + turn.a * 0.5), math.radians(turn.a), source.width
    )
    part = part_within(latitude, longitude, window, where)
    check_size(math.prod(part.shape), where, window)
    up, down = part.rows, (rows - part.rows.stop, rows - part.rows.start)
    blocks = []
    for columns in part.columns:
        cut = rasterio.windows.Window.from_slices(down, (columns.start, columns.stop))
        blocks.append(_unpacked(source.read(band, window=cut, masked=True), *packing))
    return (
        latitude.first + latitude.step * np.arange(up.start, up.stop),
        part.longitude(longitude.step),
        np.concatenate(blocks, axis=1)[::-1],
    )


def _unpacked(raw: Any, scale: float, offset: float) -> NDArray[Any]:
    packed = scale != 1.0 or offset != 0.0
    values: NDArray[Any] = raw.data.astype(
        np.float32 if raw.dtype == np.float32 and not packed else np.float64
    )
    if packed:
        values = values * scale + offset
    values[np.ma.getmaskarray(raw) | ~np.isfinite(values)] = np.nan
    return values


FORMAT = Format("geotiff", by_suffix(".tif", ".tiff", ".gtiff"), read_geotiff, takes_crs=True)
