"""Which map does a source mean? The registry of formats; the part of a map round a route."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.channels import RouteMap
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.gdf import read_gdf
from isogal.maps.formats.geotiff import read_geotiff
from isogal.maps.formats.netcdf import read_netcdf
from isogal.maps.formats.xyz import read_xyz
from isogal.maps.ggmplus.folder import is_ggmplus, read_ggmplus


class Reader(Protocol):
    """How every format is read."""

    def __call__(
        self,
        path: Path,
        variable: str | None,
        window: Window | None,
        *,
        quantity: str | None,
        unit: str | None,
    ) -> FieldMap:
        """Read a map; raises InputError."""
        ...


@dataclass(frozen=True)
class Format:
    """One map format: its name in scenarios, what it recognises, and its reader."""

    name: str
    matches: Callable[[Path], bool]
    read: Reader


def _suffix(*suffixes: str) -> Callable[[Path], bool]:
    return lambda path: path.suffix.casefold() in suffixes


FORMATS: tuple[Format, ...] = (
    Format("netcdf", _suffix(".nc", ".nc4", ".grd", ".cdf"), read_netcdf),
    Format("ggmplus", is_ggmplus, read_ggmplus),
    Format("geotiff", _suffix(".tif", ".tiff", ".gtiff"), read_geotiff),
    Format("gdf", _suffix(".gdf"), read_gdf),
    Format("xyz", _suffix(".xyz", ".txt", ".csv", ".dat"), read_xyz),
)
"""Known formats; to add one, write its reader and its line here."""


def load_map(
    source: str | Path,
    variable: str | None = None,
    quantity: str | None = None,
    window: Window | None = None,
    *,
    unit: str | None = None,
    crs: str | None = None,
    format_name: str | None = None,
) -> FieldMap:
    """Read a map from a file or folder.

    Parameters
    ----------
    source : path
        File or folder.
    variable : str, optional
        Variable, band or extension, where a source holds several.
    quantity, unit : str, optional
        What the numbers are, where the source does not say.
    window : Window, optional
        Only this part.
    crs : str, optional
        Coordinate reference system of a GeoTIFF that does not say.
    format_name : str, optional
        One of `FORMATS`; None = by suffix or content of the folder.

    Raises
    ------
    InputError
        No such file, unknown format, and whatever the reader refuses.
    """
    path = Path(source).expanduser()
    names = ", ".join(f.name for f in FORMATS)
    if format_name is not None:
        chosen = [f for f in FORMATS if f.name == format_name]
        if not chosen:
            raise InputError(f"map: unknown format '{format_name}'; known: {names}")
    else:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
        chosen = [f for f in FORMATS if f.matches(path)]
        if not chosen:
            raise InputError(f"{path}: not a known map format by its name; known: {names}")
    if crs is not None:
        if chosen[0].read is not read_geotiff:
            raise InputError(
                f"{path}: crs can only be given for geotiff, not for {chosen[0].name}"
            )
        return read_geotiff(path, variable, window, quantity=quantity, unit=unit, crs=crs)
    return chosen[0].read(path, variable, window, quantity=quantity, unit=unit)


def check_coverage(field_map: RouteMap, latitude: Array, longitude: Array) -> None:
    """Raise InputError unless the map has a value at every route point; names the first without,
    and the map's extent."""
    bare = ~field_map.covers(latitude, longitude)
    if bare.any():
        first = int(np.argmax(bare))
        at = f"{math.degrees(latitude[first]):.4f}, {math.degrees(longitude[first]):.4f} deg"
        raise InputError(
            f"map: {field_map.provenance} ({field_map.extent.text()}) does not cover the route: no"
            f" value at {at} (point {first} of {latitude.size}; {int(bare.sum())} points have"
            " none)"
        )
