"""How right a map is where nothing was measured: readings are left out, by whole lines or by
blocks, and predicted from the others."""

from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.maps.gridding.covariance import Readings
from isogal.maps.gridding.kriging import Kriging, groups
from isogal.maps.gridding.survey import Groups, blocks_of
from isogal.seeds import generator

BLOCKS = 12
"""Parts that the blocks of a survey of stations are divided into."""
_MOST = 12_000
"""Readings that are predicted at most."""


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """M readings that were left out."""

    rows: Integers
    """(M,) of the survey."""
    error: Array
    """(M,) reading less prediction."""
    variance: Array
    """(M,) expected of it, the reading's noise and its line's offset included."""
    noise: Array
    """(M,) part of it: noise and offset."""
    distance: Array
    """(M,) m to the next reading that was not left out."""
    part: Integers
    """(N,) line or set of blocks of every reading of the survey, left out together."""

    @property
    def ratio(self) -> Array:
        """(M,) squared error over its variance, the normalised innovation squared (NIS)."""
        return self.error**2 / self.variance

    def scaled(self, factor: Array) -> "LeftOut":
        """Return the same with the field's part of the variances times a factor (M,)."""
        field = (self.variance - self.noise) * factor
        return replace(self, variance=field + self.noise)

    def figures(self) -> dict[str, object]:
        """Return RMS and NIS, of all and by distance to the next reading (quarters)."""
        edges = np.quantile(self.distance, [0.25, 0.5, 0.75])
        quarter = np.searchsorted(edges, self.distance)
        return {
            "readings": int(self.error.size),
            "rms": float(np.sqrt(np.mean(self.error**2))),
            "nis": float(self.ratio.mean()),
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


def leave_out(kriging: Kriging, by: str, side: float) -> LeftOut:
    """Predict readings from the others.

    Parameters
    ----------
    kriging : Kriging
    by : str
        `lines`: each line from the other lines; `blocks`: each of `BLOCKS` sets of blocks of the
        plane, drawn at random, from the other sets.
    side : float
        Of a block, m.
    """
    from scipy.spatial import cKDTree

    readings = kriging.readings
    part = _parts(readings, by, side)
    chosen = _sample(readings)
    error, variance, distance = (np.full(len(part), np.nan) for _ in range(3))
    for name in np.unique(part[chosen]):
        out = part == name
        rows = np.flatnonzero(out & chosen)
        rest = kriging.without(out)
        mean, variance[rows] = rest.at(readings.places[rows])
        error[rows] = readings.value[rows] - mean
        distance[rows] = cKDTree(rest.readings.places[:, :2]).query(readings.places[rows, :2])[0]
    rows = np.flatnonzero(np.isfinite(error))
    covariance = kriging.covariance
    noise = np.full(rows.size, covariance.noise**2)
    if readings.sigma is not None:
        noise += readings.sigma[rows] ** 2
    if by == "lines":
        noise += covariance.line**2
    return LeftOut(rows, error[rows], variance[rows] + noise, noise, distance[rows], part)


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
        for rows in groups(readings.places, max(20, count // 200)):
            chosen[rows] = random.random() < _MOST / count
    return chosen
