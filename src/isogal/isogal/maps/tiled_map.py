"""A map that is too large to be in memory: parts of it are read as the vehicle goes.

The Earth is divided into tiles of a fixed number of the map's cells, always at the same places.
Values at many points are looked up tile by tile. A batch is matched against a map in memory of all
tiles that lie within the corridor's margin of the batch, so that what it is matched against
depends on where the batch lies and on nothing else: not on which batches came before it, nor on
the runs that are computed beside it. What was read last is kept, as long as it is small."""

import contextlib
import itertools
import math
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array, Booleans, Integers
from isogal.errors import InputError
from isogal.maps.axes import (
    FEWEST_NODES,
    TWO_PI,
    EmptyWindowError,
    TooManyCellsError,
    Window,
)
from isogal.maps.corridor import Corridor
from isogal.maps.field_map import FieldMap, delegated, flat_points

WHOLE_CELLS = 6_000_000
"""A map along a route that has at most so many cells is read as a whole (48 MB)."""
TILE_CELLS = 250
"""Cells along a side of a tile."""
_KEPT_CELLS = 4_000_000  # of parts that were read, 32 MB


Load = Callable[[Window], FieldMap]
"""Reads what a map has in a window, with the nodes around it that interpolation needs; can be
pickled if the map is sent to other processes. Raises EmptyWindowError where there is nothing,
TooManyCellsError where there is more than the window allows, else InputError."""

LookUp = Callable[[FieldMap, Array, Array], Array | tuple[Array, ...]]
_of_start = partial(delegated, lambda tiled: tiled._start)


