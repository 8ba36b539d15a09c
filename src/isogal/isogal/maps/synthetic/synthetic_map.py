"""The synthetic map of a window, or along a route."""

from functools import partial

import numpy as np

from isogal.errors import InputError
from isogal.maps.axes import TooManyCellsError, Window, check_size
from isogal.maps.corridor import Corridor
from isogal.maps.field_map import FieldMap
from isogal.maps.ggmplus.tiles import cells_of
from isogal.maps.synthetic.terrain import CELLS, QUANTA, STEP_DEG
from isogal.maps.synthetic.tiles import VERSION, Progress, Tile, read_tiles
from isogal.maps.tiled_map import WHOLE_CELLS, ScalarMap, TiledMap

_NAME = f"synthetic map {VERSION}"


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
    places = _places(rows, columns)
    for tile, numbers in read_tiles(quantity, places, progress):
        for top, side in places[tile]:
            part = numbers[
                max(-top, 0) : len(rows) - top,
                max(-side, 0) : len(columns) - side,
            ]
            values[max(top, 0) : top + CELLS, max(side, 0) : side + CELLS] = part
    unit = "m" if quantity == "height" else "m/s²"
    return FieldMap(
        np.radians(-90.0 + STEP_DEG * (np.array(rows) + 0.5)),
        np.radians(STEP_DEG * (np.array(columns) + 0.5)),
        np.multiply(values, QUANTA[quantity], out=values),
        unit=unit,
        quantity=quantity,
        quantisation=QUANTA[quantity],
        provenance=_NAME,
        file_unit=unit,
    )


def synthetic_map_along(
    quantity: str, corridor: Corridor, progress: Progress | None = None
) -> ScalarMap:
    """Return the synthetic map along a route, tiled if it is large; its tiles are made at once.

    Parameters and errors are those of `synthetic_map`."""
    try:
        return synthetic_map(quantity, corridor.window._replace(most_cells=WHOLE_CELLS), progress)
    except TooManyCellsError:
        tiled = TiledMap(partial(synthetic_map, quantity), corridor)
        needed = {tile for window in tiled.windows() for tile in _places(*_cells(window))}
        for _ in read_tiles(quantity, sorted(needed), progress):
            pass
        return tiled


def _cells(window: Window) -> tuple[range, range]:
    """Return rows and columns of a window and its margin, as `cells_of` does; raises InputError
    near the poles."""
    rows, columns = cells_of(window)
    if rows.start < CELLS or rows.stop > 179 * CELLS:
        raise InputError(
            f"map: the synthetic map ends at 89 deg south and north; asked for {window.text()}"
        )
    return rows, columns


def _places(rows: range, columns: range) -> dict[Tile, list[tuple[int, int]]]:
    """Return the tiles that some cells lie in, and at which of these rows and columns each has its
    first cell (at several, where the columns go round the Earth)."""
    places: dict[Tile, list[tuple[int, int]]] = {}
    for row in range(rows.start // CELLS, -(-rows.stop // CELLS)):
        for column in range(columns.start // CELLS, -(-columns.stop // CELLS)):
            tile = row - 90, (column + 180) % 360 - 180
            place = row * CELLS - rows.start, column * CELLS - columns.start
            places.setdefault(tile, []).append(place)
    return places
