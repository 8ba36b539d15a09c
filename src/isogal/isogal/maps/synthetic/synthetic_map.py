"""The synthetic map of a window, or along a route."""

from functools import partial

import numpy as np

from isogal.errors import InputError
from isogal.maps.axes import TooManyCellsError, Window, check_size
from isogal.maps.corridor import Corridor
from isogal.maps.field_map import FieldMap
from isogal.maps.ggmplus.tiles import cells_of, map_of_cells, overlap, places_of
from isogal.maps.synthetic.terrain import CELLS, QUANTA, SIZE_DEG
from isogal.maps.synthetic.tiles import VERSION, Progress, read_tiles
from isogal.maps.tiled_map import WHOLE_CELLS, ScalarMap, TiledMap

_NAME = f"synthetic map {VERSION}"
_VARIABLES = {"ga": "gravity", "dg": "disturbance"} | {name: name for name in QUANTA}


def quantity_of(variable: str, key: str) -> str:
    """Return what a variable of the synthetic map is of; raises InputError, which begins with the
    key or option that names it."""
    if variable not in _VARIABLES:
        raise InputError(f"{key}: the synthetic map has height, ga and dg, not '{variable}'")
    return _VARIABLES[variable]


def synthetic_map(quantity: str, window: Window, progress: Progress | None = None) -> FieldMap:
    """Return the synthetic map of a window.

    Parameters
    ----------
    quantity : str
        ``gravity``, ``disturbance`` or ``height`` (of the terrain).
    window : Window
        Part of the Earth, between 89° south and north.
    progress : callable, optional
        Called with (tiles ready, tiles needed).

    Returns
    -------
    FieldMap
        Exact (sigma 0) but for its steps (`quantisation`).

    Raises
    ------
    InputError
        Another quantity, or a window too large or too near a pole.
    """
    if quantity not in QUANTA:
        raise InputError(f"map: the synthetic map has {', '.join(QUANTA)}, not {quantity}")
    rows, columns = _cells(window)
    check_size(len(rows) * len(columns), _NAME, window)
    values = np.empty((len(rows), len(columns)))
    places = places_of(rows, columns, SIZE_DEG)
    for tile, numbers in read_tiles(quantity, places, progress):
        for place in places[tile]:
            there, part = overlap(values, numbers, place)
            there[...] = part
    np.multiply(values, QUANTA[quantity], out=values)
    return map_of_cells(rows, columns, values, quantity, QUANTA[quantity], _NAME)


def synthetic_map_along(
    quantity: str, corridor: Corridor, progress: Progress | None = None
) -> ScalarMap:
    """Return the synthetic map along a route, tiled if it is large; its tiles are made at once.

    Parameters and errors are those of `synthetic_map`."""
    try:
        return synthetic_map(quantity, corridor.window._replace(most_cells=WHOLE_CELLS), progress)
    except TooManyCellsError:
        needed = {
            tile for window in corridor.windows() for tile in places_of(*_cells(window), SIZE_DEG)
        }
        for _ in read_tiles(quantity, sorted(needed), progress):
            pass
        return TiledMap(partial(synthetic_map, quantity), corridor)


def _cells(window: Window) -> tuple[range, range]:
    """Return rows and columns of a window and its margin, as `cells_of` does; raises InputError
    near the poles."""
    rows, columns = cells_of(window)
    if rows.start < CELLS or rows.stop > 179 * CELLS:
        raise InputError(
            f"map: the synthetic map ends at 89 deg south and north; asked for {window.text()}"
        )
    return rows, columns
