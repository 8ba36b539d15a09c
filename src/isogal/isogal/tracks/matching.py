"""Matching a recorded track against a map, batch by batch.

A recorded track has no inertial navigator behind it that could be asked how wrong it is: its error
at the end of each batch is a position error with the 1-sigma of `Uncertainty` and a constant
velocity error with a small one, and the shape of the track within a batch is taken as right. Two
ways to go from batch to batch:

- independent (default): the track stays as recorded and every batch meets the same prior. The
  fixes are the measurements' own, so they may be fed to any filter, one by one, whatever it has
  done with the earlier ones. A matcher that finds the track lost widens the prior from there on.
- chained: what a batch has told moves the track and narrows the prior of the next, as for a
  navigator that is aided. The fixes are still the measurements' own; `Match.error` and
  `Match.covariance` hold what all batches so far say together.

Readings never count twice: a matcher's context rows are conditioned on, and the batches that it
keeps to itself (an ambiguous one goes on as hypotheses) are published with the batch that resolves
them."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import LOST_COVARIANCE, Batch, Fix, Matcher, declined
from isogal.matching.pmht.lost_navigator import Doubting
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.memory import Memory
from isogal.matching.pmht.robust import confirmed, widened
from isogal.matching.registry import build_matcher
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.track import Track

FEWEST_IN_BATCH = 4
"""Scans that the incomplete last batch needs to be matched."""
_EDGE_REACH = ((2.0, 2.0 / 3.0), (1.0, 0.5))
"""Prior 1-sigmas round a reading that the map should cover, and the share of readings that must be
left for that."""
_EMPTY = 5.0
"""Prior 1-sigmas from which on a fix is none: it would narrow no direction by more than 2 %."""
_LOST = LOST_COVARIANCE[:4, :4]
_LEAST_VELOCITY = 1e-6
"""m/s; matchers need a prior that is positive definite."""


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """1-sigma per axis of the track's error.

    Raises
    ------
    InputError
        Not finite, position not positive, or others negative.
    """

    position: float = 1000.0
    """m, at the first batch's end; at every batch's end unless batches are chained."""
    velocity: float = 0.0
    """m/s, constant over a batch (over the track where batches are chained)."""
    walk: float = 0.0
    """m per square root of an hour, random walk of the position error from batch to batch; counts
    only where they are chained."""

    def __post_init__(self) -> None:
        for name, least in (("position", "> 0"), ("velocity", ">= 0"), ("walk", ">= 0")):
            value = getattr(self, name)
            if not math.isfinite(value) or value < 0.0 or (least == "> 0" and value == 0.0):
                raise InputError(
                    f"1-sigma of the track's {name} error must be {least}, is {value}"
                )

    @property
    def prior(self) -> Array:
        """(4, 4) covariance of the error (north, east, v_north, v_east) at a batch's end."""
        position, velocity = self.position**2, max(self.velocity, _LEAST_VELOCITY) ** 2
        return np.diag([position, position, velocity, velocity])


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """What one batch of a track gave."""

    fix: Fix
    """From the measurements of the batch alone."""
    rows: slice
    """The new readings of the batch, indices into the track."""
    error: Array
    """(4,) the track's error at the batch end (north, east m; m/s), according to prior and fix;
    chained: all fixes so far."""
    covariance: Array
    """(4, 4) of it."""
    latitude: float
    """rad, the recorded track at the batch end."""
    longitude: float
    """rad."""

    @property
    def position(self) -> tuple[float, float]:
        """Latitude and longitude (rad) of the recorded track less its `error`."""
        north, east = metres_per_radian(self.latitude)
        return float(self.latitude - self.error[0] / north), float(
            self.longitude - self.error[1] / east
        )


def batch_ends(count: int, settings: MatcherSettings) -> list[int]:
    """Return after how many readings each batch ends; the last may be incomplete, if it has
    `FEWEST_IN_BATCH` new readings."""
    ends = list(range(settings.batch_length, count + 1, settings.scans_between_fixes))
    if count - (ends[-1] if ends else 0) >= FEWEST_IN_BATCH or not ends:
        ends.append(count)
    return ends


