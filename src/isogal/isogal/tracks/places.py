"""Where a track may be: what its readings say of each shift of a grid, by every model of map and
instrument (docs/mathematics.md, section 10.2).

The first grid covers the prior; cells that are not impossible are divided by three until they are
smaller than the posterior."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import softmax

from isogal.arrays import Array, Integers
from isogal.maps.corridor import along_track
from isogal.matching.pmht.cells import log_normal, square_of
from isogal.matching.pmht.models import Models
from isogal.tracks.evidence import Seen

REACH = 3.3
"""Half-width of the grid in prior 1-sigmas."""
LARGEST_CELL_M, PRIOR_SHARE = 300.0, 0.12
"""First cells: at most so large, and this share of the prior's 1-sigma."""
FINE_ENOUGH, LEVELS = 0.5, 6
"""Cells over the least 1-sigma of the posterior, and grids at most."""
DEPTH, KEPT = 30.0, 900
"""Log density below the best at which a cell is given up, and cells that are divided at most."""
LOOKED_AT, MODELS, MODEL_DEPTH = 300, 30, 9.0
"""Cells at which all models are looked at, models that go on from there, and log of how much less
likely they may be."""
PLACE_DEPTH, PLACE_GAP_M = 8.0, 150.0
"""Log density below the best at which a cell belongs to no place, and m by which places are
apart."""


@dataclass(frozen=True, slots=True, eq=False)
class Shifts:
    """Posterior of a shift on (C,) cells of one size."""

    centres: Array
    """(C, 2) north, east, m."""
    size: float
    """m."""
    log_prior: Array
    """(C,) of the shift."""
    seen: tuple[Seen, ...]
    """What each field says of the cells."""
    overview: "Shifts | None" = None
    """The first grid."""

    @classmethod
    def at(
        cls,
        seen: Sequence[Seen],
        which: Sequence[Integers],
        cells: Array,
        size: float,
        prior: Array,
    ) -> "Shifts":
        """Look at cells (C, 2), counted from the prior's middle in units of their size (m), with
        some models of each field."""
        centres = cells * size
        looked = (one.at(centres, size, w) for one, w in zip(seen, which, strict=True))
        return cls(centres, size, log_normal(centres, prior), tuple(looked))

    @property
    def log_density(self) -> Array:
        """(C,) of the shift by all readings, without its constant."""
        return np.asarray(self.log_prior + sum(one.log_density for one in self.seen))

    @property
    def weight(self) -> Array:
        """(C,) posterior probability of each cell."""
        return softmax(self.log_density)

    @property
    def likeliest(self) -> Array:
        """(1, 2) the cell of the highest density."""
        return self.centres[[int(np.argmax(self.log_density))]]

    @property
    def moments(self) -> tuple[Array, Array]:
        """Mean (2,) and covariance (2, 2), m."""
        return self._moments(self.weight)

    def covariance_by(self, one: Seen) -> Array:
        """Return (2, 2) m², what one field alone leaves of the prior, on these cells."""
        return self._moments(softmax(self.log_prior + one.log_density))[1]

    def _moments(self, weight: Array) -> tuple[Array, Array]:
        mean = weight @ self.centres
        apart = self.centres - mean
        return mean, (apart * weight[:, None]).T @ apart + np.eye(2) * self.size**2 / 12.0

    @property
    def places(self) -> Array:
        """Probability of each place apart from others (P,), the heaviest first. Cells in squares
        that touch are of one place; of half of `PLACE_GAP_M`, so that cells within half of it
        are, and none beyond 1.5 times it."""
        from scipy.ndimage import label

        log = self.log_density
        high = np.flatnonzero(log > log.max() - PLACE_DEPTH)
        side = max(PLACE_GAP_M, 3.1 * self.size) / 2.0
        square = np.floor(self.centres[high] / side).astype(np.int64)
        square -= square.min(axis=0)
        taken = np.zeros(square.max(axis=0) + 1, dtype=np.bool_)
        taken[tuple(square.T)] = True
        place = label(taken, np.ones((3, 3)))[0][tuple(square.T)]
        return np.asarray(np.sort(np.bincount(place, self.weight[high])[1:])[::-1])

    def tells_apart(self, one: Seen, prior: Array) -> bool:
        """Return whether a gridded map, by its own 1-sigma, tells the places of a prior (2, 2)
        apart: ln(1 + S² / s²) / 2 nats for each independent piece of the track (two lengths over
        which its errors hold together; Shannon 1948, theorem 17) against the prior's entropy in
        places of one length. If not, what fits there fits by chance, and the models, which learn
        the error from readings close together, take it for good."""
        if not one.gridded or not one.own_variance:
            return True
        length = math.exp(self.of_models(one) @ np.log(one.length))
        way = along_track(one.readings.latitude, one.readings.longitude)[-1]
        shown = one.shown(self.likeliest)
        told = 0.5 * way / (2.0 * length) * math.log1p(shown / one.own_variance)
        places = 2.0 * math.pi * math.e * math.sqrt(float(np.linalg.det(prior))) / length**2
        return told > math.log(places)

    def of_models(self, one: Seen) -> Array:
        """Return (M,) the posterior probability of the models of a field."""
        return np.asarray(softmax(one.by_model, axis=0) @ self.weight)


