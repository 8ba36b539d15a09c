"""GeoTIFF maps, in any coordinate reference system."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
        return _read(source, variable, window, (quantity, unit, crs), where)


def _read(
    source: Any,
    variable: str | None,
    window: Window | None,
    asked: tuple[str | None, str | None, str | None],
    where: str,
) -> FieldMap:
    import rasterio
    from rasterio.vrt import WarpedVRT

    quantity, unit, crs = asked
    band = _band(source, variable, where)
    if np.dtype(source.dtypes[band - 1]).kind not in "iuf":
        raise InputError(f"{where}: band {band} holds {source.dtypes[band - 1]}, not numbers")
    name = source.descriptions[band - 1]
    quantity = quantity or next(
        (q for q in (quantity_of(t) for t in (name, variable) if t) if q), None
    )
    unit = unit or source.units[band - 1] or None
    if crs is not None:
        try:
            system = rasterio.crs.CRS.from_string(crs)
        except rasterio.errors.CRSError:
            raise InputError(f"{where}: crs '{crs}' is not known; give it as EPSG:4326") from None
    else:
        system = source.crs
    if not system:
        raise InputError(
            f"{where}: does not say its coordinate reference system; give crs= (--crs of 'isogal"
            " map convert'), for example EPSG:4326"
        )
    scale, offset = source.scales[band - 1], source.offsets[band - 1]
    turn = source.transform
    plain = turn.b == turn.d == 0.0 and turn.a > 0.0 and turn.e < 0.0
    if plain and _is_plain_geographic(system, source, where):
        return _assemble(source, band, window, (quantity, unit, scale, offset), where)
    with WarpedVRT(
        source,
        src_crs=system,
        crs="EPSG:4326",
        resampling=rasterio.enums.Resampling.cubic,
        nodata=math.nan,
        dtype="float64",
    ) as warped:
        return _assemble(
            warped,
            band,
            window,
            (quantity, unit, scale, offset),
            f"{where} (from {system.to_string()[:60]})",
        )


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


def _assemble(
    source: Any,
    band: int,
    window: Window | None,
    meaning: tuple[str | None, str | None, float, float],
    where: str,
) -> FieldMap:
    import rasterio.windows

    quantity, unit, scale, offset = meaning
    rows, turn = source.height, source.transform
    latitude = RegularAxis(
        math.radians(turn.f + turn.e * (rows - 0.5)), math.radians(-turn.e), rows
    )
    longitude = RegularAxis(
        math.radians(turn.c + turn.a * 0.5), math.radians(turn.a), source.width
    )
    part = part_within(latitude, longitude, window, where)
    check_size(math.prod(part.shape), where, window)
    up, blocks = part.rows, []
    for columns in part.columns:
        where_in_file = rasterio.windows.Window.from_slices(
            (rows - up.stop, rows - up.start), (columns.start, columns.stop)
        )
        blocks.append(
            _unpacked(source.read(band, window=where_in_file, masked=True), scale, offset)
        )
    values = np.concatenate(blocks, axis=1)[::-1]
    whole = np.dtype(source.dtypes[band - 1]).kind in "iu"
    return assemble(
        latitude.first + latitude.step * np.arange(up.start, up.stop),
        part.longitude(longitude.step),
        values,
        unit=unit,
        quantity=quantity,
        where=where,
        quantisation=abs(scale) if whole else 0.0,
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
