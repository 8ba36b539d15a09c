"""How right a map is where nothing was measured: readings are left out, by whole lines or by
blocks, and predicted from the others."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.groups import Groups
from isogal.maps.gridding.blunders import FAR, Named, named
from isogal.maps.gridding.covariance import Readings
from isogal.maps.gridding.kriging import Kriging, groups, in_groups
from isogal.maps.gridding.survey import Survey, blocks_of
from isogal.seeds import generator

BLOCKS = 12
"""Parts that the blocks of a survey of stations are divided into."""
_MOST = 12_000
"""Readings that are predicted at most."""
_NEAR = 8
"""Readings that a block's worst one is looked for among."""
_FOLDS = 5
"""Sets of lines (or of blocks) of which something is learnt from the others."""
_TOGETHER = 120
"""Of a sample, readings that lie together."""


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """M readings that were left out."""

    rows: Integers
    """(M,) of the survey."""
    places: Array
    """(M, 3) m."""
    error: Array
    """(M,) reading less prediction."""
    field: Array
    """(M,) variance expected of the field there."""
    noise: Array
    """(M,) variance of the reading's noise, and its line's offset."""
    share: Array
    """(M,) of `field` in the field's own variance."""
    distance: Array
    """(M,) m to the next reading that was not left out."""
    parts: Integers
    """(N,) line or set of blocks of every reading of the survey, left out together."""
    length: float
    """m, over which errors hold together."""

    def __getitem__(self, some: Booleans) -> "LeftOut":
        names = ("rows", "places", "error", "field", "noise", "share", "distance")
        return replace(self, **{name: getattr(self, name)[some] for name in names})

    @property
    def part(self) -> Integers:
        """(M,) of `parts`."""
        return self.parts[self.rows]

    @property
    def ratio(self) -> Array:
        """(M,) squared error over its variance, the normalised innovation squared (NIS)."""
        return self.error**2 / (self.field + self.noise)

    def scaled(self, factor: Array) -> "LeftOut":
        """Return the same with the field's part of the variances times a factor (M,)."""
        return replace(self, field=self.field * factor)

    def cost(self, factor: Array) -> float:
        """Return minus the mean log-likelihood with a factor (M,) of the field's variance."""
        variance = self.field * factor + self.noise
        return 0.5 * float(np.mean(np.log(variance) + self.error**2 / variance))

    def scale(self, factor: Array) -> float:
        """Return the logarithm of the number that a factor (M,) is to be multiplied by for the
        mean squared normalised error to be 1."""
        low, high = -10.0, 10.0
        for _ in range(50):
            middle = 0.5 * (low + high)
            more = np.mean(self.scaled(factor * math.exp(middle)).ratio) > 1.0
            low, high = (middle, high) if more else (low, middle)
        return low

    def mean(self, each: Array) -> tuple[float, float]:
        """Return the mean of numbers (M,), one of each reading, and its 1-sigma: what readings of
        a line say holds together, and its sum counts as one."""
        mean = float(each.mean())
        sums = np.bincount(np.unique(self.part, return_inverse=True)[1], each - mean)
        return mean, float(np.sqrt(np.sum(sums**2)) / each.size)

    def surely_nearer(self, other: "LeftOut") -> bool:
        """Whether the mean distance from the predictions is smaller than another method's of the
        same readings by more than its 1-sigma."""
        change, sigma = self.mean(np.abs(self.error) - np.abs(other.error))
        return change < -sigma

    def figures(self) -> dict[str, object]:
        """Return RMS and NIS with the 1-sigma of the latter, of all and by distance to the next
        reading (quarters)."""
        edges = np.quantile(self.distance, [0.25, 0.5, 0.75])
        quarter = np.searchsorted(edges, self.distance)
        nis, nis_sigma = self.mean(self.ratio)
        return {
            "readings": int(self.error.size),
            "rms": float(np.sqrt(np.mean(self.error**2))),
            "nis": nis,
            "nis_sigma": nis_sigma,
            "by_distance": [
                {
                    "distance_m": float(np.median(self.distance[quarter == k])),
                    "rms": float(np.sqrt(np.mean(self.error[quarter == k] ** 2))),
                    "nis": float(self.ratio[quarter == k].mean()),
                }
                for k in range(4)
                if (quarter == k).any()
            ],
        }


