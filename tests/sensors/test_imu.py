"""IMU grades are those of Table 1, and the drawn errors have their statistics (chi-square
intervals, fixed seeds)."""

import numpy as np
import pytest
from scipy.stats import chi2

from isogal.scenario import Imu, Route, Scenario
from isogal.sensors.imu import simulate_imu
from isogal.sensors.trajectory import build_trajectory

DEG_PER_HOUR = np.pi / 180.0 / 3600.0
TABLE_1 = {
    "precision": (
        [2e-6, 2e-6, 2.5e-8],
        [8e-5, 8e-5, 1.6e-6],
        [2e-5, 2e-5, 1e-3],
        [1e-3, 1e-3, 3e-2],
    ),
    "quantum_accelerometer": ([1e-8] * 3, [3e-8] * 3, [2e-5, 2e-5, 1e-3], [1e-3, 1e-3, 3e-2]),
    "quantum": ([1e-8] * 3, [3e-8] * 3, [1e-5] * 3, [1.2e-4] * 3),
}
"""Accelerometer bias and noise (m/s²), gyroscope bias and noise (deg/h), axes x, y, z."""


def errors(grade, runs, duration=200.0, rate=1.0, seed=0):
    scenario = Scenario(seed=seed, route=Route(duration=duration), imu=Imu(grade=grade, rate=rate))
    trajectory = build_trajectory(scenario)
    imu = simulate_imu(scenario, trajectory, runs)
    return np.concatenate(
        [
            imu.specific_force - trajectory.specific_force,
            imu.angular_rate - trajectory.angular_rate,
        ],
        axis=2,
    )


def within_chi_square(sum_of_squares, freedom):
    """Two-sided 99.9 % interval of each of the numbers."""
    low, high = chi2.ppf([0.0005, 0.9995], freedom)
    return ((sum_of_squares > low) & (sum_of_squares < high)).all()


@pytest.mark.parametrize("grade", TABLE_1)
def test_grades_are_table_1(grade):
    accelerometer_bias, accelerometer_noise, gyroscope_bias, gyroscope_noise = TABLE_1[grade]
    it = Imu(grade=grade).sensors
    assert it.accelerometer.bias == tuple(accelerometer_bias)
    assert it.accelerometer.random_walk == tuple(accelerometer_noise)
    np.testing.assert_allclose(
        it.gyroscope.bias, np.array(gyroscope_bias) * DEG_PER_HOUR, rtol=1e-15
    )
    np.testing.assert_allclose(
        it.gyroscope.random_walk, np.array(gyroscope_noise) * DEG_PER_HOUR, rtol=1e-15
    )


@pytest.mark.parametrize("grade", TABLE_1)
def test_noise_has_the_density_of_the_grade(grade):
    it = Imu(grade=grade).sensors
    error = errors(grade, range(5))
    apart = (error - error.mean(axis=1, keepdims=True)) / [
        *it.accelerometer.random_walk,
        *it.gyroscope.random_walk,
    ]
    assert within_chi_square((apart**2).sum(axis=(0, 1)), 5 * 199)
    neighbours = (apart[:, 1:] * apart[:, :-1]).mean(
        axis=(0, 1)
    )  # white: no correlation from sample to sample
    assert np.abs(neighbours).max() < 4.0 / np.sqrt(5 * 199)
    axes = np.corrcoef(apart.reshape(-1, 6).T) - np.eye(6)
    assert np.abs(axes).max() < 4.0 / np.sqrt(5 * 199)


def test_noise_per_sample_grows_with_the_root_of_the_rate():
    error = errors("precision", range(5), duration=50.0, rate=4.0)
    apart = (error - error.mean(axis=1, keepdims=True))[..., 0] / (8e-5 * np.sqrt(4.0))
    assert within_chi_square((apart**2).sum(), 5 * 199)


@pytest.mark.parametrize("grade", TABLE_1)
def test_biases_are_drawn_once_per_run(grade):
    it = Imu(grade=grade).sensors
    runs = 400
    scenario = Scenario(route=Route(duration=2.0), imu=Imu(grade=grade))
    trajectory = build_trajectory(scenario)
    biases = np.array([*it.accelerometer.bias, *it.gyroscope.bias])
    noise = np.array([*it.accelerometer.random_walk, *it.gyroscope.random_walk])
    error = errors(grade, range(runs), duration=2.0)
    # what is common to both samples of a run: bias; variance of a mean of two: b² + n² / 2
    assert within_chi_square(
        (error.mean(axis=1) ** 2 / (biases**2 + noise**2 / 2)).sum(axis=0), runs
    )
    assert len(trajectory) == 2


def test_a_bias_is_constant_over_a_run():
    # long enough for the mean to show a bias well above the noise: accelerometers of the precision
    # grade, 40 runs
    error = errors("precision", range(40), duration=12000.0)[..., :2]
    halves = error.reshape(40, 2, 6000, 2).mean(axis=2)
    of_mean = 8e-5 / np.sqrt(6000.0)
    assert within_chi_square(
        ((halves[:, 0] - halves[:, 1]) ** 2 / (2 * of_mean**2)).sum(axis=0), 40
    )
    assert within_chi_square(
        (halves.mean(axis=1) ** 2 / (2e-6**2 + of_mean**2 / 2)).sum(axis=0), 40
    )
