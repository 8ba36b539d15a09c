"""Posterior Cramér–Rao bound of the aided navigator (docs/mathematics.md, section 11.1).

Along one true trajectory the bound's information recursion (Tichavský, Muravchik, Nehorai, IEEE
Trans. Signal Processing 46(5), 1998; Taylor 1979 for a given trajectory) is the Riccati recursion
of the navigator's linear error model, with the measurement matrix taken at the truth. A reading
compares the map at the navigator's position with the field at the true one, so it depends on the
position error by the map's gradient, on velocity and latitude errors by the reductions, on the
map's own error and on white noise. The map's error, a field with covariance sigma² exp(-d / L), is
along the track a first-order Gauss-Markov process, which adds a state. The sensor's bias and its
drift add two more, its noise that is correlated in time, its cross-coupling and its low-pass
filter others where it has them (`slow_states`).

A reading of several channels is turned by the eigenvectors of its noise's covariance into as many
channels with independent noise. Map errors of the channels, independent and equal in sigma and L,
remain so. Each channel has its own state, and they are taken one after the other. What the filter
has as auxiliary states (residual gravity, sensor errors that change) are states here, too.

The vertical accelerometer is left out: with the height known it could measure the east velocity by
the Eötvös term, but only if gravity along the route were known to the precision of the
accelerometer (docs/mathematics.md, section 3.7)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.compiled import kernel
from isogal.evaluation.aids_model import aids_model, height_slope
from isogal.evaluation.gravimeter_states import (
    SlowStates,
    effective_noise,
    effective_noise_variance,
    fill_slow,
    slow_states,
)
from isogal.evaluation.ins_error_model import (
    Segments,
    ageing,
    divide,
    fill_auxiliary,
    initial_covariance,
    noise_density,
)
from isogal.fields.known_gravity import true_residual_gravity
from isogal.fields.measured import measured_field
from isogal.fusion.auxiliary import Auxiliary, auxiliary_of
from isogal.fusion.model import FilterModel
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.maps.channels import RouteMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import TiledMap
from isogal.matching.batching import fix_due
from isogal.scenario import Scenario
from isogal.sensors.gravimeter_errors import without_readings
from isogal.sensors.lag import SETTLING, Lag
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import Trajectory


class _Readings(NamedTuple):
    """S scans of C channels with independent noise."""

    sensitivity: Array
    """(S, C, 4) d(reading)/d(navigator's error), map included; NaN = the reading tells nothing."""
    slope: Array
    """(S,) d(reading)/d(height), map's unit per m."""
    noise: Array
    """(C,) variances of the channels' noise."""
    used: Booleans
    """(S,) whether the navigator gets, after a scan, what all readings so far say."""
    slow: SlowStates
    """Of the sensor."""
    map_share: Array
    """(S,) the map's error in a reading, in units of its 1-sigma."""


class _Ageing(NamedTuple):
    """What becomes of auxiliary states and of the map's error over S stretches."""

    states: Auxiliary
    correlation: Array
    """(S, M)."""
    half_noise: Array
    """(S, M)."""
    map_correlation: Array
    """(S,)."""


@dataclass(frozen=True, slots=True, eq=False)
class BoundResult:
    """Smallest error covariance that an unbiased navigator can have, at the start and right after
    each scan (K = scans + 1)."""

    time: Array
    """(K,) s."""
    covariance: Array
    """(K, 2, 2) m², north and east."""

    @property
    def rms(self) -> Array:
        """(K,) m, RMS horizontal error: square root of the covariance's trace."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))

    def rms_at(self, time: Array) -> Array:
        """Return the RMS horizontal error (m) at any times (s): linear between scans, NaN before
        the start and after the last scan."""
        return np.interp(time, self.time, self.rms, left=np.nan, right=np.nan)


def posterior_cramer_rao(
    scenario: Scenario,
    trajectory: Trajectory,
    field_map: RouteMap,
    *,
    batchwise: bool = False,
    map_share: Array | None = None,
) -> BoundResult:
    """Return the bound of a navigator that uses every reading at once, with the noise and map
    error of the scenario's true world, which it knows.

    A reading at which the map has no gradient (missing data, outside) tells nothing.

    Parameters
    ----------
    scenario : Scenario
        Initial errors, IMU grade, gravimeter noise and the map error of the simulated truth.
    trajectory : Trajectory
        The true route.
    field_map : FieldMap, TiledMap or ChannelMap
        The map; its gradient is taken at the true positions.
    batchwise : bool
        Return the bound of a navigator that learns what a batch's readings say only at the end of
        the batch, as any batch matcher does.
    map_share : (S,) array, optional
        1-sigma of the map's error at each scan in units of `map_error.sigma`; default: 1.
    """
    scenario = scenario.world
    scans = np.arange(scenario.steps_per_scan, len(trajectory) + 1, scenario.steps_per_scan)
    field = measured_field(scenario)
    sensitivity = np.stack(
        [_sensitivity(scenario, trajectory, one, scans) for one in channels_of(field_map)], axis=1
    )
    sensitivity[without_readings(scenario.gravimeter, trajectory, scans)] = np.nan
    noise = np.array(
        [effective_noise_variance(scenario.gravimeter, channels_of(field_map)[0].quantisation)]
    )
    if (covariance := field.covariance(scenario)) is not None:
        rounding = np.array([one.quantisation for one in channels_of(field_map)]) ** 2 / 12.0
        noise, turn = np.linalg.eigh(effective_noise(scenario.gravimeter, covariance, rounding))
        sensitivity = np.einsum("ci,scj->sij", turn, sensitivity)
    used = np.ones(len(scans), dtype=np.bool_)
    if batchwise:
        used[:] = [fix_due(count + 1, scenario.matcher) for count in range(len(scans))]
    slow = slow_states(scenario.gravimeter, trajectory, scans)
    slope = height_slope(scenario, trajectory, scans)
    share = np.ones(len(scans)) if map_share is None else map_share
    return _run(scenario, trajectory, _Readings(sensitivity, slope, noise, used, slow, share))


def _sensitivity(
    scenario: Scenario, trajectory: Trajectory, field_map: FieldMap | TiledMap, scans: Integers
) -> Array:
    """Return (S, 4) how a reading's difference from the map at the navigator's position depends on
    the navigator's error xi at the scan: (jacobian - gradient) xi, a mean over the path where the
    readings are late; NaN = the reading tells nothing."""
    reduction = measured_field(scenario).reduction(scenario)
    lag, time = Lag.of(scenario.gravimeter), trajectory.time
    total = np.zeros((len(scans), 4))
    for age, weight in zip(*lag.ages(), strict=True):
        then = time[scans] - age
        place = [
            np.interp(then, time, values)
            for values in (
                trajectory.latitude,
                trajectory.longitude,
                trajectory.height,
                trajectory.velocity[:, 0],
                trajectory.velocity[:, 1],
            )
        ]
        at = State(*place)
        _, north, east = field_map.value_and_gradient(at.latitude, at.longitude)
        jacobian = reduction.jacobian(at)
        jacobian[:, 0] -= north
        jacobian[:, 1] -= east
        jacobian[:, 2:] -= age * jacobian[:, :2]  # position was another by velocity
        total += weight * jacobian
    if lag.mean > 0.0:
        total[time[scans] < lag.delay + SETTLING * lag.filter_time] = np.nan
    return total


def unaided_covariance(scenario: Scenario, trajectory: Trajectory) -> BoundResult:
    """Return the error covariance of the navigator without any reading, by the same linear
    model, in the scenario's true world."""
    scenario = scenario.world
    scans = len(trajectory) // scenario.steps_per_scan
    nothing = np.full((scans, 1, 4), np.nan)
    used = np.ones(scans, dtype=np.bool_)
    slow, ones = SlowStates.none(scans), np.ones(scans)
    return _run(scenario, trajectory, _Readings(nothing, ones, np.ones(1), used, slow, ones))


def _run(scenario: Scenario, trajectory: Trajectory, readings: _Readings) -> BoundResult:
    segments = divide(scenario, trajectory)
    channels = len(readings.noise)
    gravity = true_residual_gravity(scenario, trajectory)
    model = FilterModel.from_scenario(scenario, gravity)
    auxiliary = model.auxiliary
    # the navigator's errors, the map's error in each channel, the sensor's slow errors, its bias
    # and drift
    m, slow = STATES + len(auxiliary), readings.slow.variance
    start = np.zeros((m + channels + len(slow) + 2, m + channels + len(slow) + 2))
    start[:m, :m] = initial_covariance(scenario, auxiliary)
    bias = bias_and_drift(scenario, trajectory) if channels == 1 else (0.0, 0.0)
    start[m:, m:] = np.diag([scenario.map_error.sigma**2] * channels + [*slow, *np.square(bias)])
    aged = _Ageing(
        auxiliary_of(auxiliary), *ageing(segments, auxiliary), _correlation(scenario, segments)
    )
    scans = np.arange(1, len(readings.slope) + 1) * scenario.steps_per_scan
    aids = aids_model(scenario, model, segments, readings.slope, trajectory.height[scans])
    covariance = _riccati(start, segments, noise_density(scenario), aged, aids, readings)
    time = trajectory.time[np.arange(covariance.shape[0]) * scenario.steps_per_scan]
    return BoundResult(time, covariance)


def bias_and_drift(scenario: Scenario, trajectory: Trajectory) -> tuple[float, float]:
    """Return the 1-sigma of the readings' offset and of its drift (per s): those of the sensor and
    of the map's datum, whose tilt is a drift on a straight route at a constant speed, for which it
    is taken here."""
    sensor, datum = scenario.gravimeter, scenario.map_error
    speed = float(np.hypot(trajectory.velocity[:, 0], trajectory.velocity[:, 1]).mean())
    return math.hypot(sensor.bias, datum.offset), math.hypot(sensor.drift, datum.tilt * speed)


def _correlation(scenario: Scenario, segments: Segments) -> Array:
    """Return (S,) the correlation of the map's error between the ends of each stretch."""
    speed = np.hypot(segments.geometry[:, 1], segments.geometry[:, 2])
    return np.exp(-speed * segments.dt / scenario.map_error.correlation_length)


@kernel
def _riccati(  # type: ignore[no-untyped-def]
    start, segments, density, aged, aids, readings
):
    """Run the recursion; return the (scans + 1, 2, 2) position covariances.

    `P` is the covariance given all readings so far, `alone` that of the navigator: the same after
    a scan at which it gets what they say, and only propagated until the next such scan."""
    geometry, force, rotation, rate, dt, per_scan = segments
    sensitivity, _, noise, used, slow, map_share = readings
    n, filtered = start.shape[0], slow.filter_time > 0.0
    first = n - 2 - slow.variance.shape[0]  # of the slow states
    m = first - noise.shape[0]
    scans = geometry.shape[0] // per_scan
    result = np.empty((scans + 1, 2, 2))
    P = start.copy()
    alone = start.copy()
    result[0] = P[:2, :2]
    F = np.zeros((m, m))
    transition = np.zeros((n, n))
    half_noise = np.zeros((n, n))
    for k in range(geometry.shape[0]):
        fill_dynamics(F, geometry[k], force[k], rotation[k])
        fill_auxiliary(F, aged.states, force[k], rotation[k], rate[k])
        discretise(transition, half_noise, F, rotation[k], density, dt)
        for j in range(STATES, m):
            transition[j, j] = aged.correlation[k, j - STATES]
            half_noise[j, j] = aged.half_noise[k, j - STATES]
        # the same trapezoid for the map's error: c² (P + q) + q keeps its stationary variance
        c = aged.map_correlation[k]
        for j in range(m, first):
            transition[j, j] = c
            half_noise[j, j] = start[m, m] * (1.0 - c**2) / (1.0 + c**2)
        fill_slow(transition, half_noise, slow, m, dt)
        # trapezoid: half the noise enters at either end
        P = transition @ (P + half_noise) @ transition.T + half_noise
        P = 0.5 * (P + P.T)
        alone = transition @ (alone + half_noise) @ transition.T + half_noise
        if (k + 1) % aids.every == 0:
            for a in range(aids.velocity.shape[1]):
                row = np.zeros(n)
                row[:m] = aids.velocity[k, a]
                _update(P, row, aids.noise)
                _update(alone, row, aids.noise)
        if (k + 1) % per_scan == 0:
            scan = (k + 1) // per_scan - 1
            for c in range(noise.shape[0]):
                if not np.isnan(sensitivity[scan, c]).any():
                    row = np.zeros(n)
                    row[:4] = sensitivity[scan, c]
                    row[STATES:m] = aids.by_height[scan]
                    row[first : n - 2] = slow.share[scan]
                    row[n - 3 if filtered else m + c] = map_share[scan]
                    row[n - 2] = 1.0
                    _update(P, row, noise[c])
            if used[scan]:
                alone = P.copy()
            result[scan + 1] = alone[:2, :2]
    return result


@kernel
def discretise(transition, half_noise, F, rotation, density, dt):  # type: ignore[no-untyped-def]
    """Write transition and half of the process noise of one stretch, of the navigator's errors and
    the sensor's bias, in place."""
    m = F.shape[0]
    second = F @ F
    for i in range(m):
        for j in range(m):
            transition[i, j] = dt * F[i, j] + 0.5 * dt * dt * second[i, j]
        transition[i, i] += 1.0
    transition[-2, -2] = transition[-1, -1] = 1.0
    transition[-2, -1] = dt
    for i in range(3):
        for j in range(3):
            acceleration, rate = 0.0, 0.0
            for a in range(3):
                acceleration += rotation[i, a] * density[a] * rotation[j, a]
                rate += rotation[i, a] * density[3 + a] * rotation[j, a]
            if i < 2 and j < 2:
                half_noise[2 + i, 2 + j] = 0.5 * dt * acceleration
            half_noise[4 + i, 4 + j] = 0.5 * dt * rate


@kernel
def _update(P, row, noise):  # type: ignore[no-untyped-def]
    """Condition on one reading, in place; `row` (n,) holds its derivatives."""
    n = P.shape[0]
    column = np.zeros(n)
    variance = noise
    for j in range(n):
        if row[j] != 0.0:
            for i in range(n):
                column[i] += P[i, j] * row[j]
    for j in range(n):
        variance += row[j] * column[j]
    for i in range(n):
        for j in range(n):
            P[i, j] -= column[i] * column[j] / variance