def match_track(
    track: Track,
    field_map: FieldMap,
    settings: MatcherSettings,
    uncertainty: Uncertainty,
    *,
    chained: bool = False,
    matcher: Matcher | None = None,
    checked: bool = True,
) -> list[Match]:
    """Match all batches of a track.

    Parameters
    ----------
    track : Track
        Readings in the map's unit (see `fit_to_map`).
    field_map : FieldMap
    settings : scenario.Matcher
    uncertainty : Uncertainty
    chained : bool
        See the module.
    matcher : Matcher, optional
        Default: the one that the settings name.
    checked : bool
        Whether fixes of `pmht` are looked at twice (`robust`); False = its likelihood alone
        counts, for studies.

    Raises
    ------
    InputError
        The matcher's options are wrong, or readings of this quantity are not reduced with a
        latitude.
    """
    matching = matcher or build_matcher(settings)
    if isinstance(matching, Doubting):
        matching = matching.first  # a track of positions has no attitude to go back with
    jacobian = track.jacobian(field_map.quantity)
    prior = uncertainty.prior
    error, covariance = np.zeros(4), prior
    memory = None
    matches: list[Match] = []
    previous = 0
    for end in batch_ends(len(track), settings):
        if chained and previous:
            error, covariance = _advance(
                error, covariance, track.time[end - 1] - track.time[previous - 1], uncertainty
            )
        elif not chained:
            error, covariance = np.zeros(4), prior
        overlap = settings.batch_length - settings.scans_between_fixes
        rows = slice(max(0, previous - overlap - matching.context), end)
        batch = build_batch(track, jacobian, rows, end - previous, error, covariance)
        batch = without_map_edge(batch, field_map)
        before = memory
        fix, memory = matching.match(batch, field_map, before)
        if checked and isinstance(matching, Pmht) and memory is not None:
            fix, memory = _scrutinised(fix, memory, before, batch, field_map, matching)
        fix = _unless_empty(fix, batch)
        error, covariance = update(batch, fix, error, covariance)
        if fix.reset:
            prior = uncertainty.prior + _LOST
        matches.append(
            Match(
                fix=fix,
                rows=slice(previous, end),
                error=error,
                covariance=covariance,
                latitude=float(track.latitude[end - 1]),
                longitude=float(track.longitude[end - 1]),
            )
        )
        previous = end
    return matches


def _scrutinised(
    fix: Fix,
    after: Memory,
    before: Memory | None,
    batch: Batch,
    field_map: FieldMap,
    matcher: Pmht,
) -> tuple[Fix, Memory]:
    """Return fix and memory as `robust` lets them pass."""
    if fix.published:
        fix, after = confirmed(fix, after, before, batch, field_map, matcher)
    if fix.published:
        mean, covariance = update(batch, fix, np.zeros(4), batch.prior)
        fix = widened(fix, after, batch, field_map, matcher, mean, covariance)
    return fix, after


def _unless_empty(fix: Fix, batch: Batch) -> Fix:
    """Return the fix unless it is far less certain than the prior in every direction: then that is
    why there is none."""
    if not fix.published:
        return fix
    known = math.sqrt(float(np.linalg.eigvalsh(batch.prior[:2, :2])[-1]))
    least = math.sqrt(float(np.linalg.eigvalsh(fix.covariance)[0]))
    if least < _EMPTY * known:
        return fix
    reason = (
        f"tells next to nothing: 1-sigma of {least / 1e3:.0f} km and more, where {known / 1e3:.3g}"
        " km were known"
    )
    return replace(declined(batch, reason, **fix.diagnostics), reset=fix.reset)


