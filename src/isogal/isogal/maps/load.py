"""Which format does a file have? Maps from files and folders, and whether they cover a route."""

import math
from pathlib import Path

import numpy as np

from isogal import plugins
from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.channels import RouteMap
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Asked, Format
from isogal.maps.quantities import check_quantity


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
    if quantity is not None:
        check_quantity(quantity, str(path))
    chosen = _format_of(path) if format_name is None else _named(format_name)
    if crs is not None and not chosen.takes_crs:
        raise InputError(f"{path}: crs can only be given for geotiff, not for {chosen.name}")
    return chosen.read(path, Asked(variable, quantity, unit, crs), window)


def _format_of(path: Path) -> Format:
    """Return the format of a file or folder; those of other packages are tried last."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    known = plugins.names(plugins.MAP_FORMATS)
    for name in known:
        if (candidate := _named(name)).matches(path):
            return candidate
    raise InputError(f"{path}: not a known map format by its name; known: {', '.join(known)}")


def _named(name: str) -> Format:
    return plugins.load(plugins.MAP_FORMATS, name, Format)


def check_coverage(
    field_map: RouteMap, latitude: Array, longitude: Array, *, partly: bool = False
) -> None:
    """Raise InputError unless the map has a value at every route point, or, where that is enough,
    at some; names the first without, and the map's extent."""
    bare = ~field_map.covers(latitude, longitude)
    if bare.all() or (bare.any() and not partly):
        first = int(np.argmax(bare))
        at = f"{math.degrees(latitude[first]):.4f}, {math.degrees(longitude[first]):.4f} deg"
        raise InputError(
            f"map: {field_map.provenance} ({field_map.extent.text()}) does not cover the route: no"
            f" value at {at} (point {first} of {latitude.size}; {int(bare.sum())} points have"
            " none)"
        )
