"""A lattice between start and goal: columns across the way, and straight edges from each place to
those ahead of it in the next column."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.planning.areas import Rings, inside

COLUMNS = 36
"""Edges of a route, if they are long enough."""
STEEPEST = 3
"""Rows that an edge goes up or down at most; rows are half as far apart as columns."""
_BETWEEN = 400.0  # m between the points of an edge that must not lie in an area


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """C + 1 columns of R rows; the start is in the middle of the first, the goal of the last."""

    latitude: Array
    """(C + 1, R) rad."""
    longitude: Array
    """(C + 1, R) rad."""
    length: Array
    """(D,) m, of an edge that goes up by so many rows: -STEEPEST to STEEPEST."""
    heading: Array
    """(D,) rad."""
    rise: Integers
    """(D,) rows."""
    side: float
    """m between rows."""
    advance: float
    """m between columns."""
    free: Booleans
    """(C, R, D) whether an edge keeps out of all areas, and on the map."""

    @property
    def middle(self) -> int:
        """Row of start and goal."""
        return self.latitude.shape[1] // 2

    @property
    def straight(self) -> float:
        """m from start to goal."""
        return self.advance * (self.latitude.shape[0] - 1)

    def left(self, column: int, row: int) -> float:
        """Return the least length (m) from a place to the goal."""
        ahead = self.advance * (self.latitude.shape[0] - 1 - column)
        return math.hypot(ahead, self.side * (row - self.middle))


def lattice_between(
    start: tuple[float, float],
    goal: tuple[float, float],
    detour: float,
    areas: list[Rings],
    shortest: float = 0.0,
) -> Lattice:
    """Return the lattice of all routes that are not much longer than the straight one.

    Parameters
    ----------
    start, goal : pair of float
        Latitude and longitude, rad.
    detour : float
        By which share a route may be longer.
    areas : list of Rings
        That edges keep out of.
    shortest : float
        m, of an edge.
    """
    middle = 0.5 * (start[0] + goal[0])
    north_scale, east_scale = (float(scale) for scale in metres_per_radian(middle))
    ahead = np.array([(goal[0] - start[0]) * north_scale, (goal[1] - start[1]) * east_scale])
    distance = float(np.hypot(*ahead))
    along = ahead / distance
    across = np.array([-along[1], along[0]])
    columns = COLUMNS if shortest * COLUMNS <= distance else max(1, int(distance / shortest))
    advance = distance / columns
    side = 0.5 * advance
    half = 0.5 * distance * math.sqrt((1.0 + detour) ** 2 - 1.0)
    rows = np.arange(-math.ceil(half / side), math.ceil(half / side) + 1)
    place = (
        advance * np.arange(columns + 1)[:, None, None] * along
        + side * rows[None, :, None] * across
    )
    latitude = start[0] + place[..., 0] / north_scale
    longitude = start[1] + place[..., 1] / east_scale
    rise = np.arange(-STEEPEST, STEEPEST + 1)
    edge = advance * along + side * rise[:, None] * across
    length = np.hypot(*edge.T)
    steps = max(2, math.ceil(float(length.max()) / _BETWEEN))
    free = np.ones((columns, rows.size, rise.size), dtype=np.bool_)
    for d, vector in enumerate(edge):
        share = np.linspace(0.0, 1.0, steps + 1)
        free[..., d] = ~inside(
            areas,
            latitude[:-1, :, None] + share * vector[0] / north_scale,
            longitude[:-1, :, None] + share * vector[1] / east_scale,
        ).any(axis=-1)
    heading = np.arctan2(edge[:, 1], edge[:, 0])
    return Lattice(latitude, longitude, length, heading, rise, side, advance, free)
