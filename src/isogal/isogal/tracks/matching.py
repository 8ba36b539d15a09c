"""Matching a recorded track against a map, batch by batch (docs/mathematics.md, sections 10.1 to
10.3).

No inertial navigator comes with a recorded track to say how wrong it is. Its error at the end of
each batch is therefore assumed: a position error with the 1-sigma of `Uncertainty`, and a small
velocity error, constant over the batch. The shape of the track within a batch is taken as right.
Batches can be matched in two ways:

- independently (default): the track stays as recorded, and each batch starts from the same prior.
  The fixes hold the information of the measurements alone, so any filter may use them, one by one,
  whatever it has done with the earlier ones.
- chained: what a batch has told moves the track and narrows the prior of the next, as for an aided
  navigator. The fixes still hold the information of the measurements alone; `Match.error` and
  `Match.covariance` combine all batches so far.

Several fields along one track have one error, so that their batches are matched together, each
field with a noise of its own.

No reading counts twice: the rows that a matcher gets as context are conditioned on, and the
information of an ambiguous batch, which is carried on as hypotheses, is published with the batch
that resolves it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.tiled_map import ScalarMap
from isogal.matching.failures import match_or_decline
from isogal.matching.information import informed, position_information
from isogal.matching.interfaces import Batch, Fix, Matcher
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.bank import TrackMatcher
from isogal.tracks.fields import TrackField, batch_ends, check_fields, joint_batch, matcher_of
from isogal.tracks.informative import judged
from isogal.tracks.places import Shifts
from isogal.tracks.track import FEWEST, Track, enough_readings

Progress = Callable[[int, int], None]
"""Called with how many batches are done, and how many there are."""
_LONGEST = 4
"""Batches that an unresolved one may grow to: its readings are matched again with the next."""
MOST_SHIFTS = 6
"""Batches of a track whose `Match.shifts` are kept, for display: each has some 20 MB."""
_LEAST_VELOCITY = 1e-6
"""m/s, least 1-sigma of the velocity: matchers need a prior that is positive definite."""


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """1-sigma per axis of the track's error."""

    position: float = 1000.0
    """m, at the first batch's end; at every batch's end unless batches are chained."""
    velocity: float = 0.0
    """m/s, constant over a batch (over the track where batches are chained)."""
    walk: float = 0.0
    """m per square root of an hour, random walk of the position error from batch to batch; counts
    only where they are chained."""

    @property
    def prior(self) -> Array:
        """(4, 4) covariance of the error (north, east, v_north, v_east) at a batch's end."""
        position, velocity = self.position**2, max(self.velocity, _LEAST_VELOCITY) ** 2
        return np.diag([position, position, velocity, velocity])


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """Result of one batch of a track."""

    fix: Fix
    """From the measurements of the batch alone; declined where they say less of the place than the
    prior, or contradict it."""
    rows: slice
    """The new readings of the batch, indices into the track."""
    error: Array
    """(4,) estimate of the track's error at the batch end (north, east m; m/s) from prior and fix;
    chained: from prior and all fixes so far."""
    covariance: Array
    """(4, 4) covariance of `error`."""
    position: tuple[float, float]
    """Latitude and longitude (rad) of the recorded track at the batch end less its `error`."""
    chained: bool = False
    """Whether the batch started from what the earlier ones had found."""
    shifts: Shifts | None = None
    """Posterior of the batch's shift, where `pmht` has matched it; of the first `MOST_SHIFTS` of
    these batches only."""


def match_track(
    track: Track,
    field_map: ScalarMap,
    settings: MatcherSettings,
    uncertainty: Uncertainty,
    *,
    chained: bool = False,
    matcher: Matcher | None = None,
) -> list[Match]:
    """Match all batches of a track, whose readings are in the map's unit (`fit_to_map`); see
    `match_fields`."""
    field = TrackField(field_map.quantity, track, field_map, settings)
    return match_fields([field], uncertainty, chained=chained, matcher=matcher)


