"""The navigator's linear error model (`isogal.inertial.error_model`) along a trajectory: geometry,
initial covariance and noise of a scenario."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import radii
from isogal.fusion.auxiliary import (
    ACCELEROMETER_SCALE,
    GRAVITY,
    GYROSCOPE,
    GYROSCOPE_SCALE,
    NONE,
    AuxiliaryState,
)
from isogal.inertial.error_model import STATES
from isogal.inertial.rotations import matrix
from isogal.scenario import Scenario
from isogal.sensors.imu_model import bias_sigma
from isogal.sensors.imu_model import noise_density as imu_noise_density
from isogal.sensors.trajectory import Trajectory

LONGEST = 1.0
"""s, duration of a stretch at most. Errors change over minutes (Schuler period 84 min), so
stretches of a second are short enough for an IMU of any rate."""


class Segments(NamedTuple):
    """What the model needs at the middle of each of S stretches of the trajectory, all of the same
    duration."""

    geometry: Array
    """(S, 5) latitude (rad), north and east velocity (m/s), 1 / (M + h), 1 / (N + h) (1/m)."""
    force: Array
    """(S, 3) specific force, NED, m/s²."""
    rotation: Array
    """(S, 3, 3) body to NED."""
    rate: Array
    """(S, 3) angular rate, body, rad/s."""
    dt: float
    """s, duration of a stretch."""
    per_scan: int
    """Stretches from one gravimeter reading to the next."""


def divide(scenario: Scenario, trajectory: Trajectory) -> Segments:
    """Divide a trajectory into stretches of whole IMU intervals, up to `LONGEST` where an interval
    is shorter. What is left of the trajectory after the last whole gravimeter interval is dropped.
    """
    steps = scenario.steps_per_scan
    size = max(
        n
        for n in range(1, steps + 1)
        if steps % n == 0 and (n == 1 or n * trajectory.dt <= LONGEST)
    )
    count = len(trajectory) // steps * (steps // size)
    ends = np.arange(count + 1) * size

    def middle(values: Array) -> Array:
        return 0.5 * (values[ends[:-1]] + values[ends[1:]])

    latitude, velocity, height = (
        middle(trajectory.latitude),
        middle(trajectory.velocity),
        middle(trajectory.height),
    )
    rotation = middle(matrix(trajectory.attitude))

    def mean(values: Array) -> Array:
        return np.asarray(values[: count * size].reshape(count, size, 3).mean(axis=1))

    meridian, normal = radii(latitude)
    geometry = np.stack(
        [latitude, velocity[:, 0], velocity[:, 1], 1 / (meridian + height), 1 / (normal + height)],
        axis=1,
    )
    return Segments(
        geometry,
        np.einsum("sij,sj->si", rotation, mean(trajectory.specific_force)),
        rotation,
        mean(trajectory.angular_rate),
        size * trajectory.dt,
        steps // size,
    )


def initial_covariance(scenario: Scenario, auxiliary: Sequence[AuxiliaryState] = ()) -> Array:
    """Return the covariance (13 + M, 13 + M) of the error at the start: the scenario's initial
    errors, the biases of the IMU, and auxiliary states."""
    sigma, sensors = scenario.initial_error, scenario.imu.sensors
    start = [
        sigma.position,
        sigma.position,
        sigma.velocity,
        sigma.velocity,
        sigma.tilt,
        sigma.tilt,
        sigma.heading,
    ]
    more = [state.sigma for state in auxiliary]
    return np.diag(np.square([*start, *bias_sigma(sensors), *more]))


def noise_density(scenario: Scenario) -> Array:
    """Return power spectral densities (6,) per body axis: accelerometers (m²/s³), then gyroscopes
    (rad²/s)."""
    return np.square(imu_noise_density(scenario.imu.sensors, 1.0 / scenario.imu.rate))


def ageing(segments: Segments, auxiliary: Sequence[AuxiliaryState]) -> tuple[Array, Array]:
    """Return what becomes of auxiliary states over each stretch.

    Returns
    -------
    correlation : (S, M) array
        Of each state at the two ends of a stretch.
    half_noise : (S, M) array
        Half of the variance that comes in, for half of it at either end: c² (P + q) + q keeps a
        steady variance P.
    """
    distance = np.hypot(segments.geometry[:, 1], segments.geometry[:, 2]) * segments.dt
    correlation = np.empty((len(distance), len(auxiliary)))
    half_noise = np.empty_like(correlation)
    for j, state in enumerate(auxiliary):
        c = np.exp(-segments.dt / state.time - distance / state.length)
        correlation[:, j] = c
        half_noise[:, j] = (
            state.sigma**2 * (1.0 - c**2) / (1.0 + c**2) + 0.5 * state.walk**2 * segments.dt
        )
    return correlation, half_noise


@kernel
def fill_auxiliary(F, auxiliary, force, rotation, rate):  # type: ignore[no-untyped-def]
    """Write into the columns of F behind the first 13 how auxiliary states enter velocity and
    attitude, in place.

    `force` (3,) NED, m/s²; `rotation` (3, 3) body to NED; `rate` (3,) body, rad/s."""
    for j in range(len(auxiliary.enters)):
        enters, axis, at = auxiliary.enters[j], auxiliary.axis[j], STATES + j
        source = auxiliary.source[j]
        if enters == NONE:
            continue
        if enters == GRAVITY:
            if axis < 2:
                F[2 + axis, at] = 1.0
            continue
        size = 1.0
        if enters == ACCELEROMETER_SCALE:
            size = 0.0
            for i in range(3):
                size += rotation[i, source] * force[i]
        elif enters == GYROSCOPE_SCALE:
            size = rate[source]
        turns = enters in (GYROSCOPE, GYROSCOPE_SCALE)
        for i in range(3):
            if turns:
                F[4 + i, at] = rotation[i, axis] * size
            elif i < 2:
                F[2 + i, at] = rotation[i, axis] * size
