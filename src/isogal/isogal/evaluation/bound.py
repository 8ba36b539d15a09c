"""Posterior Cramér–Rao bound of the aided navigator (SCIENCE 3, 4).

Along one true trajectory the bound's information recursion (Tichavský, Muravchik, Nehorai, IEEE
Trans. Signal Processing 46(5), 1998; Taylor 1979 for a given trajectory) is the Riccati recursion
of the navigator's linear error model whose measurement matrix is taken at the truth: a reading
compares the map at the navigator's position with the field at the true one, so it sees position
errors by the map's gradient, velocity and latitude errors by the reductions, the map's own error
and white noise. The map's error, a field with covariance sigma² exp(-d / L), is along the track a
first-order Gauss-Markov process: one more state. The sensor's bias and its drift are two more.

A reading of several channels is turned, by the eigenvectors of its noise's covariance, into as
many with independent noise; map errors of the channels, independent and equal in sigma and L, stay
so. Each has then its own state and is taken in turn.

The vertical accelerometer tells nothing here: with the height known it could sense the east
velocity by the Coriolis term, but only if gravity along the route were known to the
accelerometer's noise, which no vehicle has (see `isogal.fusion.navigator`)."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.compiled import kernel
from isogal.evaluation.ins_error_model import Segments, divide, initial_covariance, noise_density
from isogal.fields.measured import measured_field
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.maps.channels import AnyMap, channels_of
from isogal.matching.batching import fix_due
from isogal.scenario import Gravimeter, Scenario
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class BoundResult:
    """Smallest error covariance an unbiased navigator can have, at the start and right after each
    scan (K = scans + 1)."""

    time: Array
    """(K,) s."""
    covariance: Array
    """(K, 2, 2) m², north and east."""

    @property
    def rms(self) -> Array:
        """(K,) m, RMS horizontal error: square root of the covariance's trace."""
        return np.sqrt(np.trace(self.covariance, axis1=1, axis2=2))

    def rms_at(self, time: Array) -> Array:
        """RMS horizontal error (m) at any times (s): linear between scans, NaN before the start
        and after the last scan."""
        return np.interp(time, self.time, self.rms, left=np.nan, right=np.nan)


def posterior_cramer_rao(
    scenario: Scenario, trajectory: Trajectory, field_map: AnyMap, *, batchwise: bool = False
) -> BoundResult:
    """Bound for a navigator that uses every reading at once, with the scenario's noise and map
    error.

    Where the map has no gradient at a scan (missing data, outside), that reading tells nothing.

    Parameters
    ----------
    scenario : Scenario
        Initial errors, IMU grade, gravimeter noise and the map error of the simulated truth.
    trajectory : Trajectory
        The true route.
    field_map : FieldMap or ChannelMap
        The map; its gradient is taken at the true positions.
    batchwise : bool
        The bound of a navigator that learns what a batch's readings say only where the batch ends,
        as any batch matcher does.
    """
    scans = np.arange(scenario.steps_per_scan, len(trajectory) + 1, scenario.steps_per_scan)
    latitude, longitude, velocity = (
        trajectory.latitude[scans],
        trajectory.longitude[scans],
        trajectory.velocity[scans],
    )
    # with the navigator at error xi: reading - map(navigator's position) = (jacobian - gradient)
    # xi + map error + noise
    field = measured_field(scenario)
    at = State(latitude, longitude, trajectory.height[scans], velocity[:, 0], velocity[:, 1])
    channels = []
    for one in channels_of(field_map):
        _, north, east = one.value_and_gradient(latitude, longitude)
        jacobian = field.reduction(scenario).jacobian(at)
        jacobian[:, 0] -= north
        jacobian[:, 1] -= east
        channels.append(jacobian)
    sensitivity = np.stack(channels, axis=1)
    noise = np.array(
        [effective_noise_variance(scenario.gravimeter, channels_of(field_map)[0].quantisation)]
    )
    if (covariance := field.covariance(scenario)) is not None:
        rounding = np.array([one.quantisation for one in channels_of(field_map)]) ** 2 / 12.0
        noise, turn = np.linalg.eigh(_effective_noise(scenario.gravimeter, covariance, rounding))
        sensitivity = np.einsum("ci,scj->sij", turn, sensitivity)
    told = np.ones(len(scans), dtype=np.bool_)
    if batchwise:
        told[:] = [fix_due(count + 1, scenario.matcher) for count in range(len(scans))]
    return _run(scenario, trajectory, sensitivity, noise, told)


def unaided_covariance(scenario: Scenario, trajectory: Trajectory) -> BoundResult:
    """Error covariance of the navigator without any reading, from the same linear model."""
    scans = len(trajectory) // scenario.steps_per_scan
    return _run(
        scenario,
        trajectory,
        np.full((scans, 1, 4), np.nan),
        np.ones(1),
        np.ones(scans, dtype=np.bool_),
    )


