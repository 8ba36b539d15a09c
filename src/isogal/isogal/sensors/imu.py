"""Simulated readings of inertial sensors (docs/mathematics.md, section 3.3).

A reading is the true mean over an interval, seen through scale factor, misalignment and (for a
gyroscope) g-sensitivity, plus bias, in-run bias and white noise, rounded to whole counts. What a
scenario's sensors do not have is not drawn, and each error has a random stream of its own, so that
one more error leaves the others as they were."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from isogal.arrays import Array
from isogal.inertial.preintegration import preintegrate
from isogal.inertial.rotations import matrix
from isogal.scenario import ImuErrors, Route, Settings, Truth
from isogal.seeds import generator
from isogal.sensors.noise import gauss_markov
from isogal.sensors.trajectory import Trajectory, drive, followed, runge_kutta, sensor_means


@dataclass(frozen=True, slots=True, eq=False)
class ImuData:
    """Inertial data of R runs: means over each of K steps of the navigator, body axes."""

    specific_force: Array
    """(R, K, 3) m/s²."""
    angular_rate: Array
    """(R, K, 3) rad/s."""


def simulate_imu(
    truth: Truth,
    trajectory: Trajectory,
    runs: Sequence[int],
    gravity: Array | None = None,
) -> ImuData:
    """Return what the navigators get over the trajectory's steps: the readings of the inertial
    sensors, or what pre-integration makes of the samples of a faster IMU.

    Parameters
    ----------
    truth, trajectory, runs
        What is simulated.
    gravity : (R, K, 3) array, optional
        Gravity beside normal gravity, north, east, down, mean over each step, m/s²: an
        accelerometer senses its negative.
    """
    force = np.empty((len(runs), len(trajectory), 3))
    rate = np.empty_like(force)
    ends = np.arange(len(trajectory) + 1) * truth.samples_per_step
    duration = np.full(ends[-1], 1.0 / truth.imu.rate)
    for i, run in enumerate(runs):
        beside = None if gravity is None else gravity[i]
        readings = simulate_samples(truth, trajectory, run, beside)
        force_of_run, rate_of_run = readings[None, :, :3], readings[None, :, 3:]
        if truth.samples_per_step > 1:
            force_of_run, rate_of_run = preintegrate(force_of_run, rate_of_run, duration, ends)
        force[i], rate[i] = force_of_run[0], rate_of_run[0]
    return ImuData(force, rate)


def simulate_samples(
    truth: Truth, trajectory: Trajectory, run: int, gravity: Array | None = None
) -> Array:
    """Return one run's readings (K n, 6) of specific force (m/s²) and angular rate (rad/s), body
    axes, n of them in each of the trajectory's K steps.

    Parameters
    ----------
    truth : Truth
    trajectory : Trajectory
    run : int
        It seeds the random streams.
    gravity : (K, 3) array, optional
        As in `simulate_imu`.
    """
    n = truth.samples_per_step
    if n > 1:
        means = true_samples(truth)
    else:
        means = np.concatenate([trajectory.specific_force, trajectory.angular_rate], axis=1)
    if gravity is not None:
        ends = matrix(trajectory.attitude)
        to_navigation = 0.5 * (ends[1:] + ends[:-1])
        means = means.copy()
        means[:, :3] -= np.repeat(np.einsum("kij,ki->kj", to_navigation, gravity), n, axis=0)
    return _readings(truth.imu.sensors, means, 1.0 / truth.imu.rate, truth.seed, run)


def _readings(errors: ImuErrors, truth: Array, dt: float, seed: int, run: int) -> Array:
    """Return one run's readings (K, 6) of true means (K, 6) over intervals of dt (s)."""
    noise_sigma = _six(errors, "random_walk") / math.sqrt(dt)
    bias = _six(errors, "bias") * generator(seed, run, "imu_bias").standard_normal(6)
    noise = noise_sigma * generator(seed, run, "imu_noise").standard_normal(truth.shape)
    readings: Array = _through_axes(errors, truth, seed, run) + bias + noise
    if (sigma := _six(errors, "bias_instability")).any():
        keep = np.exp(-dt / _six(errors, "bias_time"))
        draw = generator(seed, run, "imu_instability").standard_normal(truth.shape)
        axes = [gauss_markov(keep[i], draw[:, i]) for i in range(6)]
        readings += sigma * np.stack(axes, axis=1)
    if (count := _six(errors, "quantisation")).any():
        readings = quantise(readings, count, dt)
    return readings


def _through_axes(errors: ImuErrors, truth: Array, seed: int, run: int) -> Array:
    """Return the true means (K, 6) as the imperfect axes see them: with scale factor errors,
    misalignments and g-sensitivity, which are constant over a run."""
    change = np.zeros((6, 6))
    if (sigma := _six(errors, "scale_factor")).any():
        change += np.diag(sigma * generator(seed, run, "imu_scale_factor").standard_normal(6))
    if (sigma := _six(errors, "misalignment")).any():
        draw = generator(seed, run, "imu_misalignment").standard_normal((6, 3))
        tilts = sigma[:, None] * draw * np.tile(1.0 - np.eye(3), (2, 1))
        change[:3, :3] += tilts[:3]
        change[3:, 3:] += tilts[3:]
    if (sigma := _six(errors, "g_sensitivity")).any():
        draw = generator(seed, run, "imu_g_sensitivity").standard_normal((3, 3))
        change[3:, :3] += sigma[3:, None] * draw
    return truth + truth @ change.T if change.any() else truth


def _six(errors: ImuErrors, key: str) -> Array:
    """Return one error of accelerometers and gyroscopes, (6,)."""
    return np.array([*getattr(errors.accelerometer, key), *getattr(errors.gyroscope, key)])


def quantise(readings: Array, count: Array, dt: float) -> Array:
    """Return means (K, n) whose integral is rounded to whole counts (n,), 0 = not rounded.

    An integrating sensor keeps what is left of a count for the next interval, so the rounding of
    the integral is bounded however many intervals there are (Groves 2013, section 4.4.3)."""
    rounded = readings.copy()
    for i in np.flatnonzero(count):
        whole = np.round(np.cumsum(readings[:, i]) * dt / count[i])
        rounded[:, i] = np.diff(whole, prepend=0.0) * (count[i] / dt)
    return rounded


def true_samples(settings: Settings) -> Array:
    """Return the means (K n, 6) of specific force (m/s²) and angular rate (rad/s), body axes, over
    each of n samples of K steps of the navigator.

    The route is that of `isogal.sensors.trajectory.build_trajectory`, whose steps are divided; it
    does not depend on the IMU's rate."""
    if settings.route.track is not None:
        return followed(settings).means
    return _divided(settings.route, settings.navigation_rate, settings.samples_per_step)


@lru_cache(maxsize=1)
def _divided(route: Route, rate: float, samples: int) -> Array:
    rows, rates = drive(route, rate)
    turn, acceleration = rates.T.copy()
    latitude, _, heading, speed = rows[:-1].T.copy()
    result = np.empty((len(rates), samples, 6))
    dt = 1.0 / (rate * samples)
    for j in range(samples):
        start = np.stack([latitude, heading, speed], axis=1)
        moves = heading, speed, turn, acceleration, route.height, dt
        latitude, _ = runge_kutta(latitude, np.zeros_like(latitude), *moves)
        force, angular_rate = sensor_means(start, latitude, rates, route.height, dt)
        result[:, j, :3], result[:, j, 3:] = force, angular_rate
        heading, speed = heading + turn * dt, speed + acceleration * dt
    return result.reshape(-1, 6)
