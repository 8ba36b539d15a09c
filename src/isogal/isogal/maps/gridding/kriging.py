"""Kriging: the field at places, and how uncertain it is, from the readings nearest to them.

With K the covariance of the n nearest readings y (noise and an unknown level included), k that
between them and the places, and k0 among the places,

    mean = k' K^-1 y,   covariance = k0 - k' K^-1 k

(Cressie 1993, Statistics for Spatial Data, sec. 3.4.5; Rasmussen & Williams 2006, eqs. 2.25,
2.26). Places are taken in groups that lie together, each with readings of its own: those further
away are screened by the nearer ones."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.maps.gridding.covariance import Covariance, Readings

NEIGHBOURS = 700
"""Readings that a group of places is kriged from."""
GROUP = 300
"""Places of a group at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Kriging:
    """Readings and the covariance of their field."""

    readings: Readings
    covariance: Covariance

    def without(self, out: Booleans) -> "Kriging":
        """Return the same with some readings (N,) left out."""
        return Kriging(self.readings.part(~out), self.covariance)

    def at(self, places: Array) -> tuple[Array, Array]:
        """Return the field (P,) at any places (P, 3), and the variance (P,) of its error there, a
        reading's noise not included."""
        mean, variance = np.empty(len(places)), np.empty(len(places))
        for rows in groups(places, GROUP):
            mean[rows], covariance = self.together(places[rows])
            variance[rows] = np.diag(covariance)
        return mean, np.maximum(variance, 0.0)

    def together(self, places: Array) -> tuple[Array, Array]:
        """Return mean (P,) and covariance (P, P) of the field's error at a few places that lie
        together."""
        from scipy.linalg import solve_triangular

        near = self.readings.part(self._nearest(places))
        level = 3.0 * float(np.std(self.readings.value)) + 1e-300
        factor = np.linalg.cholesky(self.covariance.of_readings(near) + level**2)
        between = self.covariance.between(near.places, places) + level**2
        white = solve_triangular(
            factor, np.column_stack([near.value, between]), lower=True, check_finite=False
        )
        among = self.covariance.between(places, places) + level**2
        return white[:, 1:].T @ white[:, 0], among - white[:, 1:].T @ white[:, 1:]

    def _nearest(self, places: Array) -> Integers:
        """Return rows of the readings next to the box round some places."""
        if len(self.readings) <= NEIGHBOURS:
            return np.arange(len(self.readings))
        low, high = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
        centre, half = 0.5 * (low + high), 0.5 * (high - low)
        beyond = np.maximum(np.abs(self.readings.places[:, :2] - centre) - half, 0.0)
        distance = beyond[:, 0] ** 2 + beyond[:, 1] ** 2
        inside = distance == 0.0
        # of readings inside the box all count; the others by their distance to it
        count = max(NEIGHBOURS, min(int(inside.sum()) + NEIGHBOURS // 2, 2 * NEIGHBOURS))
        if count >= distance.size:
            return np.arange(distance.size)
        return np.sort(np.argpartition(distance, count)[:count])


def groups(places: Array, size: int) -> Iterator[Integers]:
    """Yield rows of places (P, 2 or 3) in groups of at most so many that lie together, by halving
    along the longer side."""
    stack = [np.arange(len(places))]
    while stack:
        rows = stack.pop()
        if rows.size <= size:
            if rows.size:
                yield rows
            continue
        extent = np.ptp(places[rows, :2], axis=0)
        order = rows[np.argsort(places[rows, int(np.argmax(extent))], kind="stable")]
        stack += [order[rows.size // 2 :], order[: rows.size // 2]]
