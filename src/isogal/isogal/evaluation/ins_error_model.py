"""The navigator's linear error model (`isogal.inertial.error_model`) along a trajectory: geometry,
initial covariance and noise of a scenario."""

from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import radii
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
    force = trajectory.specific_force[: count * size].reshape(count, size, 3).mean(axis=1)
    meridian, normal = radii(latitude)
    geometry = np.stack(
        [latitude, velocity[:, 0], velocity[:, 1], 1 / (meridian + height), 1 / (normal + height)],
        axis=1,
    )
    return Segments(
        geometry,
        np.einsum("sij,sj->si", rotation, force),
        rotation,
        size * trajectory.dt,
        steps // size,
    )


def initial_covariance(scenario: Scenario) -> Array:
    """Return the covariance (13, 13) of the error at the start: the scenario's initial errors, and
    the biases of the IMU."""
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
    return np.diag(np.square([*start, *bias_sigma(sensors)]))


def noise_density(scenario: Scenario) -> Array:
    """Return power spectral densities (6,) per body axis: accelerometers (m²/s³), then gyroscopes
    (rad²/s)."""
    return np.square(imu_noise_density(scenario.imu.sensors, 1.0 / scenario.imu.rate))
