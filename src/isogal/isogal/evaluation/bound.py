"""Posterior Cramér–Rao bound of the aided navigator (docs/mathematics.md, section 11.1).

Along one true trajectory the bound's information recursion (Tichavský, Muravchik, Nehorai, IEEE
Trans. Signal Processing 46(5), 1998; Taylor 1979 for a given trajectory) is the Riccati recursion
of the navigator's linear error model, with the measurement matrix taken at the truth. A reading
compares the map at the navigator's position with the field at the true one, so it depends on the
position error by the map's gradient, on velocity and latitude errors by the reductions, on the
map's own error and on white noise. The map's error, a field with covariance sigma² exp(-d / L), is
along the track a first-order Gauss-Markov process, which adds a state. The sensor's bias and its
drift add two more, its noise that is correlated in time, its cross-coupling and its low-pass
filter others where it has them (`reading_errors`). What the filter has as auxiliary states
(residual gravity, sensor errors that change) are states here, too. Each of several fields has
states of its own beside the navigator's, and its own scans.

A reading of several channels is turned by the eigenvectors of its noise's covariance into as many
channels with independent noise. Map errors of the channels, independent and equal in sigma and L,
remain so, and each channel has its own state; those of one potential are turned, too, and go on
from scan to scan together (`reading_errors.map_steps`). Channels are taken one after the other.

The vertical accelerometer is left out: with the height known it could measure the east velocity by
the Eötvös term, but only if gravity along the route were known to the precision of the
accelerometer (docs/mathematics.md, section 3.7)."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array, Integers
from isogal.evaluation.ins_error_model import (
    Segments,
    divide,
    initial_covariance,
    transitions,
)
from isogal.evaluation.reading_errors import (
    MapSteps,
    SlowError,
    beam_channels,
    effective_noise,
    effective_noise_variance,
    gradiometer_errors,
    gravimeter_errors,
    map_errors,
    map_steps,
)
from isogal.fields.known_gravity import true_residual_gravity
from isogal.fields.measured import measured_field
from isogal.fields.simulator import recorded, scan_index
from isogal.fusion.assumed import filter_model
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements import reading_of
from isogal.fusion.measurements.height import by_auxiliary
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_model import STATES
from isogal.inertial.error_state import FILTER_STATES, Estimate
from isogal.inertial.rotations import from_matrix
from isogal.maps.channels import RouteMap, channels_of
from isogal.maps.several import RunMap, each_map
from isogal.maps.tiled_map import ScalarMap
from isogal.scenario import (
    AnyAid,
    Gnss,
    Gravimeter,
    HeadingAid,
    Imu,
    MapError,
    PositionAid,
    Truth,
    Velocity,
)
from isogal.sensors.gravimeter_errors import without_readings
from isogal.sensors.lag import SETTLING, Lag
from isogal.sensors.position_aid import within
from isogal.sensors.reduction import Reduction, State
from isogal.sensors.trajectory import Trajectory

_OF_FILTER = [*range(2), 3, 4, *range(6, FILTER_STATES)]
"""The linear model's states among the filter's: without height and vertical velocity."""


@dataclass(frozen=True, slots=True, eq=False)
class BoundResult:
    """Smallest error covariance that an unbiased navigator can have, at the start and right after
    each scan (K = scans + 1)."""

    time: Array
    """(K,) s."""
    covariance: Array
    """(K, 2, 2) m², north and east."""
    smoothed: Array | None = None
    """(K, 2, 2) m², of one that knows all readings of the voyage, those after a time as well; None
    = not asked for."""

    @property
    def rms(self) -> Array:
        """(K,) m, RMS horizontal error: square root of the covariance's trace."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))

    def rms_at(self, time: Array) -> Array:
        """Return the RMS horizontal error (m) at any times (s): linear between scans, NaN before
        the start and after the last scan."""
        return np.interp(time, self.time, self.rms, left=np.nan, right=np.nan)

    def smoothed_rms_at(self, time: Array) -> Array:
        """Return the same of one that knows all readings; NaN where it was not asked for."""
        if self.smoothed is None:
            return np.full(np.shape(time), np.nan)
        return BoundResult(self.time, self.smoothed).rms_at(time)


