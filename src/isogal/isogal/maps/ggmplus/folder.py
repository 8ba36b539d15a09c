"""GGMplus folders: tiles of 5° x 5° with 2500 x 2500 cells (Hirt et al. 2013,
doi:10.1002/grl.50838; layout: SCIENCE 2).

A tile is named by its south-west corner (``S40E145.ga``), has no header, big-endian whole numbers,
latitude running fastest (south to north), then longitude (west to east); cell centres at corner +
0.001 + 0.002 i degrees, GRS80."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import atomic_path
from isogal.maps.assemble import check_size
from isogal.maps.axes import MARGIN, TWO_PI, EmptyWindowError, Window
from isogal.maps.field_map import FieldMap
from isogal.maps.quantities import QUANTITIES, check_plausible

STEP_DEG = 0.002
CELLS = 2500
SIZE_DEG = 5
_ACROSS, _UP = 360 * 500, 180 * 500
_BLOCK = 50  # columns of a tile mapped at once: 0.5 MB


@dataclass(frozen=True)
class Kind:
    """One kind of GGMplus file."""

    quantity: str
    dtype: str
    no_data: int
    step: float
    """Of the numbers, in the quantity's unit."""


_ARCSEC = math.pi / 648000.0
KINDS = {
    "ga": Kind("gravity", ">i4", -(2**31), 1e-6),
    "dg": Kind("disturbance", ">i2", -(2**15), 1e-6),
    "xi": Kind("deflection_north", ">i2", -(2**15), 0.1 * _ARCSEC),
    "eta": Kind("deflection_east", ">i2", -(2**15), 0.1 * _ARCSEC),
    "ha": Kind("geoid", ">i4", -(2**31), 1e-3),
}
"""By file name extension; ``ha`` is the height anomaly (quasigeoid)."""
_NAME = re.compile(r"([NS])(\d\d)([EW])(\d\d\d)\.(ga|dg|xi|eta|ha)")


def tile_name(south: int, west: int, extension: str) -> str:
    """Return the file name of the tile with this south-west corner (deg, multiples of 5)."""
    west = (west + 180) % 360 - 180
    latitude = f"{'S' if south < 0 else 'N'}{abs(south):02d}"
    return f"{latitude}{'W' if west < 0 else 'E'}{abs(west):03d}.{extension}"


