"""Simulated readings of inertial sensors (docs/mathematics.md, section 3.3).

A reading is the true mean over an interval, seen through scale factor, misalignment and (for a
gyroscope) g-sensitivity, plus bias, in-run bias and white noise, rounded to whole counts. What a
scenario's sensors do not have is not drawn, and each error has a random stream of its own, so that
one more error leaves the others as they were."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.inertial.rotations import matrix
from isogal.scenario import ImuErrors, Scenario
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory


@dataclass(frozen=True, slots=True, eq=False)
class ImuData:
    """Readings of R runs: means over each of K intervals, body axes."""

    specific_force: Array
    """(R, K, 3) m/s²."""
    angular_rate: Array
    """(R, K, 3) rad/s."""


def simulate_imu(
    scenario: Scenario,
    trajectory: Trajectory,
    runs: Sequence[int],
    gravity: Array | None = None,
) -> ImuData:
    """Return what the inertial sensors read over the trajectory's intervals.

    Parameters
    ----------
    scenario, trajectory, runs
        What is simulated.
    gravity : (R, K, 3) array, optional
        Gravity beside normal gravity, north, east, down, mean over each interval, m/s²: an
        accelerometer feels its negative.
    """
    errors = scenario.imu.sensors
    ends = matrix(trajectory.attitude)
    to_navigation = 0.5 * (ends[1:] + ends[:-1])
    truth = np.concatenate([trajectory.specific_force, trajectory.angular_rate], axis=1)
    force = np.empty((len(runs), len(trajectory), 3))
    rate = np.empty_like(force)
    for i, run in enumerate(runs):
        felt = truth
        if gravity is not None:
            felt = truth.copy()
            felt[:, :3] -= np.einsum("kij,ki->kj", to_navigation, gravity[i])
        readings = _readings(errors, felt, trajectory.dt, scenario.seed, run)
        force[i], rate[i] = readings[:, :3], readings[:, 3:]
    return ImuData(force, rate)


def _readings(errors: ImuErrors, truth: Array, dt: float, seed: int, run: int) -> Array:
    """Return one run's readings (K, 6) of true means (K, 6) over intervals of dt (s)."""
    noise_sigma = _six(errors, "random_walk") / math.sqrt(dt)
    bias = _six(errors, "bias") * generator(seed, run, "imu_bias").standard_normal(6)
    noise = noise_sigma * generator(seed, run, "imu_noise").standard_normal(truth.shape)
    readings: Array = _through_axes(errors, truth, seed, run) + bias + noise
    if (sigma := _six(errors, "bias_instability")).any():
        time = _six(errors, "bias_time")
        draw = generator(seed, run, "imu_instability").standard_normal(truth.shape)
        readings += gauss_markov(draw, sigma, time, dt)
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


def gauss_markov(draw: Array, sigma: Array, time: Array, dt: float) -> Array:
    """Return samples (K, n) of first-order Gauss-Markov processes, stationary from the start.

    Parameters
    ----------
    draw : (K, n) array
        Standard normal numbers.
    sigma, time : (n,) arrays
        1-sigma and correlation time (s) of each process.
    dt : float
        From one sample to the next, s.
    """
    from scipy.signal import lfilter

    kept = np.exp(-dt / time)
    drive = draw * (sigma * np.sqrt(1.0 - kept**2))
    drive[0] = draw[0] * sigma
    columns = [lfilter([1.0], [1.0, -kept[i]], drive[:, i]) for i in range(drive.shape[1])]
    return np.stack(columns, axis=1)


def quantise(readings: Array, count: Array, dt: float) -> Array:
    """Return means (K, n) whose integral is rounded to whole counts (n,), 0 = not rounded.

    An integrating sensor keeps what is left of a count for the next interval, so the rounding of
    the integral is bounded however many intervals there are (Groves 2013, section 4.4.3)."""
    rounded = readings.copy()
    for i in np.flatnonzero(count):
        whole = np.round(np.cumsum(readings[:, i]) * dt / count[i])
        rounded[:, i] = np.diff(whole, prepend=0.0) * (count[i] / dt)
    return rounded
