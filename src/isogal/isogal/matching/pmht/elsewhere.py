"""Whether readings fit the map much better somewhere else: a quick look at the whole
neighbourhood, which says when a search is worth its time.

A navigator that is lost without knowing it meets a map that seems poor. Here and elsewhere are
compared by their evidence with the map's error integrated out over the same prior: near with a
poor map, elsewhere with a good one (docs/mathematics.md, section 8.7). The track is taken to be
displaced as a whole, and readings are averaged in groups, so that a look costs as much as some
fixes whatever the length of the track.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import look_up
from isogal.matching.interfaces import LOST_SIGMA, Batch
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.map_error import MapErrorPrior, field_scale
from isogal.matching.quasi_random import standard_normal

_AT_ONCE = 512
"""Places whose densities are computed together."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """Readings along a track, oldest first."""

    latitude: Array
    """(N,) rad, where the navigator believed to be."""
    longitude: Array
    """(N,) rad."""
    level: Array
    """(N,) reading less its known offset, map's unit."""
    sigma: Array
    """(N,) 1-sigma white noise of each."""
    time: Array
    """(N,) s."""

    @classmethod
    def of(cls, batches: Sequence[Batch]) -> "Track":
        """Return the new readings of batches, one after the other."""
        rows = [
            np.stack([one.latitude, one.longitude, one.reading - one.offset, one.sigma, one.time])
            for one in batches
        ]
        every = np.concatenate(rows, axis=1)
        return cls(*every[:, np.isfinite(every[2])])

    def grouped(self, most: int) -> "Track":
        """Return means of equally many readings, so many at most."""
        size = -(-len(self.level) // most)
        count = len(self.level) // size

        def mean(values: Array) -> Array:
            return np.asarray(values[-count * size :].reshape(count, size).mean(axis=1))

        return Track(
            mean(self.latitude), mean(self.longitude), mean(self.level),
            np.sqrt(mean(self.sigma**2) / size), mean(self.time),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class _Models:
    """Models of the map's error over a track, and an unknown constant."""

    vectors: Array
    """(L, n, n) for each correlation length: eigenvectors of the correlation."""
    values: Array
    """(L, n) its eigenvalues."""
    prior: MapErrorPrior
    bias_variance: float

    @classmethod
    def of(cls, track: Track, field_map: FieldMap, prior: MapErrorPrior) -> "_Models":
        lat, lon = track.latitude, track.longitude
        apart = horizontal_difference(lat[:, None], lon[:, None], lat, lon)
        distance = np.hypot(apart[..., 0], apart[..., 1])
        correlation = np.exp(-distance / prior.length[:, None, None])
        values, vectors = np.linalg.eigh(correlation)
        bias = CONSTANTS.unknown_bias_share * field_scale(field_map)
        return cls(vectors, np.maximum(values, 0.0), prior, bias**2)

    def log_density(self, residual: Array, white: float) -> Array:
        """Return (S,) log density of residuals (n, S) with white noise of a variance, without the
        constant; -inf where one is NaN."""
        sigma = self.prior.sigma[:, None]
        weight = 1.0 / (sigma**2 * self.values[:, None] + white)  # (lengths, sigmas, n)
        of_bias = self.vectors.sum(axis=1)[:, None] * weight
        gain = 1.0 + self.bias_variance * (of_bias**2 / weight).sum(axis=2, keepdims=True)
        log_det = np.log(gain) - np.log(weight).sum(axis=2, keepdims=True)
        constant = self.prior.log_weight.T[..., None] - 0.5 * log_det
        of_bias *= np.sqrt(self.bias_variance / gain)
        turn = self.vectors.swapaxes(1, 2).reshape(-1, len(residual))
        total = np.full(residual.shape[1], -np.inf)
        # so many at once that what is computed of them stays in the processor's cache
        for part in np.array_split(np.arange(len(total)), -(-len(total) // _AT_ONCE)):
            on_map = part[np.isfinite(residual[:, part]).all(axis=0)]
            if not on_map.size:
                continue
            turned = (turn @ residual[:, on_map]).reshape(len(weight), len(residual), -1)
            square = weight @ turned**2 - (of_bias @ turned) ** 2
            log = (constant - 0.5 * square).reshape(-1, len(on_map))
            top = log.max(axis=0, initial=-np.inf)
            total[on_map] = np.log(np.exp(log - top).sum(axis=0)) + top
        return total

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


def look_elsewhere(
    aided: Sequence[Batch],
    unaided: Sequence[Batch],
    field_map: AnyMap,
    prior: MapErrorPrior,
    least: int = CONSTANTS.first_look_readings,
) -> Look | None:
    """Return where readings fit best; None where no other place could be much better, the track is
    not on the map, the readings are few, or they are of several channels.

    Parameters
    ----------
    aided : sequence of Batch
        Without what earlier ones have used; the last one's prior is the navigator's own.
    unaided : sequence of Batch
        The same for a navigator that has taken none of the fixes since the first batch: those of
        a navigator that is lost bend its track.
    field_map : FieldMap or ChannelMap
    prior : MapErrorPrior
    least : int
        Readings that are not too few.
    """
    every = Track.of(aided)
    several = aided[-1].channel is not None
    if several or len(every.level) < least:
        return None
    first = channels_of(field_map)[0]
    at_own = _Fit.of(every.grouped(CONSTANTS.look_groups), first, prior)
    own = _normal(CONSTANTS.look_own_points, aided[-1].prior[:2, :2])
    here = float(np.logaddexp.reduce(at_own.log_density(own, 0.0 * own))) - math.log(len(own))
    if not at_own.may_be_beaten(here):
        return None
    fit = _Fit.of(Track.of(unaided).grouped(CONSTANTS.look_groups), first, prior)
    if not fit.touches_map:
        return None
    places, drift, value = fit.best_places(unaided[0].prior[2:4, 2:4])
    lost = LOST_SIGMA[0]
    value = value - 0.5 * (places**2).sum(axis=1) / lost**2
    there = float(np.logaddexp.reduce(value))
    if not math.isfinite(there):
        return None
    cell = 2.0 * math.log(CONSTANTS.look_fine_cell_m / lost) - math.log(2.0 * math.pi)
    at_start = places - drift * fit.half
    return _found(at_start, np.exp(value - there), there + cell - here)


def evidence_at(
    tracks: tuple[Sequence[Batch], Sequence[Batch]],
    field_map: AnyMap,
    prior: MapErrorPrior,
    place: tuple[Array, Array],
) -> float:
    """Return by how much readings are more likely at a place than where the navigator believes to
    be, as a log Bayes factor.

    Parameters
    ----------
    tracks : pair of sequences of Batch
        `aided` and `unaided` of `look_elsewhere`.
    place : (2,) and (2, 2) arrays
        m and m²: error of the unaided navigator at the end of its track, if it is there.
    """
    aided, unaided = tracks
    first = channels_of(field_map)[0]
    own = _normal(CONSTANTS.look_own_points, aided[-1].prior[:2, :2])
    here = _Fit.of(Track.of(aided).grouped(CONSTANTS.look_groups), first, prior)
    there = _Fit.of(Track.of(unaided).grouped(CONSTANTS.look_groups), first, prior)
    spread = place[1] + CONSTANTS.look_bent_track_m**2 * np.eye(2)
    ends = place[0] + _normal(CONSTANTS.look_own_points, spread)
    drift = _normal(len(ends), unaided[0].prior[2:4, 2:4])[::-1]  # else they go together
    value = there.log_density(ends - drift * there.half, drift)
    own_value = here.log_density(own, 0.0 * own)
    return float(np.logaddexp.reduce(value) - np.logaddexp.reduce(own_value))


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
    def half(self) -> float:
        """Half of the time that the track takes, s."""
        return 0.5 * float(self.track.time[-1] - self.track.time[0])

    @property
    def touches_map(self) -> bool:
        """Whether some of the track is on the map where it is believed to be."""
        values = self.field_map.value(self.track.latitude, self.track.longitude)
        return bool(np.isfinite(values).any())

    def log_density(self, place: Array, drift: Array, blur: float = 0.0) -> Array:
        """Return (S,) log density of the readings for errors (S, 2) in m in the middle of the
        track and their rate (S, 2) in m/s, with a further white noise."""
        track = self.track
        north, east = metres_per_radian(track.latitude)
        radian = np.stack([1.0 / north, 1.0 / east], axis=-1)
        since = track.time - 0.5 * (track.time[0] + track.time[-1])
        residual = _residuals(
            self.field_map.grid, track.latitude, track.longitude, radian, track.level, since,
            np.ascontiguousarray(place), np.ascontiguousarray(drift),
        )  # fmt: skip
        return self.models.log_density(residual, self.white + blur**2)

    def may_be_beaten(self, here: float) -> bool:
        """Whether some place could be so much better than the navigator's own that it counts."""
        least = 2.0 * math.log(LOST_SIGMA[0] / CONSTANTS.look_fine_cell_m)
        possible = self.models.best_possible(self.white, len(self.track.level)) - least
        return math.isfinite(here) and possible - here > CONSTANTS.look_log_evidence

    def best_places(self, velocity: Array) -> tuple[Array, Array, Array]:
        """Return errors (K, 2) in the middle of the track, their rates (K, 2) by a covariance
        (2, 2) in m²/s², and log densities (K,) of the readings, around the best cells of all."""
        cell, fine = CONSTANTS.look_cell_m, CONSTANTS.look_fine_cell_m
        coarse = _square(np.arange(-CONSTANTS.look_reach_m, CONSTANTS.look_reach_m + 1.0, cell))
        bend = self.half / math.sqrt(3.0) * math.sqrt(0.5 * float(np.trace(velocity)))
        blur = self._slope() * math.hypot(cell / math.sqrt(12.0), bend)
        value = self.log_density(coarse, np.zeros_like(coarse), blur)
        best = np.argsort(-value, kind="stable")[: CONSTANTS.look_best_cells]
        inside = _square(np.arange(-0.5 * (cell - fine), 0.5 * cell, fine))
        places = (coarse[best][:, None] + inside).reshape(-1, 2)
        drift = _normal(len(places), velocity)
        return places, drift, self.log_density(places, drift)

    def _slope(self) -> float:
        """Return the RMS gradient of the map along the track, unit per m, of one component."""
        lat, lon = self.track.latitude, self.track.longitude
        _, by_lat, by_lon = self.field_map.value_and_gradient(lat, lon)
        north, east = metres_per_radian(lat)
        return math.sqrt(0.5 * float(np.nanmean((by_lat / north) ** 2 + (by_lon / east) ** 2)))


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


@kernel(error_model="numpy")
def _residuals(  # type: ignore[no-untyped-def]
    grid, latitude, longitude, radian, level, since, place, drift
):
    """Return (n, S) readings less the map where a navigator with errors (S, 2) in m and m/s would
    be."""
    samples, rows = place.shape[0], latitude.shape[0]
    out = np.empty((rows, samples))
    lat, lon = np.empty(samples), np.empty(samples)
    row, column = np.empty(samples, np.int64), np.empty(samples, np.int64)
    for t in range(rows):
        for s in range(samples):
            north = place[s, 0] + drift[s, 0] * since[t]
            east = place[s, 1] + drift[s, 1] * since[t]
            lat[s] = latitude[t] - north * radian[t, 0]
            lon[s] = longitude[t] - east * radian[t, 1]
        there = out[t]
        look_up(grid, lat, lon, 0, row, column, there)
        for s in range(samples):
            there[s] = level[t] - there[s]
    return out