def effective_noise_variance(gravimeter: Gravimeter, quantisation: float = 0.0) -> float:
    """Variance (map's unit squared) whose information equals that of a reading on average.

    White noise and the map's rounding (step² / 12) add. With outliers the bound is that of a
    navigator who is told which readings are outliers: the mean of the two informations."""
    rounding = quantisation**2 / 12.0
    good = gravimeter.sigma**2 + rounding
    outlier = good + (gravimeter.sigma * gravimeter.outlier_sigma) ** 2
    return 1.0 / (
        (1.0 - gravimeter.outlier_fraction) / good + gravimeter.outlier_fraction / outlier
    )


def _effective_noise(gravimeter: Gravimeter, covariance: Array, rounding: Array) -> Array:
    """Return the same (C, C) for readings of C channels with a covariance of their noise, and
    variances (C,) of the maps' rounding."""
    good = covariance + np.diag(rounding)
    outlier = good + gravimeter.outlier_sigma**2 * covariance
    share = gravimeter.outlier_fraction
    return np.asarray(
        np.linalg.inv((1.0 - share) * np.linalg.inv(good) + share * np.linalg.inv(outlier))
    )


def _run(
    scenario: Scenario, trajectory: Trajectory, sensitivity: Array, noise: Array, told: Booleans
) -> BoundResult:
    segments = divide(scenario, trajectory)
    channels = len(noise)
    # the navigator's errors, the map's error in each channel, the sensor's bias and drift
    start = np.zeros((STATES + channels + 2, STATES + channels + 2))
    start[:STATES, :STATES] = initial_covariance(scenario)
    bias = (scenario.gravimeter.bias, scenario.gravimeter.drift) if channels == 1 else (0.0, 0.0)
    start[STATES:, STATES:] = np.diag([scenario.map_error.sigma] * channels + [*bias]) ** 2
    covariance = _riccati(
        start,
        segments.geometry,
        segments.force,
        segments.rotation,
        noise_density(scenario),
        _correlation(scenario, segments),
        segments.dt,
        segments.per_scan,
        sensitivity,
        noise,
        told,
    )
    time = trajectory.time[np.arange(covariance.shape[0]) * scenario.steps_per_scan]
    return BoundResult(time, covariance)


def _correlation(scenario: Scenario, segments: Segments) -> Array:
    """(S,) correlation of the map error at the ends of each stretch."""
    speed = np.hypot(segments.geometry[:, 1], segments.geometry[:, 2])
    return np.exp(-speed * segments.dt / scenario.map_error.correlation_length)


@kernel
def _riccati(  # type: ignore[no-untyped-def]
    start, geometry, force, rotation, density, correlation, dt, per_scan, sensitivity, noise, told
):
    """Run the recursion; returns the (scans + 1, 2, 2) position covariances. A channel whose
    sensitivity is NaN is skipped.

    What the readings say gets through to the navigator where it is told of them; from there to the
    next time it goes on alone."""
    n, m = start.shape[0], start.shape[0] - noise.shape[0] - 2
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
        _discretise(
            transition, half_noise, F, rotation[k], density, correlation[k], start[m, m], dt
        )
        P = (
            transition @ (P + half_noise) @ transition.T + half_noise
        )  # trapezoid: half the noise enters at either end
        P = 0.5 * (P + P.T)
        alone = transition @ (alone + half_noise) @ transition.T + half_noise
        if (k + 1) % per_scan == 0:
            scan = (k + 1) // per_scan - 1
            for c in range(noise.shape[0]):
                if not np.isnan(sensitivity[scan, c]).any():
                    _update(P, sensitivity[scan, c], noise[c], m + c)
            if told[scan]:
                alone = P.copy()
            result[scan + 1] = alone[:2, :2]
    return result


@kernel
def _discretise(transition, half_noise, F, rotation, density, correlation, map_variance, dt):  # type: ignore[no-untyped-def]
    m = F.shape[0]
    second = F @ F
    for i in range(m):
        for j in range(m):
            transition[i, j] = dt * F[i, j] + 0.5 * dt * dt * second[i, j]
        transition[i, i] += 1.0
    for c in range(m, transition.shape[0] - 2):
        transition[c, c] = correlation
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
    # the same trapezoid for the map error: c² (P + q) + q keeps its stationary variance
    for c in range(m, transition.shape[0] - 2):
        half_noise[c, c] = map_variance * (1.0 - correlation**2) / (1.0 + correlation**2)


@kernel
def _update(P, sensitivity, noise, error):  # type: ignore[no-untyped-def]
    """Condition on one reading, in place: it sees position and velocity errors by the sensitivity,
    its map error and the bias by one."""
    n = P.shape[0]
    column = np.empty(n)
    for i in range(n):
        column[i] = P[i, error] + P[i, n - 2]
        for j in range(4):
            column[i] += P[i, j] * sensitivity[j]
    variance = noise + column[error] + column[n - 2]
    for j in range(4):
        variance += sensitivity[j] * column[j]
    for i in range(n):
        for j in range(n):
            P[i, j] -= column[i] * column[j] / variance