@dataclass(frozen=True, slots=True, eq=False)
class Measurements:
    """What one sensor measures, M times, in C channels with independent noise."""

    rows: Array
    """(M, C, n) derivatives by the states; a row with a NaN tells nothing."""
    noise: Array
    """(C,) variances."""
    every: int
    """Stretches from one measurement to the next."""

    def at(self, stretch: int) -> Iterator[tuple[Array, float]]:
        """Yield rows (n,) and variances of what is measured at the end of a stretch, counted from
        1."""
        own, rest = divmod(stretch, self.every)
        if rest == 0 and own <= len(self.rows):
            for row, noise in zip(self.rows[own - 1], self.noise, strict=True):
                if not np.isnan(row).any():
                    yield row, float(noise)


@dataclass(frozen=True, slots=True, eq=False)
class BoundModel:
    """The linear model. Its n states are the navigator's errors (`isogal.inertial.error_model`),
    the filter's auxiliary ones, and the slow errors of each field's readings."""

    time: Array
    """(K,) s, of the start and of the scans."""
    segments: Segments
    imu: Imu
    states: tuple[AuxiliaryState, ...]
    """The auxiliary ones and all after them."""
    start: Array
    """(n, n) covariance at the start."""
    measurements: tuple[Measurements, ...]
    lags: tuple[tuple[int, int], ...]
    """States that follow others as a low-pass filter of their correlation time does: which, whom.
    """
    jumps: tuple[tuple[int, int, MapSteps], ...]
    """Map errors that go on from scan to scan: the first state, stretches between scans, how."""

    def transitions(self) -> Iterator[tuple[Array, Array, Array]]:
        """Yield transition T and noise before and after it, q and r (n, n), of each stretch: a
        covariance goes over it as T (P + q) T' + r (`isogal.evaluation.ins_error_model`).

        At a scan, map errors that do so go on together (`MapSteps`)."""
        pairs = transitions(self.segments, self.imu, self.states)
        for stretch, (transition, half) in enumerate(pairs, 1):
            for at, followed in self.lags:
                transition[at, followed] = 1.0 - transition[at, at]
            over, after = transition, half
            for first, every, steps in self.jumps:
                own, rest = divmod(stretch, every)
                if rest == 0 and own <= len(steps.step) and steps.joined[own - 1].any():
                    jump, here = np.eye(len(half)), slice(first, first + len(steps.by))
                    jump[here, here] = steps.step[own - 1]
                    over, after = jump @ over, jump @ after @ jump.T
                    after[here, here] += steps.joined[own - 1]
            yield over, half, after

    def bound(self, smoothed: bool = False) -> BoundResult:
        """Return the position covariances, and where that is asked for the same given all
        readings, those that come later included.

        Forward covariances P, then backwards the information L of what comes later, of which P - P
        L P is left (modified Bryson-Frazier; Bierman 1973, docs/mathematics.md, section 11.1).
        Over a transition T, L becomes T' L T; over a reading with row h, gain k and innovation
        variance s, (I - k h')' L (I - k h') + h h' / s."""
        n = len(self.start)
        P, A, B = self.start, np.eye(n), np.zeros((n, n))
        scans = [(P, A, B)]
        for stretch, step in enumerate(self.transitions(), 1):
            P = propagated(P, *step)
            A = step[0] @ A if smoothed else A
            for sensor in self.measurements:
                for row, noise in sensor.at(stretch):
                    variance = noise + float(row @ P @ row) if smoothed else math.nan
                    gain = condition(P, row, noise)
                    if smoothed:
                        seen = row @ A
                        B += np.outer(seen, seen) / variance
                        A -= np.outer(gain, seen)
            if stretch % self.segments.per_scan == 0:
                scans.append((P, A, B))
                A, B = (np.eye(n), np.zeros((n, n))) if smoothed else (A, B)
        known = np.array([P[:2, :2] for P, _, _ in scans])
        if not smoothed:
            return BoundResult(self.time, known)
        result, later = [], np.zeros((n, n))
        for P, A, B in reversed(scans):
            result.append(P[:2, :2] - P[:2] @ later @ P[:, :2])
            later = A.T @ later @ A + B
        return BoundResult(self.time, known, np.array(result[::-1]))


def propagated(P: Array, transition: Array, before: Array, after: Array) -> Array:
    """Return a covariance (n, n) at the end of a stretch; see `BoundModel.transitions`."""
    moved = transition @ (P + before) @ transition.T + after
    return np.asarray(0.5 * (moved + moved.T))