def build_batch(
    track: Track, jacobian: Array, rows: slice, new: int, error: Array, covariance: Array
) -> Batch:
    """Return rows of a track as a batch, moved by the error (4,) known so far at its last row,
    with that error's covariance (4, 4)."""
    time = track.time[rows]
    transition = np.zeros((time.size, 2, 4))
    transition[:, 0, 0] = transition[:, 1, 1] = 1.0
    transition[:, 0, 2] = transition[:, 1, 3] = time - time[-1]
    to_end = np.zeros((time.size, 4, 4))
    to_end[:, :2] = transition
    to_end[:, 2, 2] = to_end[:, 3, 3] = 1.0
    by_error = np.einsum("ti,tij->tj", jacobian[rows], to_end)
    north, east = metres_per_radian(track.latitude[rows])
    moved = transition @ error
    return Batch(
        time=time,
        latitude=track.latitude[rows] - moved[:, 0] / north,
        longitude=track.longitude[rows] - moved[:, 1] / east,
        velocity=track.velocity[rows] - error[2:],
        reading=track.value[rows] - by_error @ error,
        sigma=track.sigma[rows],
        offset=track.offset[rows],
        transition=transition,
        reading_jacobian=by_error,
        nuisance_position=np.zeros((time.size, 2, 0)),
        nuisance_reading=np.zeros((time.size, 0)),
        prior=covariance,
        new=min(new, time.size),
    )


def without_map_edge(batch: Batch, field_map: FieldMap) -> Batch:
    """Return the batch without the readings near which the map ends.

    A place off the map cannot be judged, and matchers take it as impossible: a reading whose true
    place may lie off the map would push the fix away from there. So readings without map all round
    them as far as the prior reaches are left out, as long as enough are left: two thirds of them
    for two 1-sigmas, half for one. Beyond that, those are used that have a map value themselves.
    """
    sigma = math.sqrt(float(np.linalg.eigvalsh(batch.prior[:2, :2])[-1]))
    new = np.arange(len(batch)) >= len(batch) - batch.new
    has = np.isfinite(batch.reading) & field_map.covers(batch.latitude, batch.longitude)
    north, east = metres_per_radian(batch.latitude)
    keep = has
    angle = np.arange(16)[:, None] * (np.pi / 8.0)
    for reach, share in _EDGE_REACH:
        inside = has.copy()
        for part in (0.5, 1.0):
            latitude = batch.latitude + part * reach * sigma * np.cos(angle) / north
            longitude = batch.longitude + part * reach * sigma * np.sin(angle) / east
            inside &= field_map.covers(latitude, longitude).all(axis=0)
        if (inside & new).sum() >= max(share * (has & new).sum(), FEWEST_IN_BATCH):
            keep = inside
            break
    return replace(batch, reading=np.where(keep, batch.reading, np.nan))


def update(batch: Batch, fix: Fix, error: Array, covariance: Array) -> tuple[Array, Array]:
    """Return the track's error and its covariance after a fix; where it was declined the error
    stays, and so does the covariance unless the matcher found the track lost."""
    if fix.reset:
        covariance = covariance + _LOST
    if not fix.published:
        return error, covariance
    if fix.information is not None:
        vector, matrix = fix.information.vector, fix.information.matrix
    else:
        seen = -horizontal_difference(
            fix.latitude, fix.longitude, batch.latitude[-1], batch.longitude[-1]
        )
        vector, matrix = np.zeros(4), np.zeros((4, 4))
        matrix[:2, :2] = np.linalg.inv(fix.covariance)
        vector[:2] = matrix[:2, :2] @ seen
    # (P⁻¹ + M)⁻¹ without inverting P, whose velocity part may be tiny
    gain = np.linalg.solve(np.eye(4) + covariance @ matrix, covariance)
    return error + gain @ vector, 0.5 * (gain + gain.T)


def _advance(
    error: Array, covariance: Array, dt: float, uncertainty: Uncertainty
) -> tuple[Array, Array]:
    """Carry the track's error on by dt (s) with a constant velocity error and a random walk of the
    position."""
    transition = np.eye(4)
    transition[:2, 2:] = dt * np.eye(2)
    walk = uncertainty.walk**2 * dt / 3600.0
    return transition @ error, transition @ covariance @ transition.T + np.diag(
        [walk, walk, 0.0, 0.0]
    )