def shifts_of(seen: Sequence[Seen], prior: Array) -> Shifts:
    """Return the posterior of a shift with a prior N(0, prior), (2, 2) m², by readings of fields
    that are independent given the shift."""
    deviation = np.sqrt(np.diag(prior))
    size = min(LARGEST_CELL_M, PRIOR_SHARE * float(deviation.min()))
    north, east = (np.arange(-(n := math.ceil(REACH * d / size)), n + 1.0) for d in deviation)
    cells = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
    centres = cells * size
    density = np.exp(log_normal(centres, prior))
    seen = [one.placed(centres, density) for one in seen]
    few = [_few(one.models) for one in seen]
    overview = shifts = Shifts.at(seen, few, cells, size, prior)
    seen = [one.placed(shifts.centres, shifts.weight) for one in seen]
    every = [np.arange(len(one.models.sigma)) for one in seen]
    best = Shifts.at(seen, every, cells[_kept(shifts.log_density, LOOKED_AT)], size, prior)
    which = [_likely(best, one) for one in best.seen]
    cells = cells[_kept(shifts.log_density, len(cells))]
    fan = square_of(np.arange(-1.0, 2.0))
    for _ in range(LEVELS):
        shifts = Shifts.at(seen, which, cells, size, prior)
        if size <= FINE_ENOUGH * math.sqrt(float(np.linalg.eigvalsh(shifts.moments[1])[0])):
            break
        seen = [one.placed(shifts.centres, shifts.weight) for one in seen]
        cells = (3 * cells[_kept(shifts.log_density, KEPT)][:, None] + fan).reshape(-1, 2)
        size /= 3.0
    return replace(shifts, overview=overview)


def _kept(log: Array, most: int) -> Integers:
    order = np.argsort(-log, kind="stable")[:most]
    return order[log[order] > log[order[0]] - DEPTH]


def _likely(shifts: Shifts, one: Seen) -> Integers:
    """Return the models of a field that are not impossible, all where they may be of use."""
    share = np.log(np.maximum(shifts.of_models(one), 1e-300))
    order = np.argsort(-share, kind="stable")[:MODELS]
    return np.sort(one.which[order[share[order] > share[order[0]] - MODEL_DEPTH]])


def _few(models: Models) -> Integers:
    """Return models of the usual length with every second sigma, by which shifts are ranked."""
    usual = np.flatnonzero(models.length == np.sort(models.length)[len(models.length) // 2])
    sigmas = np.unique(models.sigma[usual])
    return usual[np.isin(models.sigma[usual], sigmas[::-2])]