def condition(P: Array, row: Array, noise: float) -> Array:
    """Condition a covariance (n, n) on one reading, in place, and return the gain (n,); `row` (n,)
    are the reading's derivatives, `noise` its variance."""
    column = P @ row
    gain = column / (noise + row @ column)
    P -= np.outer(gain, column)
    return np.asarray(gain)


def posterior_cramer_rao(
    truth: Truth,
    trajectory: Trajectory,
    field_map: RunMap,
    *,
    map_share: Array | None = None,
    smoothed: bool = False,
) -> BoundResult:
    """Return the bound of a navigator that uses every reading at once, and knows how large noise
    and errors truly are.

    A reading at which the map has no gradient (missing data, outside) tells nothing. Of recorded
    readings the map's error is what the map says of it; where it says nothing, none. Of readings
    of which a share is missing by chance each counts that much less (within 1 % of the mean over
    many ways of missing half of them).

    Parameters
    ----------
    truth : Truth
        Initial errors, IMU, instruments and the map's error, by `Scenario.true`.
    trajectory : Trajectory
        The true route.
    field_map : FieldMap, TiledMap or ChannelMap, or FieldMaps of several fields
        The map; its gradient is taken at the true positions. Of several fields the bound is the
        joint one.
    map_share : (S,) array, optional
        1-sigma of the map's error at each scan in units of `map_error.sigma`, where there is one
        field; default: 1.
    smoothed : bool
        Return besides that of one that knows all readings of the voyage.
    """
    return bound_model(truth, trajectory, field_map, map_share).bound(smoothed)


def unaided_covariance(truth: Truth, trajectory: Trajectory) -> BoundResult:
    """Return the error covariance of the navigator without any reading, by the same linear
    model."""
    return linear_model(truth, trajectory).bound()


def bound_model(
    truth: Truth, trajectory: Trajectory, field_map: RunMap, map_share: Array | None = None
) -> BoundModel:
    """Return the linear model whose recursion `posterior_cramer_rao` is, whose parameters these
    are. Measurements of aids come first, then those of each field."""
    fields = [
        _FieldReadings.of(one, trajectory, its_map, map_share)
        for one, its_map in zip(truth.each_field, each_map(field_map), strict=True)
    ]
    return linear_model(truth, trajectory, fields)


def _stated_error(
    field_map: ScalarMap, trajectory: Trajectory, scans: Integers
) -> tuple[MapError, Array]:
    """Return the error that a map says of itself, and its 1-sigma at scans (S,) in units of it."""
    sigma = field_map.sigma_at(trajectory.latitude[scans], trajectory.longitude[scans])
    usual = float(np.sqrt(np.nanmean(sigma**2)))
    length = field_map.correlation_length or MapError().correlation_length
    error = MapError(sigma=usual, correlation_length=length)
    return error, np.nan_to_num(sigma / usual, nan=1.0)


