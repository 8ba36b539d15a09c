"""Regular latitude and longitude axes: checks, and the part of an axis that a window needs."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError

TWO_PI = 2.0 * math.pi
REGULAR = 1e-2
"""How far, in steps, a node may lie from a regular axis (files round their coordinates)."""
FEWEST_NODES = 4
"""Along an axis; interpolation needs them."""
MARGIN = 3
"""Nodes kept beyond a window on each side, so that every point of the window can be
interpolated."""


MOST_CELLS = 150_000_000
"""Cells that a reader takes into memory at once (1.2 GB) unless it is told another number."""


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


class RegularAxis(NamedTuple):
    """Latitudes or longitudes of a grid, rad."""

    first: float
    step: float
    nodes: int

    @property
    def last(self) -> float:
        """Of the last node."""
        return self.first + self.step * (self.nodes - 1)


def regular_axis(axis: Array, name: str, where: str) -> Array:
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
    if not np.isfinite(axis).all():
        raise InputError(f"{where}: {name} has missing coordinates")
    step = (axis[-1] - axis[0]) / (axis.size - 1)
    if step <= 0.0:
        raise InputError(f"{where}: {name} must increase")
    exact = axis[0] + step * np.arange(axis.size)
    worst = int(np.argmax(np.abs(axis - exact)))
    if abs(axis[worst] - exact[worst]) > REGULAR * step:
        raise InputError(
            f"{where}: {name} must be regularly spaced; node {worst} is at"
            f" {math.degrees(axis[worst]):.6f} deg, not at {math.degrees(exact[worst]):.6f} deg"
        )
    return exact


def latitude_slice(
    first: float, step: float, count: int, south: float, north: float, margin: int = MARGIN
) -> slice:
    """Return the rows of an increasing axis needed for latitudes south..north (may be empty)."""
    low = max(math.floor((south - first) / step) - margin, 0)
    high = min(math.ceil((north - first) / step) + margin + 1, count)
    return slice(low, max(low, high))


def longitude_slices(
    first: float, step: float, count: int, west: float, east: float, margin: int = MARGIN
) -> tuple[list[slice], float]:
    """Return the columns needed for longitudes west..east, and the longitude of the first of them.

    Up to two slices, to be joined in that order: the second where a grid round the Earth is cut
    inside the window. The longitude returned lies in the axis' own range."""
    width = (east - west) % TWO_PI if east < west else min(east - west, TWO_PI)
    circle = round(TWO_PI / step)
    periodic = count >= circle and abs(circle * step - TWO_PI) < 1e-3 * step
    x = ((west - first) / step) % (TWO_PI / step)
    if periodic:
        low = math.floor(x) - margin
        length = min(math.ceil(width / step) + 2 * margin + 2, circle)
        if length == circle:
            return [slice(0, circle)], first
        low %= circle
        if low + length <= circle:
            return [slice(low, low + length)], first + low * step
        return [slice(low, circle), slice(0, low + length - circle)], first + low * step
    if (
        x > count - 1 and x + width / step > TWO_PI / step
    ):  # the window starts west of the grid and reaches into it
        x -= TWO_PI / step
    low = max(math.floor(x) - margin, 0)
    high = min(math.ceil(x + width / step) + margin + 1, count)
    return [slice(low, max(low, high))], first + low * step


class Part(NamedTuple):
    """The part of a grid that a window needs."""

    rows: slice
    columns: list[slice]
    """To be joined in this order, see `longitude_slices`."""
    west: float
    """Longitude of the first column, rad, in the grid's own range."""

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows.stop - self.rows.start, sum(
            part.stop - part.start for part in self.columns
        )

    def longitude(self, step: float) -> Array:
        """Return the longitudes of the columns, rad, which are a step apart."""
        columns: Array = np.arange(self.shape[1], dtype=np.float64)
        return self.west + step * columns


def part_within(
    latitude: RegularAxis, longitude: RegularAxis, window: Window | None, where: str
) -> Part:
    """Return the part of a grid that a window needs; None = all of it.

    Raises
    ------
    EmptyWindowError
        Less of the grid lies there than interpolation needs.
    """
    extent = Window(latitude.first, latitude.last, longitude.first, longitude.last)
    if window is None:
        window = extent
        part = Part(slice(0, latitude.nodes), [slice(0, longitude.nodes)], longitude.first)
    else:
        part = Part(
            latitude_slice(*latitude, window.south, window.north),
            *longitude_slices(*longitude, window.west, window.east),
        )
    if min(part.shape) < FEWEST_NODES:
        raise EmptyWindowError(
            f"{where}: the map ({extent.text()}) has nothing at {window.text()}"
        )
    return part