class TiledMap:
    """A scalar field along a route, read when it is needed. Values are looked up as in a
    `FieldMap`.

    Parameters
    ----------
    load : Load
        Reads a part.
    corridor : Corridor
        The route, and how far around it the map is needed.
    start : FieldMap, optional
        The part at the start of the route, which says what the map is; read if it is not given.

    Raises
    ------
    InputError
        The part at the start of the route cannot be read.
    """

    def __init__(self, load: Load, corridor: Corridor, start: FieldMap | None = None) -> None:
        self.corridor = corridor
        self._load = load
        if start is None:
            lat, lon = float(corridor.latitude[0]), float(corridor.longitude[0])
            start = load(Window(lat, lat, lon, lon).grown(corridor.margin))
        self._start = start
        grid = start.grid
        self._side = TILE_CELLS * grid.latitude_step, TILE_CELLS * grid.longitude_step
        self._read: OrderedDict[Window, FieldMap | None] = OrderedDict()

    def __reduce__(self) -> tuple[type["TiledMap"], tuple[Load, Corridor, FieldMap]]:
        """Pickle the map without the parts that were read."""
        return TiledMap, (self._load, self.corridor, self._start)

    # what a map says of itself is what its start says: see `FieldMap`
    unit: str = _of_start("unit")
    quantity: str = _of_start("quantity")
    sigma: float | Array = _of_start("sigma")
    states_error: bool = _of_start("states_error")
    correlation_length: float | None = _of_start("correlation_length")
    quantisation: float = _of_start("quantisation")
    height: float | None = _of_start("height")
    provenance: str = _of_start("provenance")
    file_unit: str = _of_start("file_unit")
    file_factor: float = _of_start("file_factor")
    step: tuple[float, float] = _of_start("step")

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of the window around the corridor."""
        (south, north, west, east), (height, width) = self.extent[:4], self.step
        return round((north - south) / height) + 1, round((east - west) / width) + 1

    @property
    def extent(self) -> Window:
        """The window around the corridor."""
        return self.corridor.window

    def cell_size_m(self, latitude: float) -> tuple[float, float]:
        """See `FieldMap`."""
        return self._start.cell_size_m(latitude)

    def value(self, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """See `FieldMap`."""
        return self._look_up(FieldMap.value, 1, latitude, longitude)[0]

    def value_and_gradient(
        self, latitude: ArrayLike, longitude: ArrayLike
    ) -> tuple[Array, Array, Array]:
        """See `FieldMap`."""
        value, north, east = self._look_up(FieldMap.value_and_gradient, 3, latitude, longitude)
        return value, north, east

    def sigma_at(self, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """See `FieldMap`."""
        return self._look_up(FieldMap.sigma_at, 1, latitude, longitude)[0]

    def covers(self, latitude: ArrayLike, longitude: ArrayLike) -> Booleans:
        """See `FieldMap`."""
        return np.isfinite(self.value(latitude, longitude))

    def near(self, latitude: ArrayLike, longitude: ArrayLike) -> FieldMap:
        """Return the map within the corridor's margin of all of some points (rad), in memory.

        Where the map has nothing at all there, the part at the start of the route, which has
        nothing there either.

        Raises
        ------
        InputError
            The points lie so far apart that it would be too large, or the map cannot be read.
        """
        lat, lon, _ = flat_points(latitude, longitude)
        lon = np.unwrap(lon)
        lon += self._turned(lon[:1]) - lon[0]
        around = Window(lat.min(), lat.max(), lon.min(), lon.max()).grown(self.corridor.margin)
        south, north, west, east = self._span(around)
        try:
            return self._part(self._window((south, north), (west, east))) or self._start
        except TooManyCellsError as error:
            raise InputError(f"matcher.batch_length: make it shorter; {error}") from None

    def _split(self, latitude: Array, longitude: Array) -> Iterator[tuple[Integers, FieldMap]]:
        """Yield groups of some points (N,): their indices, and a map in memory around them. Points
        where the map has nothing are in no group."""
        known = np.flatnonzero(np.isfinite(latitude) & np.isfinite(longitude))
        places = np.stack([latitude[known], self._turned(longitude[known])], axis=1)
        tiles, owner = np.unique(np.floor(places / self._side), axis=0, return_inverse=True)
        for index, (row, column) in enumerate(tiles.astype(np.int64).tolist()):
            tile = self._window((row, row + 1), (column, column + 1))
            part = self._part(tile)
            if part is not None:
                yield known[owner.reshape(-1) == index], part

    def parts(self) -> Iterator[FieldMap]:
        """Yield the tiles that lie in the corridor, each without its margin."""
        found = set()
        for window in self.corridor.windows():
            south, north, west, east = self._span(window)
            found |= set(itertools.product(range(south, north), range(west, east)))
        for row, column in sorted(found):
            tile = self._window((row, row + 1), (column, column + 1))
            with contextlib.suppress(EmptyWindowError):  # all values lie in the margin
                if (part := self._part(tile)) is not None:
                    yield _without_margin(part, tile)

    def overview(self, most: int, window: Window | None = None) -> FieldMap:
        """Return at most ``most`` rows and columns of the map in the corridor, or in a window;
        nothing (NaN) off the corridor."""
        south, north, west, east = (window or self.extent)[:4]
        rows, columns = (
            min(most, max(4, int(width / step)))
            for width, step in zip((north - south, east - west), self.step, strict=True)
        )
        latitude, longitude = np.linspace(south, north, rows), np.linspace(west, east, columns)
        turn = TWO_PI * np.round((longitude.mean() - self.corridor.longitude.mean()) / TWO_PI)
        shown = np.zeros((rows, columns), dtype=np.bool_)
        for part in self.corridor.windows():
            near = slice(*np.searchsorted(latitude, part[:2]))
            shown[near, slice(*np.searchsorted(longitude - turn, part[2:4]))] = True
        values, places = np.full((rows, columns), np.nan), np.nonzero(shown)
        values[places] = self.value(latitude[places[0]], longitude[places[1]])
        return FieldMap(
            latitude, longitude, values, self.unit, self.quantity, provenance=self.provenance
        )

    def _look_up(
        self, what: LookUp, count: int, latitude: ArrayLike, longitude: ArrayLike
    ) -> list[Array]:
        """Return what a map in memory says at points, `count` numbers each, tile by tile."""
        lat, lon, shape = flat_points(latitude, longitude)
        found = np.full((count, lat.size), np.nan)
        for rows, part in self._split(lat, lon):
            found[:, rows] = what(part, lat[rows], lon[rows])
        return [one.reshape(shape)[()] for one in found]

    def _part(self, window: Window) -> FieldMap | None:
        """Read the map in a window unless it was read lately; None where there is nothing."""
        if window in self._read:
            self._read.move_to_end(window)
        else:
            try:
                self._read[window] = self._load(window)
            except EmptyWindowError:
                self._read[window] = None
            sizes = [part.values.size if part else 0 for part in self._read.values()]
            while len(self._read) > 1 and sum(sizes) > _KEPT_CELLS:
                self._read.popitem(last=False)
                del sizes[0]
        return self._read[window]

    def _turned(self, longitude: Array) -> Array:
        """Return longitudes turned by whole circles to where the corridor has its own."""
        middle = self.corridor.longitude.mean()
        return longitude - TWO_PI * np.round((longitude - middle) / TWO_PI)

    def _span(self, window: Window) -> tuple[int, int, int, int]:
        """Return the first row and the one after the last, and the columns likewise, of the tiles
        that a window touches."""
        (height, width), (south, north, west, east) = self._side, window[:4]
        return (
            math.floor(south / height),
            math.floor(north / height) + 1,
            math.floor(west / width),
            math.floor(east / width) + 1,
        )

    def _window(self, rows: tuple[int, int], columns: tuple[int, int]) -> Window:
        """Return the window of some tiles."""
        height, width = self._side
        return Window(rows[0] * height, rows[1] * height, columns[0] * width, columns[1] * width)


ScalarMap = FieldMap | TiledMap
"""A map of one quantity, in memory or read when it is needed."""


def map_along(load: Load, corridor: Corridor) -> ScalarMap:
    """Return the map along a route: in memory if it is small enough (`WHOLE_CELLS`), else tiled.

    Raises
    ------
    InputError
        The map cannot be read.
    """
    try:
        return load(corridor.window._replace(most_cells=WHOLE_CELLS))
    except TooManyCellsError:
        return TiledMap(load, corridor)


def _without_margin(part: FieldMap, tile: Window) -> FieldMap:
    """Return the nodes of a part that lie in its tile; raises EmptyWindowError where none has a
    value."""
    longitude = part.longitude + TWO_PI * np.round((tile.west - part.longitude[0]) / TWO_PI)
    rows = slice(*np.searchsorted(part.latitude, tile[:2]))
    columns = slice(*np.searchsorted(longitude, tile[2:4]))
    if rows.stop - rows.start < FEWEST_NODES or columns.stop - columns.start < FEWEST_NODES:
        raise EmptyWindowError(f"{part.provenance}: ends at the edge of a tile")
    return replace(part.part(rows, columns), longitude=longitude[columns])