@dataclass(frozen=True, slots=True, eq=False)
class _FieldReadings:
    """How readings of one field, S scans of C channels, depend on the navigator's error and on
    slow errors of their own."""

    sensitivity: Array
    """(S, C, 4) d(reading)/d(navigator's error), map included; NaN = the reading tells nothing."""
    by_height: Array
    """(S, C) d(reading)/d(height), map's unit per m."""
    height: Array
    """(S,) m."""
    noise: Array
    """(C,) variances of the channels' noise."""
    errors: list[SlowError]
    """The map's first."""
    filtered: bool
    """Whether the last of the errors is that of the map (the first) after the sensor's filter."""
    jumps: MapSteps | None
    """How the map's errors go on where they do so together."""
    steps: int
    """Of the IMU from one scan to the next."""

    @classmethod
    def of(
        cls,
        truth: Truth,
        trajectory: Trajectory,
        field_map: RouteMap,
        share: Array | None,
    ) -> "_FieldReadings":
        """Return those of one field, given the 1-sigma of the map's error at each scan (S,) in
        units of `map_error.sigma`; None = 1. Of recorded readings the map's error is what the map
        says of it, if it does."""
        scans, settings, error = scan_index(truth, trajectory), truth.gravimeter, truth.map_error
        field, maps = measured_field(truth), channels_of(field_map)
        if truth.readings.recorded and maps[0].states_error:
            error, share = _stated_error(maps[0], trajectory, scans)
        share = np.ones(len(scans)) if share is None else share
        reduction, lag = field.reduction(truth), Lag.of(settings)
        of_map = common = np.ones(len(maps))
        if field.name == "terrain" and truth.altimeter.sounds:
            sensitivity, of_map, common = beam_channels(
                truth.altimeter, trajectory, maps[0], scans, error.correlation_length
            )
        else:
            sensitivity = np.stack(
                [_sensitivity(reduction, lag, trajectory, one, scans) for one in maps], axis=1
            )
        sensitivity[without_readings(settings, trajectory, scans)] = np.nan
        if truth.readings.recorded:
            sensitivity[np.isnan(recorded(truth, trajectory).value)] = np.nan
        jumps, filtered = None, False
        if (covariance := field.covariance(truth)) is not None:
            rounding = np.array([one.quantisation for one in maps])
            noise, turn = np.linalg.eigh(effective_noise(settings, covariance, rounding))
            sensitivity = np.einsum("ci,scj->sij", turn, sensitivity)
            components = truth.gradiometer.of_one_potential
            jumps = map_steps(components, error, trajectory, scans, turn)
            slow = gradiometer_errors(truth.gradiometer, trajectory, scans, turn)
        else:
            noise = np.full(len(of_map), effective_noise_variance(settings, maps[0].quantisation))
            slow = _scalar_errors(settings, error, trajectory, scans, sensitivity, common)
            filtered = settings.filter_time > 0.0
        of_maps = map_errors(error, of_map, share, jumps)
        if filtered:  # readings have the filtered error instead; it has settled when they begin
            of_maps = [one._replace(by=np.zeros((1, 1))) for one in of_maps]
            slow.append(SlowError.of("map", 0.0, share[:, None], time=settings.filter_time))
        return cls(
            sensitivity,
            np.asarray(reduction.height_slope(trajectory.at(scans)))[:, None] * common,
            trajectory.height[scans],
            noise,
            [*of_maps, *slow],
            filtered,
            jumps,
            truth.steps_per_scan,
        )

    def measurements(self, model: FilterModel, first: int, size: int, every: int) -> Measurements:
        """Return them as rows of `size` states, the field's own from `first` on."""
        rows = np.zeros((*self.sensitivity.shape[:2], size))
        rows[..., :4] = self.sensitivity
        contents = by_auxiliary(model, self.height)[:, None]
        rows[..., STATES : STATES + contents.shape[-1]] = self.by_height[..., None] * contents
        for at, error in enumerate(self.errors, first):
            rows[..., at] = error.by
        return Measurements(rows, self.noise, every)


def _scalar_errors(
    settings: Gravimeter,
    error: MapError,
    trajectory: Trajectory,
    scans: Integers,
    sensitivity: Array,
    common: Array,
) -> list[SlowError]:
    """Return the slow errors of a sensor whose readings are one number, of which there are
    `common` (C,) in each channel: its own, an unknown delay, its bias and its drift."""
    found = [
        one._replace(by=one.by * common) for one in gravimeter_errors(settings, trajectory, scans)
    ]
    if settings.delay_sigma > 0.0 and len(common) == 1:
        moved = (sensitivity[..., :2] * trajectory.velocity[scans, None, :2]).sum(axis=2)
        found.append(SlowError.of("delay", settings.delay_sigma, np.nan_to_num(moved)))
    bias, drift = bias_and_drift(settings, error, trajectory)
    elapsed = trajectory.time[scans, None] - trajectory.time[0]
    found.append(SlowError.of("bias", bias, common, walk=settings.bias_walk))
    found.append(SlowError.of("drift", drift, elapsed * common))
    return found


def _sensitivity(
    reduction: Reduction,
    lag: Lag,
    trajectory: Trajectory,
    field_map: ScalarMap,
    scans: Integers,
) -> Array:
    """Return (S, 4) how a reading's difference from the map at the navigator's position depends on
    the navigator's error xi at the scan: (jacobian - gradient) xi, a mean over the path where the
    readings are late; NaN = the reading tells nothing."""
    time, total = trajectory.time, np.zeros((len(scans), 4))
    place = trajectory.latitude, trajectory.longitude, trajectory.height
    for age, weight in zip(*lag.ages(), strict=True):
        along = (*place, *trajectory.velocity[:, :2].T)
        at = State(*(np.interp(time[scans] - age, time, values) for values in along))
        _, north, east = field_map.value_and_gradient(at.latitude, at.longitude)
        jacobian = reduction.jacobian(at)
        jacobian[:, 0] -= north
        jacobian[:, 1] -= east
        jacobian[:, 2:] -= age * jacobian[:, :2]  # position was another by velocity
        total += weight * jacobian
    if lag.mean > 0.0:
        total[time[scans] < lag.delay + SETTLING * lag.filter_time] = np.nan
    return total