def match_fields(
    fields: Sequence[TrackField],
    uncertainty: Uncertainty,
    *,
    chained: bool = False,
    matcher: Matcher | None = None,
    progress: Progress = lambda done, count: None,
) -> list[Match]:
    """Match all batches of a track that has readings of one or several fields, or of several
    channels. The batches are those that the first field's settings say.

    Parameters
    ----------
    chained : bool
        Whether each batch starts from what the earlier ones have told.
    matcher : Matcher, optional
        Instead of the one that the settings name.
    progress : callable
        Called after each batch with how many are done and how many there are.

    Raises
    ------
    InputError
        There are fewer than three readings, the matcher's options are wrong, the track's reduction
        does not fit the quantity, or fields are not of one track (`fields.check_fields`).
    """
    matching = matcher or matcher_of(fields)
    track, settings, ends = fields[0].track, fields[0].settings, _batch_ends(fields)
    by_bank = isinstance(matching, TrackMatcher)
    earlier = matching.context + settings.batch_length - (settings.stride or settings.batch_length)
    prior, memory, unresolved = uncertainty.prior, None, 0
    matches: list[Match] = []
    for end in ends:
        previous = matches[-1].rows.stop if matches else 0
        used = unresolved if by_bank else previous
        error, covariance = np.zeros(4), prior
        if chained and matches:
            elapsed = track.time[end - 1] - track.time[previous - 1]
            error, covariance = _advance(matches[-1], elapsed, uncertainty)
        known = slice(max(0, used - earlier), end), end - used, error, covariance
        batch, near = joint_batch(fields, *known, edge=not by_bank)
        fix, after = match_or_decline(matching, batch, near, memory)
        fix, counted = judged(fix, batch, prior)
        error, covariance = _known(counted, batch, error, covariance)
        (latitude,), (longitude,) = track.moved(slice(end - 1, end), error)
        shifts = after if isinstance(after, Shifts) and after is not memory else None
        if sum(one.shifts is not None for one in matches) == MOST_SHIFTS:
            shifts = None
        place = float(latitude), float(longitude)
        new = slice(previous, end)
        matches.append(Match(fix, new, error, covariance, place, chained, shifts))
        resolved = (counted if chained else fix).published
        if resolved or end - unresolved >= _LONGEST * settings.batch_length:
            unresolved = end
        memory = after
        progress(len(matches), len(ends))
    return matches


def _batch_ends(fields: Sequence[TrackField]) -> list[int]:
    """Return where batches end; raises InputError where there can be none (`match_fields`)."""
    check_fields(fields)
    track, settings = fields[0].track, fields[0].settings
    enough_readings(track)
    if settings.batch_length < FEWEST:
        raise InputError(
            f"matcher.batch_length (--batch-length): must be at least {FEWEST} on a recorded track"
        )
    return batch_ends(len(track), settings)


def _known(fix: Fix, batch: Batch, error: Array, covariance: Array) -> tuple[Array, Array]:
    """Return the track's error (4,) and its covariance (4, 4) after a fix of a batch, which says
    it of the error that remains."""
    if not fix.published:
        return error, covariance
    told = fix.information or position_information(
        batch, fix.latitude, fix.longitude, fix.covariance
    )
    remaining, covariance = informed(covariance, told)
    return error + remaining, covariance


def _advance(last: Match, dt: float, uncertainty: Uncertainty) -> tuple[Array, Array]:
    """Return the track's error and its covariance dt (s) after the end of a batch: the velocity
    error is constant, and the position error walks randomly."""
    transition = np.eye(4)
    transition[:2, 2:] = dt * np.eye(2)
    walk = uncertainty.walk**2 * dt / 3600.0
    grown = transition @ last.covariance @ transition.T + np.diag([walk, walk, 0.0, 0.0])
    return transition @ last.error, grown
