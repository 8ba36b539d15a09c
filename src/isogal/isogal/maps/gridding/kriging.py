"""Kriging: the field at places, and how uncertain it is, from the readings nearest to them.

With K the covariance of the n nearest readings y (noise and an unknown level included), k that
between them and the places, and k0 among the places,

    mean = k' K^-1 y,   covariance = k0 - k' K^-1 k

(Cressie 1993, Statistics for Spatial Data, sec. 3.4.5; Rasmussen & Williams 2006, eqs. 2.25,
2.26). Places are taken in groups that lie together, each with readings of its own: those further
away are screened by the nearer ones."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.maps.gridding.covariance import Covariance, Readings
from isogal.threads import available_cores

NEIGHBOURS = 700
GROUP = 300
"""Places of a group at most."""
_DENSITY_SAMPLE = 2000
"""Readings that the extent of a group is taken from."""
_Found = TypeVar("_Found")


@dataclass(frozen=True, slots=True, eq=False)
class Kriging:
    """Readings and the covariance of their field."""

    readings: Readings
    covariance: Covariance
    neighbours: int = NEIGHBOURS
    """Readings that a group of places is kriged from."""
    tree: Any = field(init=False, repr=False)
    """Of the readings in the plane."""
    extent: float = field(init=False)
    """m; in a square of this side lie about a quarter of `neighbours` readings."""

    def __post_init__(self) -> None:
        from scipy.spatial import cKDTree

        plane = self.readings.places[:, :2]
        tree = cKDTree(plane)
        some = plane[:: max(len(plane) // _DENSITY_SAMPLE, 1)]
        quarter = min(self.neighbours // 4, len(plane))
        radius = tree.query(some, [quarter])[0]
        object.__setattr__(self, "tree", tree)
        object.__setattr__(self, "extent", np.sqrt(np.pi) * float(np.median(radius)))

    def at(self, places: Array, left_out: Booleans | None = None) -> tuple[Array, Array]:
        """Return the field (P,) at any places (P, 3), and the variance (P,) of its error there, a
        reading's noise not included; without some readings (N,)."""
        mean, variance = np.empty(len(places)), np.empty(len(places))
        for rows in self.groups(places):
            mean[rows], covariance = self.together(places[rows], left_out)
            variance[rows] = np.diag(covariance)
        return mean, np.maximum(variance, 0.0)

    def groups(self, places: Array) -> Iterator[Integers]:
        """Yield rows of places (P, 2+) in groups that can be kriged together."""
        return groups(places, GROUP, 2.0 * self.extent)

    def together(self, places: Array, left_out: Booleans | None = None) -> tuple[Array, Array]:
        """Return mean (P,) and covariance (P, P) of the field's error at a few places that lie
        together; without some readings (N,)."""
        from scipy.linalg import solve_triangular

        near = self.readings.part(self._nearest(places, left_out))
        level = 3.0 * self.readings.spread + 1e-300
        factor = np.linalg.cholesky(self.covariance.of_readings(near) + level**2)
        between = self.covariance.between(near.places, places) + level**2
        white = solve_triangular(
            factor, np.column_stack([near.value, between]), lower=True, check_finite=False
        )
        among = self.covariance.between(places, places) + level**2
        return white[:, 1:].T @ white[:, 0], among - white[:, 1:].T @ white[:, 1:]

    def _nearest(self, places: Array, left_out: Booleans | None) -> Integers:
        """Return rows of the readings next to the box round some places."""
        total, usual = len(self.readings), self.neighbours
        low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
        centre, half = 0.5 * (low + high), 0.5 * (high - low)
        reach, most = float(np.hypot(*half)), 4 * usual
        while True:
            most = min(most, total)
            radius, rows = self.tree.query(centre, most)
            rows, radius = np.atleast_1d(rows), float(np.max(radius))
            if left_out is not None:
                rows = rows[~left_out[rows]]
            beyond = np.maximum(np.abs(self.readings.places[rows, :2] - centre) - half, 0.0)
            distance = np.hypot(beyond[:, 0], beyond[:, 1])
            # of readings inside the box all count; the others by their distance to it
            inside = int((distance == 0.0).sum())
            count = max(usual, min(inside + usual // 2, 2 * usual))
            if count < rows.size:
                order = np.argpartition(distance, count)
                if most == total or distance[order[count]] + reach <= radius:
                    return np.sort(rows[order[:count]])
            elif most == total:
                return np.sort(rows)
            most *= 2


def in_groups(
    do: Callable[[Integers], _Found],
    groups: Iterable[Integers],
    progress: Callable[[int, int], None],
) -> Iterator[tuple[Integers, _Found]]:
    """Do something for groups of rows beside each other, as linear algebra leaves Python's lock;
    yield each with what was found, and show how many rows are done, and of how many."""
    every, done = list(groups), 0
    with ThreadPoolExecutor(available_cores()) as pool:
        for rows, found in zip(every, pool.map(do, every), strict=True):
            yield rows, found
            done += rows.size
            progress(done, sum(one.size for one in every))


def groups(places: Array, size: int, extent: float = np.inf) -> Iterator[Integers]:
    """Yield rows of places (P, 2 or 3) in groups of at most so many within an extent (m) that lie
    together, by halving along the longer side."""
    stack = [np.arange(len(places))]
    while stack:
        rows = stack.pop()
        if rows.size == 0:
            continue
        sides = np.ptp(places[rows, :2], axis=0)
        if rows.size == 1 or (rows.size <= size and sides.max() <= extent):
            yield rows
            continue
        order = rows[np.argsort(places[rows, int(np.argmax(sides))], kind="stable")]
        stack += [order[rows.size // 2 :], order[: rows.size // 2]]