def linear_model(
    truth: Truth, trajectory: Trajectory, fields: Sequence[_FieldReadings] = ()
) -> BoundModel:
    """Return the model of a navigator that knows the truth, with its aids and readings of some
    fields."""
    segments = divide(trajectory, truth.steps_per_scan)
    gravity = true_residual_gravity(truth.gravity_field, trajectory)
    model = filter_model(truth.informed, gravity)
    states = [*model.auxiliary, *(error.state for one in fields for error in one.errors)]
    first, size = STATES + len(model.auxiliary), STATES + len(states)
    found = (_of_aid(aid, truth, model, segments, size) for aid in truth.aids)
    measurements = [one for one in found if one is not None]
    lags: list[tuple[int, int]] = []
    jumps: list[tuple[int, int, MapSteps]] = []
    for one in fields:
        every = one.steps // truth.steps_per_scan * segments.per_scan
        measurements.append(one.measurements(model, first, size, every))
        last = first + len(one.errors) - 1
        if one.filtered:
            lags.append((last, first))
        if one.jumps is not None:
            jumps.append((first, every, one.jumps))
        first = last + 1
    return BoundModel(
        trajectory.time[:: truth.steps_per_scan],
        segments,
        truth.imu,
        tuple(states),
        initial_covariance(truth.initial_error, truth.imu.sensors, states),
        tuple(measurements),
        tuple(lags),
        tuple(jumps),
    )


def _of_aid(
    aid: AnyAid, truth: Truth, model: FilterModel, segments: Segments, size: int
) -> Measurements | None:
    """Return what an aid measures, by the filter's own measurement model at the truth, as rows of
    `size` states: at the end of a stretch a reading, or the mean of those of the stretch. None
    where it measures nothing."""
    every = max(1, round(aid.interval / segments.dt))
    ends = np.arange(every - 1, len(segments.geometry), every)
    # only how a reading depends on the state counts, and the navigator's height is what the sensor
    # read, with its errors
    height = truth.route.height
    value, contents = _some_value(aid, height), by_auxiliary(model, height)
    state = FilterState.start(Estimate(np.zeros(3), np.zeros(3), np.zeros(4)), model)
    found, noise = [], np.empty(0)
    for k in ends.tolist():
        state.velocity[:2] = segments.geometry[k, 1:3]
        state.attitude[:] = from_matrix(segments.rotation[k])
        reading = reading_of(aid, value, truth, segments.rate[k])
        if reading is None:
            return None
        linear = reading.rows(state, model)
        own = linear.H[:, FILTER_STATES:] + linear.H[:, 2:3] * contents
        rest = np.zeros((len(own), size - STATES - own.shape[1]))
        found.append(np.hstack([linear.H[:, _OF_FILTER], own, rest]))
        noise = np.diag(linear.R)
    rows = np.array(found)
    since = np.asarray(segments.dt * (ends + 1.0), dtype=np.float64)
    seen = within(aid.available, since)
    if isinstance(aid, HeadingAid) and aid.kind == "course":
        seen &= np.hypot(*segments.geometry[ends, 1:3].T) >= aid.slowest
    rows[~seen] = np.nan
    return Measurements(rows, noise / max(1.0, segments.dt / aid.interval), every)


def _some_value(aid: AnyAid, height: float) -> ArrayLike:
    """Return a reading of an aid, at a height (m), in the axes that it measures; a receiver's
    vertical velocity is not used."""
    if isinstance(aid, Velocity):
        return [0.0 if axis in aid.axes else np.nan for axis in range(3)]
    if isinstance(aid, PositionAid | Gnss):
        return [0.0, 0.0, height if isinstance(aid, PositionAid) else np.nan]
    return 0.0


def bias_and_drift(
    sensor: Gravimeter, datum: MapError, trajectory: Trajectory
) -> tuple[float, float]:
    """Return the 1-sigma of the readings' offset and of its drift (per s): those of the sensor and
    of the map's datum, whose tilt is a drift on a straight route at a constant speed, for which it
    is taken here."""
    speed = float(np.hypot(trajectory.velocity[:, 0], trajectory.velocity[:, 1]).mean())
    return math.hypot(sensor.bias, datum.offset), math.hypot(sensor.drift, datum.tilt * speed)
