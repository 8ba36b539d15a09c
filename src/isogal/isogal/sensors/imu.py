"""Inertial sensors of the paper's Table 1, all rows, and their simulated readings."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.scenario import Scenario
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory

_DEG_PER_HOUR = math.radians(1.0) / 3600.0


@dataclass(frozen=True, slots=True)
class ImuGrade:
    """1-sigma biases and white noise densities per body axis (x, y, z)."""

    accelerometer_bias: tuple[float, float, float]
    """m/s²."""
    accelerometer_noise: tuple[float, float, float]
    """m/s²/sqrt(Hz)."""
    gyroscope_bias: tuple[float, float, float]
    """rad/s."""
    gyroscope_noise: tuple[float, float, float]
    """rad/s/sqrt(Hz)."""


def _axes(horizontal: float, vertical: float, unit: float = 1.0) -> tuple[float, float, float]:
    return horizontal * unit, horizontal * unit, vertical * unit


_PRECISION_GYROSCOPE = (_axes(2e-5, 1e-3, _DEG_PER_HOUR), _axes(1e-3, 3e-2, _DEG_PER_HOUR))
_QUANTUM_ACCELEROMETER = (_axes(1e-8, 1e-8), _axes(3e-8, 3e-8))

GRADES: dict[str, ImuGrade] = {
    "precision": ImuGrade(_axes(2e-6, 2.5e-8), _axes(8e-5, 1.6e-6), *_PRECISION_GYROSCOPE),
    "quantum_accelerometer": ImuGrade(*_QUANTUM_ACCELEROMETER, *_PRECISION_GYROSCOPE),
    "quantum": ImuGrade(
        *_QUANTUM_ACCELEROMETER,
        _axes(1e-5, 1e-5, _DEG_PER_HOUR),
        _axes(1.2e-4, 1.2e-4, _DEG_PER_HOUR),
    ),
}
"""Paper Table 1. `quantum_accelerometer` is the paper's QAPCG: quantum accelerometers with
precision gyroscopes."""


@dataclass(frozen=True, slots=True, eq=False)
class ImuData:
    """Readings of R runs: means over each of K intervals, body axes."""

    specific_force: Array
    """(R, K, 3) m/s²."""
    angular_rate: Array
    """(R, K, 3) rad/s."""


def simulate_imu(scenario: Scenario, trajectory: Trajectory, runs: Sequence[int]) -> ImuData:
    """Return truth, plus a bias drawn once per run, plus white noise of density / sqrt(dt) per
    sample (docs/mathematics.md, section 3.3)."""
    grade = GRADES[scenario.imu.grade]
    bias_sigma = np.array([*grade.accelerometer_bias, *grade.gyroscope_bias])
    noise_sigma = np.array([*grade.accelerometer_noise, *grade.gyroscope_noise]) / math.sqrt(
        trajectory.dt
    )
    truth = np.concatenate([trajectory.specific_force, trajectory.angular_rate], axis=1)
    force = np.empty((len(runs), len(trajectory), 3))
    rate = np.empty_like(force)
    for i, run in enumerate(runs):
        bias = bias_sigma * generator(scenario.seed, run, "imu_bias").standard_normal(6)
        noise = noise_sigma * generator(scenario.seed, run, "imu_noise").standard_normal(
            truth.shape
        )
        readings = truth + bias + noise
        force[i], rate[i] = readings[:, :3], readings[:, 3:]
    return ImuData(force, rate)