def tiles_of(window: Window) -> list[tuple[int, int]]:
    """Return the south-west corners (deg) of all tiles that a window touches; west may exceed
    180."""
    rows, columns = _cells(window)
    return [
        (tile_row * SIZE_DEG - 90, tile_column * SIZE_DEG)
        for tile_row in range(rows.start // CELLS, (rows.stop - 1) // CELLS + 1)
        for tile_column in range(columns.start // CELLS, (columns.stop - 1) // CELLS + 1)
    ]


def is_ggmplus(path: Path) -> bool:
    """Tell whether a path is a tile, or a folder that holds tiles."""
    if path.is_dir():
        return any(_NAME.fullmatch(item.name) for item in path.iterdir())
    return _NAME.fullmatch(path.name) is not None


def read_ggmplus(
    path: str | Path,
    variable: str | None = None,
    window: Window | None = None,
    *,
    quantity: str | None = None,
    unit: str | None = None,
) -> FieldMap:
    """Read a window from a folder of tiles, joined across their borders.

    Parameters
    ----------
    path : path
        Folder, or one tile.
    variable : str, optional
        ``ga``, ``dg``, ``xi``, ``eta`` or ``ha``; None = by ``quantity``, or the only kind in the
        folder.
    window : Window, optional
        None = all tiles there.
    quantity : str, optional
        Must be that of the variable.
    unit : str, optional
        Not allowed: the format fixes the unit.

    Returns
    -------
    FieldMap
        Missing tiles (open sea) are NaN, and the provenance names them.

    Raises
    ------
    InputError
        No such tiles, a tile of the wrong size, numbers that cannot be GGMplus.
    """
    path = Path(path)
    if unit is not None:
        raise InputError(f"{path}: GGMplus fixes the unit; unit cannot be given")
    single = _NAME.fullmatch(path.name)
    if single and path.is_file():
        variable = variable or single.group(5)
        window = window or _extent([path.name])
        path = path.parent
    if not path.is_dir():
        raise InputError(f"{path}: no such folder")
    extension = _extension(path, variable, quantity)
    kind = KINDS[extension]
    if window is None:
        window = _extent(
            [
                item.name
                for item in path.iterdir()
                if _NAME.fullmatch(item.name) and item.suffix == f".{extension}"
            ]
        )
    rows, columns = _cells(window)
    corners = tiles_of(window)
    missing = [
        name
        for name in (tile_name(*corner, extension) for corner in corners)
        if not (path / name).is_file()
    ]
    if len(missing) == len(corners):
        raise EmptyWindowError(f"{path}: has none of the tiles needed: {', '.join(missing)}")
    latitude = np.radians(-90.0 + STEP_DEG * (np.arange(rows.start, rows.stop) + 0.5))
    longitude = np.radians(STEP_DEG * (np.arange(columns.start, columns.stop) + 0.5))
    check_size(latitude.size * longitude.size, str(path), window)
    values = np.full((latitude.size, longitude.size), np.nan)
    for south, west in corners:
        name = tile_name(south, west, extension)
        if name not in missing:
            place = ((south + 90) * 500 - rows.start, west * 500 - columns.start)
            _read_tile(path / name, kind, place, values)
    note = f"; no tile {', '.join(missing)}" if missing else ""
    return FieldMap(
        latitude,
        longitude,
        values,
        unit=QUANTITIES[kind.quantity].unit,
        quantity=kind.quantity,
        quantisation=kind.step,
        provenance=f"GGMplus {path}:{extension}{note}",
        file_unit=QUANTITIES[kind.quantity].unit,
    )


def _cells(window: Window) -> tuple[range, range]:
    """Return rows (from the south pole) and columns (from Greenwich, continuous) of a window and
    its margin."""
    east = (
        window.east
        if window.east >= window.west
        else window.west + (window.east - window.west) % TWO_PI
    )
    south, north, west, east = (
        math.degrees(x) / STEP_DEG for x in (window.south, window.north, window.west, east)
    )
    low, high = math.floor(south) + _UP // 2 - MARGIN, math.floor(north) + _UP // 2 + MARGIN + 1
    left, right = (
        math.floor(west) - MARGIN,
        min(math.floor(east) + MARGIN + 1, math.floor(west) - MARGIN + _ACROSS),
    )
    return range(max(low, 0), min(high, _UP)), range(left, right)


def _extension(path: Path, variable: str | None, quantity: str | None) -> str:
    there = sorted(
        {
            match.group(5)
            for match in (_NAME.fullmatch(item.name) for item in path.iterdir())
            if match
        }
    )
    if variable is not None and variable not in KINDS:
        raise InputError(
            f"{path}: GGMplus has no variable '{variable}'; it has {', '.join(KINDS)}"
        )
    if variable is None:
        fitting = [
            e
            for e in (there if quantity is None else KINDS)
            if quantity in (None, KINDS[e].quantity)
        ]
        if len(fitting) != 1:
            asked = f"a {quantity} map" if quantity else "the variable to use"
            raise InputError(
                f"{path}: cannot tell {asked}; give variable= (--variable) one of"
                f" {', '.join(there) or ', '.join(KINDS)}"
            )
        variable = fitting[0]
    if quantity is not None and quantity != KINDS[variable].quantity:
        raise InputError(f"{path}: {variable} is {KINDS[variable].quantity}, not {quantity}")
    return variable


def _extent(names: list[str]) -> Window:
    """Return the window of all these tiles, without a margin beyond them."""
    corners = []
    for name in names:
        match = _NAME.fullmatch(name)
        assert match is not None
        south = int(match.group(2)) * (-1 if match.group(1) == "S" else 1)
        corners.append((south, int(match.group(4)) * (-1 if match.group(3) == "W" else 1)))
    lats, lons = zip(*corners, strict=True)
    inside = (MARGIN + 0.5) * STEP_DEG
    return Window(
        math.radians(min(lats) + inside),
        math.radians(max(lats) + SIZE_DEG - inside),
        math.radians(min(lons) + inside),
        math.radians(max(lons) + SIZE_DEG - inside),
    )


def _read_tile(path: Path, kind: Kind, place: tuple[int, int], values: Array) -> None:
    """Copy the part of a tile that lies in ``values``; its cell (0, 0) belongs at row, column
    ``place``."""
    dtype = np.dtype(kind.dtype)
    expected = CELLS * CELLS * dtype.itemsize
    try:
        size = path.stat().st_size
        if size != expected:
            raise InputError(
                f"{path}: has {size} bytes, a GGMplus {path.suffix[1:]} tile has {expected}; cut"
                " short?"
            )
        low, high = math.inf, -math.inf
        rows = slice(max(-place[0], 0), min(values.shape[0] - place[0], CELLS))
        for first, last in _blocks(place[1], values.shape[1]):
            raw = np.memmap(
                path, dtype, "r", first * CELLS * dtype.itemsize, (last - first, CELLS)
            )[:, rows].T
            block = raw * kind.step
            block[raw == kind.no_data] = np.nan
            if not np.isnan(block).all():
                low, high = min(low, float(np.nanmin(block))), max(high, float(np.nanmax(block)))
            values[
                place[0] + rows.start : place[0] + rows.stop, place[1] + first : place[1] + last
            ] = block
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None
    if low <= high:
        check_plausible((low, high), kind.quantity, 1.0, str(path), fixed=True)


def _blocks(left: int, columns: int) -> Iterator[tuple[int, int]]:
    """Give runs of columns of a tile that lie in the grid when the tile's first column is the
    grid's ``left``."""
    start, stop = max(-left, 0), min(columns - left, CELLS)
    for first in range(start, stop, _BLOCK):
        yield first, min(first + _BLOCK, stop)


def write_ggmplus(
    field_map: FieldMap, folder: str | Path, variable: str | None = None
) -> list[Path]:
    """Write a map as GGMplus tiles; cells that it has no value at are no-data.

    Parameters
    ----------
    field_map : FieldMap
        The map; it is interpolated to the cells of GGMplus.
    folder : path
        Made if it is not there; tiles in it are replaced.
    variable : str, optional
        Extension; None = by the map's quantity.

    Returns
    -------
    list of Path
        The tiles.

    Raises
    ------
    InputError
        GGMplus has no such quantity, a number does not fit, or the folder cannot be written.
    """
    fitting = [
        e
        for e, kind in KINDS.items()
        if kind.quantity == field_map.quantity and variable in (None, e)
    ]
    if not fitting:
        raise InputError(
            f"{folder}: GGMplus has no {field_map.quantity} files; it has {', '.join(KINDS)}"
        )
    kind, folder = KINDS[fitting[0]], Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None
    paths = []
    for south, west in tiles_of(field_map.extent):
        centres = np.radians(STEP_DEG * (np.arange(CELLS) + 0.5))
        latitude = math.radians(south) + centres
        raw = np.full((CELLS, CELLS), kind.no_data, dtype=kind.dtype)
        for column, longitude in enumerate(math.radians(west) + centres):
            numbers = np.rint(field_map.value(latitude, longitude) / kind.step)
            known = np.isfinite(numbers)
            if (np.abs(numbers[known]) > np.iinfo(kind.dtype).max).any():
                raise InputError(
                    f"{folder}: a value does not fit into {kind.dtype} steps of {kind.step:g}"
                )
            raw[column, known] = numbers[known]
        if (raw != kind.no_data).any():
            paths.append(folder / tile_name(south, west, fitting[0]))
            with atomic_path(paths[-1]) as temporary:
                raw.tofile(temporary)
    return paths
