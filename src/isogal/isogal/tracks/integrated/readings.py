"""The readings of a batch, and their residuals at many shifts."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.maps.error_ellipses import joint
from isogal.maps.field_map import FieldMap
from isogal.maps.tensor_error import displacements
from isogal.matching.interfaces import Batch
from isogal.matching.quasi_random import standard_normal
from isogal.matrices import symmetric
from isogal.tracks.continued_map import ContinuedMap

MOST_ROWS = 220
"""Of more readings neighbouring residuals are averaged: the time grows with the square."""
_ENOUGH_ROWS = 90
"""With more, residuals closer together than the map's resolution are averaged: how errors are
correlated over less than that is known least, and says least about the place."""
_MOST_POINTS = 440
"""Places by which rows are told apart, all together: the time grows with the square."""
_RESOLUTION_NODES = 2.0
"""Nodes of a map between which it can tell."""
_LEAST_ON_MAP = 0.05
"""Share of the places possible by the prior that must lie on the map for a reading to be used."""
_AT_ONCE = 200_000
"""Values taken from a map at once: bounds memory."""
_PLACES = 400
"""Likeliest shifts over which a map's variance is averaged."""


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """Rows are means of one or several neighbouring readings: the residual of a row is that of
    its readings averaged, each with the map at its own place. What the errors of two rows have in
    common is averaged likewise, over points: a covariance of averages is a covariance, a
    correlation function of averaged distances is none."""

    map: ContinuedMap
    latitude: Array
    """(n,) rad, each reading."""
    longitude: Array
    """(n,) rad."""
    level: Array
    """(n,) reading less its known offset."""
    jacobian: Array
    """(n, 2) d(reading)/d(shift) by the reduction."""
    average: Array
    """(m, n) weights of the readings in each row."""
    white: Array
    """(m,) variance of each row's sensor noise and of the map's rounding."""
    point: Array
    """(p, n) weights of the readings in each of the points that stand for the rows: neighbouring
    readings of one row, in the order of the rows."""
    point_row: Integers
    """(p,) row of each point."""
    distance: Array
    """(p, p) m, between points."""
    first_new: int
    """Row of the first reading that no earlier batch has used."""
    off_map: int
    """Readings left out because no place that is likely for them lies on the map."""

    def __len__(self) -> int:
        return len(self.white)

    @property
    def count(self) -> int:
        """How many new readings there are."""
        return int((self.average[self.first_new :] > 0.0).sum())

    def residuals(self, shifts: Array) -> Array:
        """Return (m, S) residuals where the true place of each reading is its recorded one less
        a shift (S, 2) north, east (m); NaN beyond the continued map."""
        result = np.empty((len(self), len(shifts)))
        step = max(1, _AT_ONCE // self.level.size)
        for start in range(0, len(shifts), step):
            part = shifts[start : start + step]
            predicted = self.map.field.value(*self._moved(part)) + part @ self.jacobian.T
            result[:, start : start + step] = self.average @ (self.level - predicted).T
        return result

    def mean_square(self, variable: FieldMap, shifts: Array, weight: Array) -> Array:
        """Return (m,) the mean square of a map's sigma at each row over weighted shifts."""
        return self._mean(lambda *at: variable.sigma_at(*at)[..., None] ** 2, shifts, weight)[:, 0]

    @property
    def own_lengths(self) -> bool:
        """Whether the map says over which lengths its error holds together, place by place and in
        each direction."""
        field = self.map.field
        return field.error_ellipses is not None and field.correlation_length is not None

    def in_lengths(self, shifts: Array, weight: Array) -> tuple[Array, Array]:
        """Return (p, p) distances between points over the lengths by which the map's error holds
        together there, times the map's usual one (m), and (p, p) the factor of correlations
        (`isogal.maps.error_ellipses.joint`); with the mean ellipses over weighted shifts."""
        usual = self.map.field.correlation_length or 1.0
        ellipses = self._mean(self.map.field.error_ellipse_at, shifts, weight)
        ellipses[~(ellipses > 0.0).any(axis=1)] = usual**2 * np.array([1.0, 0.0, 1.0])
        apart = displacements(self.point @ self.latitude, self.point @ self.longitude)
        relative, alike = joint(apart, ellipses[self.point_row])
        return usual * relative, alike

    def _mean(self, at: Callable[[Array, Array], Array], shifts: Array, weight: Array) -> Array:
        """Return (m, k) the mean of k numbers (..., k) that are known of places, at each row over
        weighted shifts; 0 where nothing is known."""
        likely = np.argsort(-weight, kind="stable")[:_PLACES]
        share = weight[likely, None] / weight[likely].sum()
        values = at(*self._moved(shifts[likely]))
        known = np.isfinite(values[..., 0]) * share
        mean = np.einsum("st,stk->tk", known, np.nan_to_num(values))
        return np.asarray(self.average @ (mean / np.maximum(known.sum(axis=0), 1e-12)[:, None]))

    def without(self, rows: Booleans) -> "Readings":
        """Return the readings without some rows (m,)."""
        left = ~rows
        keep = self.average[left].sum(axis=0) > 0.0
        points = left[self.point_row]
        return replace(
            self,
            latitude=self.latitude[keep],
            longitude=self.longitude[keep],
            level=self.level[keep],
            jacobian=self.jacobian[keep],
            average=self.average[np.ix_(left, keep)],
            white=self.white[left],
            point=self.point[np.ix_(points, keep)],
            point_row=(np.cumsum(left) - 1)[self.point_row[points]],
            distance=self.distance[np.ix_(points, points)],
            first_new=int(left[: self.first_new].sum()),
        )

    def _moved(self, shifts: Array) -> tuple[Array, Array]:
        north, east = metres_per_radian(self.latitude)
        return (
            self.latitude - shifts[:, :1] / north,
            self.longitude - shifts[:, 1:] / east,
        )


def readings_of(batch: Batch, continued_map: ContinuedMap) -> Readings:
    """Return the readings of a batch that may lie on the map, those of earlier batches first."""
    rows = np.flatnonzero(np.isfinite(batch.reading) & _may_be_on(batch, continued_map))
    new = int(np.searchsorted(rows, len(batch) - batch.new))
    latitude, longitude = batch.latitude[rows], batch.longitude[rows]
    per_row = _per_row(latitude, longitude, continued_map)
    first_new = math.ceil(new / per_row)
    row = np.arange(rows.size) // per_row
    row[new:] = first_new + np.arange(rows.size - new) // per_row
    average = _means(row)
    each = math.ceil(per_row / max(1, _MOST_POINTS // max(len(average), 1)))
    within = np.arange(rows.size) - np.searchsorted(row, row)
    begins = np.diff(row, prepend=-1) + (within % each == 0) > 0
    point = _means(np.cumsum(begins) - 1)
    rounding = continued_map.original.quantisation**2 / 12.0
    return Readings(
        map=continued_map,
        latitude=latitude,
        longitude=longitude,
        level=batch.reading[rows] - batch.offset[rows],
        jacobian=batch.reading_jacobian[rows, :2],
        average=average,
        white=average**2 @ (batch.sigma[rows] ** 2 + rounding),
        point=point,
        point_row=row[begins],
        distance=_distances(point @ latitude, point @ longitude),
        first_new=first_new,
        off_map=int(np.isfinite(batch.reading[-batch.new :]).sum()) - (rows.size - new),
    )


def _means(group: Integers) -> Array:
    """Return (g, n) weights that average readings by the group that each belongs to (n,)."""
    weights = np.zeros((int(group.max(initial=-1)) + 1, group.size))
    weights[group, np.arange(group.size)] = 1.0
    return weights / weights.sum(axis=1, keepdims=True)


def _distances(latitude: Array, longitude: Array) -> Array:
    """Return (p, p) m, between places (rad)."""
    apart = horizontal_difference(latitude[:, None], longitude[:, None], latitude, longitude)
    return symmetric(np.hypot(apart[..., 0], apart[..., 1]))


def _per_row(latitude: Array, longitude: Array, continued_map: ContinuedMap) -> int:
    """Return how many neighbouring readings make a row, by their places (n,), rad."""
    count = len(latitude)
    original = continued_map.original
    node = math.sqrt(math.prod(original.cell_size_m(float(np.mean(original.latitude)))))
    steps = horizontal_difference(latitude[:-1], longitude[:-1], latitude[1:], longitude[1:])
    step = float(np.median(np.hypot(steps[..., 0], steps[..., 1]))) if count > 1 else math.inf
    resolved = round(_RESOLUTION_NODES * node / step) if step > 0.0 else count
    return max(1, math.ceil(count / MOST_ROWS), min(resolved, count // _ENOUGH_ROWS))


def _may_be_on(batch: Batch, continued_map: ContinuedMap) -> Booleans:
    """Return (T,) whether enough of the places possible for each scan lie on the map."""
    factor = np.linalg.cholesky(batch.prior[:2, :2])
    shifts = standard_normal(256, 2) @ factor.T
    north, east = metres_per_radian(batch.latitude)
    covered = continued_map.original.covers(
        batch.latitude - shifts[:, :1] / north, batch.longitude - shifts[:, 1:] / east
    )
    return np.asarray(covered.mean(axis=0) > _LEAST_ON_MAP)
