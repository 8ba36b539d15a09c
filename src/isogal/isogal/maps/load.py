"""Which map does a source mean? The registry of formats; the part of a map round a route."""

import math
from pathlib import Path

import numpy as np

from isogal import plugins
from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.channels import RouteMap
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Format
from isogal.maps.formats.geotiff import read_geotiff


def map_formats() -> tuple[Format, ...]:
    """Return every format that an installed package provides, Isogal's own first.

    Raises
    ------
    InputError
        A format's package cannot be imported.
    """
    return tuple(
        plugins.load(plugins.MAP_FORMATS, name) for name in plugins.names(plugins.MAP_FORMATS)
    )


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
        Name of a format; None = by suffix or content of the folder.

    Raises
    ------
    InputError
        No such file, unknown format, and whatever the reader refuses.
    """
    path = Path(source).expanduser()
    if format_name is not None:
        chosen = plugins.load(plugins.MAP_FORMATS, format_name)
    else:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
        fitting = [known for known in map_formats() if known.matches(path)]
        if not fitting:
            names = ", ".join(plugins.names(plugins.MAP_FORMATS))
            raise InputError(f"{path}: not a known map format by its name; known: {names}")
        chosen = fitting[0]
    if crs is not None:
        if chosen.read is not read_geotiff:
            raise InputError(f"{path}: crs can only be given for geotiff, not for {chosen.name}")
        return read_geotiff(path, variable, window, quantity=quantity, unit=unit, crs=crs)
    return chosen.read(path, variable, window, quantity=quantity, unit=unit)


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
