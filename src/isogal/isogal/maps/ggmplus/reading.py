"""Maps from a folder of GGMplus tiles."""

import math
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.axes import EmptyWindowError, Window, check_size
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Asked, Format
from isogal.maps.ggmplus.tiles import (
    CELLS,
    KINDS,
    NAME,
    SIZE_DEG,
    Kind,
    cells_of,
    extent_of,
    map_of_cells,
    overlap,
    places_of,
    tile_name,
)
from isogal.maps.quantities import check_plausible, value_range


def is_ggmplus(path: Path) -> bool:
    """Tell whether a path is a tile, or a folder that holds tiles."""
    if path.is_dir():
        return any(NAME.fullmatch(item.name) for item in path.iterdir())
    return NAME.fullmatch(path.name) is not None


def read_ggmplus(path: Path, asked: Asked, window: Window | None = None) -> FieldMap:
    """Read a window from a folder of tiles, or from one tile, joined across their borders.

    Of what can be asked for, the variable is ``ga``, ``dg``, ``xi``, ``eta`` or ``ha``; without it
    the one of the quantity, or the only kind in the folder. Without a window all tiles there are
    read.

    Returns
    -------
    FieldMap
        Missing tiles (open sea) are NaN, and the provenance names them.

    Raises
    ------
    InputError
        No such tiles, a tile of the wrong size, numbers that cannot be GGMplus, or a unit, which
        the format fixes.
    """
    variable = asked.variable
    if asked.unit is not None:
        raise InputError(f"{path}: GGMplus fixes the unit; unit cannot be given")
    single = NAME.fullmatch(path.name)
    if single and path.is_file():
        variable = variable or single.group(5)
        window = window or extent_of([path.name])
        path = path.parent
    if not path.is_dir():
        raise InputError(f"{path}: no such folder")
    there = [match for item in path.iterdir() if (match := NAME.fullmatch(item.name))]
    extension = _extension(path, {match.group(5) for match in there}, variable, asked.quantity)
    if window is None:
        window = extent_of(match.group() for match in there if match.group(5) == extension)
    return _read_window(path, extension, window)


def _extension(path: Path, there: set[str], variable: str | None, quantity: str | None) -> str:
    """Return which kind of tiles to read, of those that are there."""
    if variable is not None:
        fitting = [variable] if variable in KINDS else []
    else:
        fitting = sorted(there) if quantity is None else list(KINDS)
    fitting = [one for one in fitting if quantity in (None, KINDS[one].quantity)]
    if len(fitting) != 1:
        known = ", ".join(f"{one} ({kind.quantity})" for one, kind in KINDS.items())
        asked = f"{variable or 'one variable'} of {quantity or 'any quantity'}"
        raise InputError(
            f"{path}: cannot tell what is meant by {asked}; give variable= (--variable,"
            f" map.variable) one of {known}; there are {', '.join(sorted(there)) or 'none'}"
        )
    return fitting[0]


def _read_window(folder: Path, extension: str, window: Window) -> FieldMap:
    rows, columns = cells_of(window)
    places = places_of(rows, columns, SIZE_DEG)
    names = {tile_name(*tile, extension): place for tile, place in places.items()}
    missing = [name for name in names if not (folder / name).is_file()]
    if len(missing) == len(names):
        raise EmptyWindowError(f"{folder}: has none of the tiles needed: {', '.join(missing)}")
    check_size(len(rows) * len(columns), str(folder), window)
    values = np.full((len(rows), len(columns)), np.nan)
    kind = KINDS[extension]
    for name, where in names.items():
        for place in where if name not in missing else ():
            _read_tile(folder / name, kind, place, values)
    note = f"; no tile {', '.join(missing)}" if missing else ""
    provenance = f"GGMplus {folder}:{extension}{note}"
    return map_of_cells(rows, columns, values, kind.quantity, kind.step, provenance)


def _read_tile(path: Path, kind: Kind, place: tuple[int, int], values: Array) -> None:
    """Copy the part of a tile that lies in ``values``; its cell (0, 0) belongs at row, column
    ``place``."""
    dtype, size = np.dtype(kind.dtype), path.stat().st_size
    if size != (expected := CELLS * CELLS * dtype.itemsize):
        raise InputError(
            f"{path}: has {size} bytes, a GGMplus {path.suffix[1:]} tile has {expected}; cut"
            " short?"
        )
    with reading(path):  # mapped: only what is looked at takes memory
        tile = np.memmap(path, dtype, "r", shape=(CELLS, CELLS)).T
    there, raw = overlap(values, tile, place)
    np.multiply(raw, kind.step, out=there)
    there[raw == kind.no_data] = np.nan
    found = value_range(there)
    if not math.isnan(found[0]):
        check_plausible(found, kind.quantity, 1.0, str(path), fixed=True)


FORMAT = Format("ggmplus", is_ggmplus, read_ggmplus)
