"""Regular latitude and longitude axes: checks, and the part of an axis that a window needs."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Values
from isogal.errors import InputError

Read = Callable[[slice, slice], Values]
"""Gives the values (n, m, ...) of some rows and columns of a grid; NaN = missing."""
TWO_PI = 2.0 * math.pi
REGULAR = 1e-2
"""How far, in steps, a node may lie from a regular axis (files round their coordinates)."""
FEWEST_NODES = 4
"""Along an axis; interpolation needs them."""
MARGIN = 3
"""Nodes kept beyond a window on each side, so that every point of the window can be
interpolated."""


MOST_CELLS = 150_000_000
"""Cells that a reader takes into memory at once (1.2 GB) unless it is given another number."""


class EmptyWindowError(InputError):
    """A map has no value in the window asked for."""


class TooManyCellsError(InputError):
    """A window has more cells than are taken into memory at once."""


class Window(NamedTuple):
    """Part of the Earth, rad; west may exceed east by whole circles, and both may be given in any
    range."""

    south: float
    north: float
    west: float
    east: float
    most_cells: int = MOST_CELLS
    """A reader refuses to read more than so many (`check_size`)."""

    @property
    def window(self) -> "Window":
        """Itself, as a corridor has one around it."""
        return self

    def grown(self, metres: float) -> "Window":
        """Return the window with a margin (m) on all sides."""
        reach = metres / 6.371e6
        widest = min(max(abs(self.south), abs(self.north)) + reach, math.radians(89.9))
        sideways = reach / math.cos(widest)
        return Window(
            self.south - reach, self.north + reach, self.west - sideways, self.east + sideways
        )

    def text(self) -> str:
        """Return the extent in degrees, for messages."""
        return "latitude {:.4f} to {:.4f}, longitude {:.4f} to {:.4f} deg".format(
            *np.degrees(self[:4])
        )


def regular_axis(axis: Values, name: str, where: str) -> Array:
    """Return an increasing regular axis made exact (float64), or raise.

    Raises
    ------
    InputError
        Fewer than four nodes, not increasing, missing coordinates, or nodes off a regular axis by
        over 1 % of a step.
    """
    axis = np.asarray(axis, dtype=np.float64)
    if axis.ndim != 1 or axis.size < FEWEST_NODES:
        raise InputError(
            f"{where}: {name} needs at least 4 nodes in one dimension, has shape {axis.shape}"
        )
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    if not step > 0.0:
        raise InputError(f"{where}: {name} must increase")
    exact = axis[0] + step * np.arange(axis.size)
    worst = int(np.argmax(np.abs(axis - exact)))
    if not abs(axis[worst] - exact[worst]) <= REGULAR * step:  # or missing
        raise InputError(
            f"{where}: {name} must be regularly spaced; node {worst} is at"
            f" {math.degrees(axis[worst]):.6f} deg, not at {math.degrees(exact[worst]):.6f} deg"
        )
    return exact


def _columns(axis: Array, west: float, east: float) -> tuple[list[slice], float]:
    """Return the columns needed for longitudes west..east (rad), and the longitude of the first of
    them.

    Up to two slices, to be joined in that order: the second where a grid round the Earth is cut
    inside the window. The longitude returned lies in the axis' own range."""
    first, count = float(axis[0]), axis.size
    step = (axis[-1] - axis[0]) / (count - 1)
    width = (east - west) % TWO_PI if east < west else min(east - west, TWO_PI)
    if width >= TWO_PI:  # of a way around a pole
        return [slice(0, count)], first
    circle = round(TWO_PI / step)
    periodic = count >= circle and abs(circle * step - TWO_PI) < 1e-3 * step
    x = ((west - first) / step) % (TWO_PI / step)
    if periodic:
        low = (math.floor(x) - MARGIN) % circle
        length = math.ceil(width / step) + 2 * MARGIN + 2
        if length >= circle:
            return [slice(0, circle)], first
        parts = [slice(low, min(low + length, circle)), slice(0, max(low + length - circle, 0))]
        return parts[: 1 + (low + length > circle)], first + low * step
    if x > count - 1 and x + width / step > TWO_PI / step:  # it starts west of the grid
        x -= TWO_PI / step
    low = max(math.floor(x) - MARGIN, 0)
    high = min(math.ceil(x + width / step) + MARGIN + 1, count)
    return [slice(low, max(low, high))], first + low * step


class Part(NamedTuple):
    """The part of a grid that a window needs."""

    rows: slice
    columns: list[slice]
    """To be joined in this order: the second where a grid round the Earth is cut in the window."""
    latitude: Array
    """Of the rows, rad."""
    longitude: Array
    """Of the columns, rad, in the grid's own range at the first."""

    def of(self, nodes: Values | Read) -> Values:
        """Return this part of values (n, m, ...), or of what is read by rows and columns."""
        blocks = [
            nodes(self.rows, columns) if callable(nodes) else nodes[self.rows, columns]
            for columns in self.columns
        ]
        return blocks[0] if len(blocks) == 1 else np.concatenate(blocks, axis=1)


def part_within(latitude: Array, longitude: Array, window: Window | None, where: str) -> Part:
    """Return the part of a grid that a window needs; None = all of it.

    Parameters
    ----------
    latitude, longitude : (n,), (m,) rad
        Of the grid, as of `regular_axis`.
    window : Window, optional
        With `MARGIN` nodes around it, as far as the grid has them.
    where : str
        What the grid is of, for messages.

    Raises
    ------
    EmptyWindowError
        Less of the grid lies there than interpolation needs.
    TooManyCellsError
        More than are taken into memory at once.
    """
    extent = Window(latitude[0], latitude[-1], longitude[0], longitude[-1])
    rows, columns, west = slice(0, latitude.size), [slice(0, longitude.size)], extent.west
    up, right = ((axis[-1] - axis[0]) / (axis.size - 1) for axis in (latitude, longitude))
    if window is not None:
        low = max(math.floor((window.south - latitude[0]) / up) - MARGIN, 0)
        high = min(math.ceil((window.north - latitude[0]) / up) + MARGIN + 1, latitude.size)
        rows = slice(low, max(low, high))
        columns, west = _columns(longitude, window.west, window.east)
    shape = rows.stop - rows.start, sum(part.stop - part.start for part in columns)
    if min(shape) < FEWEST_NODES:
        raise EmptyWindowError(
            f"{where}: the map ({extent.text()}) has nothing at {(window or extent).text()}"
        )
    check_size(math.prod(shape), where, window)
    return Part(rows, columns, latitude[rows], west + right * np.arange(shape[1]))


def check_size(cells: int, where: str, window: Window | None = None) -> None:
    """Refuse a grid that would take too much memory, before anything is read.

    Raises
    ------
    TooManyCellsError
        Names the number of cells.
    """
    most = MOST_CELLS if window is None else window.most_cells
    if cells > most:
        raise TooManyCellsError(
            f"{where}: {cells:,} cells are too many to read at once (at most {most:,}); give"
            " a window or a route"
        )
