"""The readings of the last hour as one track of a navigator that may be lost, and what its own
error does to them.

What a navigator's error is at a reading follows from what it is in the middle of the track by its
linear dynamics (docs/mathematics.md, section 4.2): a wrong place moves it as a whole; velocity and
tilt bend it, and put the Eötvös effect of a wrong velocity into readings of gravity. A wrong
latitude tilts the navigator as time goes by (section 8.7).
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import LOST_COVARIANCE, Batch
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.map_error import MapErrorPrior
from isogal.matching.pmht.past_batches import Effects, PastBatch, effects_of, without_fixes
from isogal.matrices import square_root, symmetric


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
    position: Array
    """(N, 2, 7) position error (m) at each per unit of the navigator's error in the middle."""
    reading: Array
    """(N, 7) what of that is in each reading."""
    root: Array
    """(N, K) what else of the navigator's errors is in the readings, per unit-variance component
    of K."""

    @classmethod
    def of(cls, parts: Sequence[tuple[Batch, Array, Array, Array]]) -> "Track":
        """Return the readings that there are in batches, each with what the navigator's errors do
        to it, one after the other."""
        rows = [
            np.stack([one.latitude, one.longitude, one.reading - one.offset, one.sigma])
            for one, *_ in parts
        ]
        every = np.concatenate(rows, axis=1)
        known = np.isfinite(every[2])
        effects = [np.concatenate([one[i] for one in parts])[known] for i in (1, 2, 3)]
        return cls(*every[:, known], *effects)

    def grouped(self, most: int) -> "Track":
        """Return means of equally many readings, so many at most."""
        size = -(-len(self.level) // most)
        count = len(self.level) // size

        def mean(values: Array) -> Array:
            cut = values[-count * size :]
            return np.asarray(cut.reshape(count, size, *values.shape[1:]).mean(axis=1))

        means = {one.name: mean(getattr(self, one.name)) for one in fields(self)}
        means["sigma"] = np.sqrt(mean(self.sigma**2) / size)
        return Track(**means)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What one field has read."""

    aided: Track
    """Of the navigator as it is."""
    unaided: Track
    """The same of one that has taken none of the fixes since the first batch: those of a navigator
    that is lost bend its track."""
    field_map: FieldMap
    prior: MapErrorPrior


@dataclass(frozen=True, slots=True, eq=False)
class LostError:
    """The error of an unaided navigator in the middle of its track, if it is lost: of its place p
    (m), the others are gain p + root e with e ~ N(0, 1)."""

    gain: Array
    """(5, 2)."""
    root: Array
    """(5, 5)."""
    first: Array
    """(7, 7) the error at the end of the first batch per unit of error in the middle."""
    last: Array
    """(7, 7) at the end of the last."""

    @classmethod
    def of(cls, prior: Array, first: Array, last: Array) -> "LostError":
        """Return it for what the navigator says of its error at the end of the first batch, a
        covariance (7, 7); `first` and `last` as above."""
        wide = prior + LOST_COVARIANCE
        to_middle = np.linalg.inv(first)
        covariance = to_middle @ wide @ to_middle.T
        gain = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
        rest = covariance[2:, 2:] - gain @ covariance[:2, 2:]
        return cls(gain, square_root(rest), first, last)

    def whole(self, place: Array, drawn: Array) -> Array:
        """Return errors (S, 7) of places (S, 2) and components (S, 5)."""
        return np.concatenate([place, place @ self.gain.T + drawn @ self.root.T], axis=1)

    def with_end(self, end: Array, drawn: Array) -> Array:
        """Return errors (S, 7) whose places at the end of the track are (S, 2)."""
        by_place = self.last[:2, :2] + self.last[:2, 2:] @ self.gain
        left = end - drawn @ (self.last[:2, 2:] @ self.root).T
        return self.whole(np.asarray(np.linalg.solve(by_place, left.T).T), drawn)


@dataclass(frozen=True, slots=True, eq=False)
class LastHour:
    """What a look is given."""

    seen: tuple[Seen, ...]
    """Of each field."""
    own: Array
    """(2, 2) m², by how much the readings may be displaced at the end where the navigator is
    right: its own covariance, and the way it makes in the delay that readings may have."""
    lost: LostError

    @classmethod
    def of(
        cls, history: Sequence[PastBatch], maps: dict[int | None, tuple[FieldMap, MapErrorPrior]]
    ) -> "LastHour":
        """Return the readings in past batches.

        Parameters
        ----------
        history : sequence of PastBatch
            With attitude.
        maps : dict
            Of each field its map and what was believed of the map's error before any reading; None
            is the field of the batches themselves, others are those beside them.
        """
        dynamics = _Dynamics.of(history)
        prior = history[0].prior
        lost = LostError.of(prior, dynamics.since_middle[0], dynamics.since_middle[-1])
        at_middle = np.concatenate([np.zeros((2, BATCH_STATES - 2)), lost.root])
        aided, unaided = dynamics.errors(aided=True), dynamics.errors(aided=False)
        unaided = [
            np.concatenate([to @ at_middle, one], axis=1)
            for to, one in zip(dynamics.since_middle, unaided, strict=True)
        ]
        made = []
        for field, (field_map, map_error) in maps.items():
            tracks = (
                _aided_track(history, field, aided, field_map),
                _unaided_track(history, field, dynamics, unaided),
            )
            made.append(Seen(*tracks, field_map, map_error))
        return cls(tuple(made), _own(history[-1].batch), lost)

    @classmethod
    def of_batch(cls, batch: Batch, field_map: FieldMap, map_error: MapErrorPrior) -> "LastHour":
        """Return the readings of one batch alone, of one field."""
        known, whole = joint_prior(batch), np.zeros((BATCH_STATES, BATCH_STATES))
        whole[: len(known), : len(known)] = known
        lost = LostError.of(whole, np.eye(BATCH_STATES), np.eye(BATCH_STATES))
        own = square_root(whole)
        effects = at_rows, in_reading = effects_of(batch)
        root = in_reading[:, 2:] @ lost.root
        slope = _slopes(field_map, batch.latitude, batch.longitude)
        aided = Track.of([_aided(batch, effects, own, own, slope)])
        unaided = Track.of([(batch, at_rows, in_reading, root)])
        seen = Seen(aided, unaided, field_map, map_error)
        return cls((seen,), _own(batch), lost)


def _own(batch: Batch) -> Array:
    late = batch.delay_sigma * batch.velocity[-1]
    return np.asarray(batch.prior[:2, :2] + np.outer(late, late))


def _aided_track(
    history: Sequence[PastBatch], field: int | None, errors: Sequence[Array], field_map: FieldMap
) -> Track:
    """Return the track of the navigator as it is."""
    read = [(past, past.new_of(field), by) for past, by in zip(history, errors, strict=True)]
    parts = [(one, past.effects[field], by) for past, one, by in read if one is not None]
    places = [(one.latitude, one.longitude) for one, *_ in parts]
    slopes = _slopes(field_map, *(np.concatenate(each) for each in zip(*places, strict=True)))
    ends = np.cumsum([len(one) for one, *_ in parts])[:-1]
    return Track.of(
        [
            _aided(one, effects, by, errors[-1], slope)
            for (one, effects, by), slope in zip(parts, np.split(slopes, ends), strict=True)
        ]
    )


def _slopes(field_map: FieldMap, latitude: Array, longitude: Array) -> Array:
    """Return (N, 2) the map's derivative north and east per m; 0 where it has none."""
    _, *slope = field_map.value_and_gradient(latitude, longitude)
    return np.nan_to_num(np.stack(slope, axis=-1))


def _aided(
    batch: Batch, effects: Effects, errors: Array, at_end: Array, slope: Array
) -> tuple[Batch, Array, Array, Array]:
    """Return a batch of the navigator as it is, as `Track.of` takes it: its error (7, K) at the
    end of the track stands for that in the middle, and what it was before is linearised by the
    map's `_slopes`."""
    at_rows, in_reading = effects
    moved = at_rows @ errors - at_end[:2]
    root = in_reading @ errors - (slope[:, None] @ moved)[:, 0]
    still = np.zeros_like(at_rows)
    still[:, 0, 0] = still[:, 1, 1] = 1.0
    return batch, still, np.zeros_like(in_reading), root


def _unaided_track(
    history: Sequence[PastBatch],
    field: int | None,
    dynamics: "_Dynamics",
    errors: Sequence[Array],
) -> Track:
    """Return the track of a navigator that has taken none of the fixes."""
    parts = []
    for k, one in enumerate(without_fixes(history, field)):
        if one is not None:
            at_rows, in_reading = history[k].effects[field]
            to_middle = dynamics.since_middle[k]
            root = in_reading @ errors[k]
            parts.append((one, at_rows @ to_middle, in_reading @ to_middle, root))
    return Track.of(parts)


@dataclass(frozen=True, slots=True, eq=False)
class _Dynamics:
    """How the navigator's error goes on from batch to batch."""

    history: Sequence[PastBatch]
    since_middle: tuple[Array, ...]
    """(7, 7) error at each batch end per unit of that at the end of the one in the middle."""

    @classmethod
    def of(cls, history: Sequence[PastBatch]) -> "_Dynamics":
        since = [np.eye(BATCH_STATES)]
        for past in history[1:]:
            since.append(past.forward @ since[-1])
        to_first = np.linalg.inv(since[len(since) // 2])
        return cls(history, tuple(one @ to_first for one in since))

    def errors(self, aided: bool) -> list[Array]:
        """Return of each batch end the error (7, K) per unit-variance component of K: of the
        navigator with its fixes, each of which takes a part of it away; or of one without them,
        what its sensors have added since the first."""
        priors = np.stack([past.prior for past in self.history])
        start = square_root(priors[0]) if aided else np.zeros((BATCH_STATES, 0))
        forward = np.stack([past.forward for past in self.history[1:]] or [priors[0]])
        after = np.stack([past.posterior[1] for past in self.history])
        before, after, priors = priors[:-1], after[:-1], priors[1:]
        forward, scale = forward[: len(before)], np.sqrt(np.diagonal(priors, axis1=1, axis2=2))
        left, kept = forward, forward @ after
        if aided:
            left = forward @ np.linalg.solve(before, after).swapaxes(1, 2)
            kept = left @ before
        grown = symmetric(priors - kept @ left.swapaxes(1, 2))
        # a root of its positive part (`matrices.positive_part`), of all batches at once
        values, vectors = np.linalg.eigh(grown / scale[:, None] / scale[:, :, None])
        root = scale[:, :, None] * vectors * np.sqrt(np.maximum(values, 0.0))[:, None]
        sources, steps = [start, *root], [np.eye(BATCH_STATES), *left]
        width = [one.shape[1] for one in sources]
        total, every, column = np.zeros((BATCH_STATES, sum(width))), [], 0
        for step, source, count in zip(steps, sources, width, strict=True):
            total = step @ total
            total[:, column : column + count] = source
            column += count
            every.append(total.copy())
        return every
