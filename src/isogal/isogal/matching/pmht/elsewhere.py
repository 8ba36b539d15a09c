"""Whether readings fit the map much better somewhere else: a quick look at the whole
neighbourhood, which says when a search is worth its time.

A navigator that is lost without knowing it meets a map that seems poor. Here and elsewhere are
compared by their evidence with the map's error integrated out over the same prior: near with a
poor map, elsewhere with a good one (docs/mathematics.md, section 8.7). Readings are averaged in
groups, so that a look costs as much as some fixes whatever the length of the track.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import look_up
from isogal.matching.interfaces import LOST_SIGMA
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.last_hour import LastHour, LostError, Track
from isogal.matching.pmht.map_error import MapErrorPrior
from isogal.matching.quasi_random import standard_normal

_AT_ONCE = 512
"""Places whose densities are computed together."""


@dataclass(frozen=True, slots=True, eq=False)
class _Models:
    """Models of the map's error over a track, an unknown constant, and what the navigator's own
    error puts into the readings."""

    vectors: Array
    """(L, n, n) for each correlation length: eigenvectors of the correlation."""
    values: Array
    """(L, n) its eigenvalues."""
    prior: MapErrorPrior
    common: Array
    """(n, K) the constant and the navigator's error, per unit-variance component of K."""

    @classmethod
    def of(cls, track: Track, field_map: FieldMap, prior: MapErrorPrior) -> "_Models":
        lat, lon = track.latitude, track.longitude
        apart = horizontal_difference(lat[:, None], lon[:, None], lat, lon)
        distance = np.hypot(apart[..., 0], apart[..., 1])
        correlation = np.exp(-distance / prior.length[:, None, None])
        values, vectors = np.linalg.eigh(correlation)
        bias = CONSTANTS.unknown_bias_share * field_map.scale
        common = np.concatenate([np.full((len(lat), 1), bias), _main_part(track)], axis=1)
        return cls(vectors, np.maximum(values, 0.0), prior, common)

    def log_density(self, residual: Array, white: float) -> Array:
        """Return (S,) log density of residuals (n, S) with white noise of a variance, without the
        constant; -inf where one is NaN."""
        sigma = self.prior.sigma[:, None]
        weight = 1.0 / (sigma**2 * self.values[:, None] + white)  # (lengths, sigmas, n)
        common = (self.vectors.swapaxes(1, 2) @ self.common)[:, None]  # (lengths, 1, n, K)
        weighted = common * weight[..., None]
        precision = np.eye(common.shape[-1]) + common.swapaxes(2, 3) @ weighted
        factor = np.linalg.cholesky(precision)
        of_common = np.linalg.solve(factor, weighted.swapaxes(2, 3))
        log_det = 2.0 * np.log(np.diagonal(factor, axis1=2, axis2=3)).sum(axis=2)
        log_det -= np.log(weight).sum(axis=2)
        constant = (self.prior.log_weight.T - 0.5 * log_det)[..., None]
        turn = self.vectors.swapaxes(1, 2).reshape(-1, len(residual))
        rows = of_common.reshape(len(weight), -1, len(residual))
        total = np.full(residual.shape[1], -np.inf)
        # so many at once that what is computed of them stays in the processor's cache
        for part in np.array_split(np.arange(len(total)), -(-len(total) // _AT_ONCE)):
            on_map = part[np.isfinite(residual[:, part]).all(axis=0)]
            if not on_map.size:
                continue
            turned = (turn @ residual[:, on_map]).reshape(len(weight), len(residual), -1)
            explained = (rows @ turned).reshape(*of_common.shape[:3], -1)
            square = weight @ turned**2 - (explained**2).sum(axis=2)
            log = (constant - 0.5 * square).reshape(-1, len(on_map))
            top = log.max(axis=0, initial=-np.inf)
            total[on_map] = np.log(np.exp(log - top).sum(axis=0)) + top
        return total

    @property
    def of_one_length(self) -> "_Models":
        """Those of the middle correlation length."""
        middle = slice(len(self.prior.length) // 2, len(self.prior.length) // 2 + 1)
        prior = replace(
            self.prior,
            length=self.prior.length[middle],
            log_weight=self.prior.log_weight[:, middle],
        )
        return replace(self, vectors=self.vectors[middle], values=self.values[middle], prior=prior)

    def best_possible(self, white: float, count: int) -> float:
        """Return the log density of a fit that is better than all but one in a thousand right
        ones."""
        square = count - 3.0 * math.sqrt(2.0 * count)
        return float(self.prior.log_weight.max()) - 0.5 * (square + count * math.log(white))


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What a look has found."""

    log_evidence: float
    """Log Bayes factor of a navigator that is lost against one that is not."""
    place: Array
    """(2,) m, its north and east error at the best place."""
    covariance: Array
    """(2, 2) m² around it."""
    probability: float
    """Of that place, where the navigator is lost."""

    @property
    def says_lost(self) -> bool:
        """Whether a search at the place is worth its time."""
        likely = self.probability > CONSTANTS.look_place_probability
        return likely and self.log_evidence > CONSTANTS.look_log_evidence

    @property
    def readings_to_next(self) -> int:
        """How many readings are to come before the next look."""
        if self.log_evidence < -CONSTANTS.not_lost_log_evidence:
            return CONSTANTS.next_look_if_not_lost_readings
        if self.log_evidence > 0.0:
            return CONSTANTS.next_look_if_lost_readings
        return CONSTANTS.look_every_readings


def look_elsewhere(hour: LastHour, least: int = CONSTANTS.first_look_readings) -> Look | None:
    """Return where the readings of all fields fit best; None where no other place could be much
    better, the track is not on the map, or the readings of each field are fewer than the least.
    """
    if max((len(one.aided.level) for one in hour.seen), default=0) < least:
        return None
    at_own = _Fits.of(hour, aided=True)
    own = _normal(CONSTANTS.look_own_points, hour.own)
    here = float(np.logaddexp.reduce(at_own.log_density(_still(own)))) - math.log(len(own))
    if not at_own.may_be_beaten(here):
        return None
    fits = _Fits.of(hour, aided=False)
    if not fits.touch_maps:
        return None
    errors, value = fits.best_places(hour.lost)
    lost = LOST_SIGMA[0]
    value = value - 0.5 * (errors[:, :2] ** 2).sum(axis=1) / lost**2
    there = float(np.logaddexp.reduce(value))
    if not math.isfinite(there):
        return None
    cell = 2.0 * math.log(CONSTANTS.look_fine_cell_m / lost) - math.log(2.0 * math.pi)
    at_first = errors @ hour.lost.first[:2].T
    return _found(at_first, np.exp(value - there), there + cell - here)


def evidence_at(hour: LastHour, place: tuple[Array, Array]) -> float:
    """Return by how much readings are more likely at a place than where the navigator believes to
    be, as a log Bayes factor.

    Parameters
    ----------
    hour : LastHour
    place : (2,) and (2, 2) arrays
        m and m²: error of the unaided navigator at the end of its track, if it is there.
    """
    own = _normal(CONSTANTS.look_own_points, hour.own)
    spread = place[1] + CONSTANTS.look_bent_track_m**2 * np.eye(2)
    ends = place[0] + _normal(CONSTANTS.look_own_points, spread)
    drawn = standard_normal(len(ends), BATCH_STATES - 2)[::-1]  # else they go together
    there = _Fits.of(hour, aided=False).log_density(hour.lost.with_end(ends, drawn))
    here = _Fits.of(hour, aided=True).log_density(_still(own))
    return float(np.logaddexp.reduce(there) - np.logaddexp.reduce(here))


def _still(place: Array) -> Array:
    """Return errors (S, 7) of places (S, 2) and nothing else."""
    return np.concatenate([place, np.zeros((len(place), BATCH_STATES - 2))], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _Fits:
    """How well the tracks of all fields fit their maps where they are displaced."""

    fits: tuple["_Fit", ...]

    @classmethod
    def of(cls, hour: LastHour, aided: bool) -> "_Fits":
        return cls(
            tuple(
                _Fit.of(
                    (one.aided if aided else one.unaided).grouped(CONSTANTS.look_groups),
                    one.field_map,
                    one.prior,
                )
                for one in hour.seen
            )
        )

    @property
    def touch_maps(self) -> bool:
        """Whether some of each track is on its map where it is believed to be."""
        return all(one.touches_map for one in self.fits)

    def log_density(self, error: Array) -> Array:
        """Return (S,) log density of the readings for errors (S, 7) in the middle of the track."""
        return np.asarray(sum(one.log_density(error, np.eye(BATCH_STATES)) for one in self.fits))

    def may_be_beaten(self, here: float) -> bool:
        """Whether some place could be so much better than the navigator's own that it counts."""
        least = 2.0 * math.log(LOST_SIGMA[0] / CONSTANTS.look_fine_cell_m)
        possible = sum(one.best_possible for one in self.fits) - least
        return math.isfinite(here) and possible - here > CONSTANTS.look_log_evidence

    def best_places(self, lost: LostError) -> tuple[Array, Array]:
        """Return errors (K, 7) in the middle of the track, and log densities (K,) of the readings,
        around the best cells of all."""
        cell, fine = CONSTANTS.look_cell_m, CONSTANTS.look_fine_cell_m
        coarse = _square(np.arange(-CONSTANTS.look_reach_m, CONSTANTS.look_reach_m + 1.0, cell))
        by_place = lost.whole(np.eye(2), np.zeros((2, BATCH_STATES - 2))).T
        bent = [one.track.position[:, :, 2:] @ lost.root for one in self.fits]
        bend = max(math.sqrt(float((one**2).sum(axis=2).mean())) for one in bent)
        blur = math.hypot(cell / math.sqrt(12.0), bend)
        value = sum(one.of_one_length.log_density(coarse, by_place, blur) for one in self.fits)
        best = np.argsort(-value, kind="stable")[: CONSTANTS.look_best_cells]
        inside = _square(np.arange(-0.5 * (cell - fine), 0.5 * cell, fine))
        places = (coarse[best][:, None] + inside).reshape(-1, 2)
        drawn = standard_normal(len(places), BATCH_STATES - 2).copy()
        drawn[::2] = 0.0  # many lost navigators know their velocity and tilt; few draws come near
        errors = lost.whole(places, drawn)
        return errors, self.log_density(errors)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """How well a track fits a map where it is displaced."""

    track: Track
    field_map: FieldMap
    models: _Models
    white: float
    """Variance of a reading's noise."""

    @classmethod
    def of(cls, track: Track, field_map: FieldMap, prior: MapErrorPrior) -> "_Fit":
        white = float((track.sigma**2).mean()) + field_map.quantisation**2 / 12.0
        return cls(track, field_map, _Models.of(track, field_map, prior), white)

    @property
    def touches_map(self) -> bool:
        """Whether some of the track is on the map where it is believed to be."""
        values = self.field_map.value(self.track.latitude, self.track.longitude)
        return bool(np.isfinite(values).any())

    @property
    def best_possible(self) -> float:
        """See `_Models.best_possible`."""
        return self.models.best_possible(self.white, len(self.track.level))

    @property
    def of_one_length(self) -> "_Fit":
        """The same with the middle one of the correlation lengths only, which is enough to say
        where a closer look is worth while."""
        return replace(self, models=self.models.of_one_length)

    def log_density(self, error: Array, per: Array, bend: float = 0.0) -> Array:
        """Return (S,) log density of the readings for errors `per` (7, K) times (S, K) in the
        middle of the track, with further, independent errors of each place, 1-sigma in m."""
        track = self.track
        north, east = metres_per_radian(track.latitude)
        radian = np.stack([1.0 / north, 1.0 / east], axis=-1)
        residual = _residuals(
            self.field_map.grid, track.latitude, track.longitude, radian, track.level,
            track.position @ per, track.reading @ per, np.ascontiguousarray(error),
        )  # fmt: skip
        blur = self._slope() * bend if bend > 0.0 else 0.0
        return self.models.log_density(residual, self.white + blur**2)

    def _slope(self) -> float:
        """Return the RMS gradient of the map along the track, unit per m, of one component."""
        lat, lon = self.track.latitude, self.track.longitude
        _, by_north, by_east = self.field_map.value_and_gradient(lat, lon)
        return math.sqrt(0.5 * float(np.nanmean(by_north**2 + by_east**2)))


def _found(places: Array, weight: Array, log_evidence: float) -> Look:
    """Return the best of places (K, 2) with weights (K,), and those near it as one."""
    apart = places - places[int(np.argmax(weight))]
    near = np.hypot(*apart.T) < CONSTANTS.look_one_place_m
    share = float(weight[near].sum())
    w = weight[near] / share
    mean = w @ places[near]
    off = places[near] - mean
    covariance = (off * w[:, None]).T @ off + CONSTANTS.look_bent_track_m**2 * np.eye(2)
    return Look(log_evidence, mean, covariance, share)


def _square(axis: Array) -> Array:
    """Return (K², 2) all pairs of values of an axis."""
    return np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)


def _normal(count: int, covariance: Array) -> Array:
    """Return (count, 2) fixed points of a normal distribution."""
    return np.asarray(standard_normal(count, 2) @ np.linalg.cholesky(covariance).T)


def _main_part(track: Track) -> Array:
    """Return (n, K) few components with the covariance of `Track.root`, but for what is far below
    the white noise."""
    left, size, _ = np.linalg.svd(track.root, full_matrices=False)
    least = CONSTANTS.look_negligible_share * float(np.median(track.sigma))
    return np.asarray((left * size)[:, size > least], dtype=np.float64)


@kernel(error_model="numpy")
def _residuals(  # type: ignore[no-untyped-def]
    grid, latitude, longitude, radian, level, position, reading, error
):
    """Return (n, S) readings less the map where a navigator with errors (S, K) would be, and less
    what these put into them."""
    samples, rows = error.shape[0], latitude.shape[0]
    out = np.empty((rows, samples))
    lat, lon, known = np.empty(samples), np.empty(samples), np.empty(samples)
    row, column = np.empty(samples, np.int64), np.empty(samples, np.int64)
    for t in range(rows):
        for s in range(samples):
            north, east, effect = 0.0, 0.0, 0.0
            for i in range(error.shape[1]):
                north += position[t, 0, i] * error[s, i]
                east += position[t, 1, i] * error[s, i]
                effect += reading[t, i] * error[s, i]
            lat[s] = latitude[t] - north * radian[t, 0]
            lon[s] = longitude[t] - east * radian[t, 1]
            known[s] = level[t] - effect
        there = out[t]
        look_up(grid, lat, lon, 0, row, column, there)
        for s in range(samples):
            there[s] = known[s] - there[s]
    return out