def far_off(survey: Survey, blocks: Survey, out: LeftOut) -> list[Named]:
    """Return the readings of a survey that are further off than `FAR` of their 1-sigmas from what
    the others predict, the worst first: blunders, or what no other reading has seen. Of a block
    (`block_reduced`) that is so far off it is the reading that is furthest off there."""
    from scipy.spatial import cKDTree

    sigmas = np.sqrt(out.ratio)
    far = np.flatnonzero(sigmas > FAR)
    predicted = blocks.value[out.rows[far]] - out.error[far]
    tree, rows = cKDTree(survey.places[:, :2]), np.empty(far.size, np.int64)
    for k, block in enumerate(out.rows[far]):
        near = np.atleast_1d(tree.query(blocks.places[block, :2], min(_NEAR, len(survey)))[1])
        if survey.line is not None and blocks.line is not None:
            own = near[survey.line[near] == blocks.line[block]]
            near = own if own.size else near
        rows[k] = near[np.argmax(np.abs(survey.value[near] - predicted[k]))]
    return named(survey, rows, predicted, sigmas[far], used=True)


def folds(part: Integers) -> list[Booleans]:
    """Return (M,) for each set of parts which readings, each of a part (M,), are of it; none where
    all are of one."""
    parts, own = np.unique(part, return_inverse=True)
    order = generator(0, 0, "gridding folds").permutation(parts.size) % _FOLDS
    found = [order[own] == k for k in range(min(_FOLDS, parts.size))]
    return found if len(found) > 1 else []


def leave_out(
    kriging: Kriging,
    by: str,
    progress: Callable[[int, int], None],
    without: Callable[[Booleans], Kriging] | None = None,
) -> LeftOut:
    """Predict readings from the others.

    Parameters
    ----------
    kriging : Kriging
    by : str
        `lines`: each line from the other lines; `blocks`: each of `BLOCKS` sets of blocks of the
        plane, drawn at random, from the other sets.
    progress : function
        Called with the number of readings that are done, and of all.
    without : function, optional
        What gives the kriging that has learnt nothing from some readings (N,); then each fifth of
        the lines (or sets) is predicted by one that has not seen it.
    """
    readings = kriging.readings
    places, part = readings.places, _parts(readings, by, 2.0 * kriging.covariance.shortest)
    by_fold = [(one, without(one)) for one in folds(part)] if without else []

    def unlearnt(rows: Integers) -> Kriging:
        return next((found for one, found in by_fold if one[rows[0]]), kriging)

    chosen = np.flatnonzero(_sample(readings))
    together = (
        rows[group]
        for rows in (chosen[part[chosen] == name] for name in np.unique(part[chosen]))
        for group in kriging.groups(places[rows])
    )

    def predicted(rows: Integers) -> tuple[Array, Array]:
        return unlearnt(rows).at(places[rows], part == part[rows[0]])

    error, variance = np.full((2, len(part)), np.nan)
    for rows, (mean, own) in in_groups(predicted, together, progress):
        error[rows], variance[rows] = readings.value[rows] - mean, own
    rows = chosen
    noise = np.full(rows.size, kriging.covariance.unresolved)
    if readings.sigma is not None:
        noise += readings.sigma[rows] ** 2
    own, distance = variance[rows], _distances(kriging, rows, part)
    share = own / kriging.covariance.variance_at(places[rows])
    length = kriging.covariance.shortest
    return LeftOut(rows, places[rows], error[rows], own, noise, share, distance, part, length)


def _distances(kriging: Kriging, rows: Integers, part: Integers) -> Array:
    """Return (M,) m from some readings to the next of another part."""
    total, places = len(part), kriging.readings.places[:, :2]
    out, open_, most = np.full(rows.size, np.inf), np.arange(rows.size), 32
    while open_.size:
        most = min(most, total)
        distance, near = kriging.tree.query(places[rows[open_]], most)
        distance = np.where(part[near] == part[rows[open_], None], np.inf, distance)
        out[open_] = distance.min(axis=1)
        open_ = open_[~np.isfinite(out[open_])] if most < total else open_[:0]
        most *= 4
    return out


def _parts(readings: Readings, by: str, side: float) -> Integers:
    if by == "lines" and readings.line is not None:
        return readings.line
    block = Groups.by(blocks_of(readings.places, side)).of
    order = generator(0, 0, "gridding blocks left out").permutation(int(block.max()) + 1)
    return order[block] % BLOCKS


def _sample(readings: Readings) -> Booleans:
    """Return which readings (N,) are predicted: all, or some of all places."""
    count = len(readings)
    chosen = np.full(count, count <= _MOST)
    if count > _MOST:
        random = generator(0, 0, "gridding readings left out")
        for rows in groups(readings.places, _TOGETHER):
            chosen[rows] = random.random() < _MOST / count
    return chosen
