"""IMU grades are those of Table 1, and the drawn errors of sensors and of the navigator's start
have their statistics: chi-square intervals, Allan deviations against those of IEEE Std 952-1997,
annex C, and what constant errors do on a known motion (fixed seeds)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers.allan import allan_deviation
from helpers.statistics import within_chi_square
from isogal.earth.frames import horizontal_difference
from isogal.scenario import Imu, InitialError, Route, Scenario
from isogal.sensors.imu import quantise, simulate_imu
from isogal.sensors.initial import draw_initial_state
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


NOTHING = {
    "accelerometer": {"bias": 0.0, "random_walk": 0.0},
    "gyroscope": {"bias": 0.0, "random_walk": 0.0},
}


def simulate(runs, duration, **imu):
    """Trajectory, and errors of the readings (R, K, 6)."""
    scenario = Scenario(route=Route(duration=duration), imu=Imu(**imu))
    trajectory = build_trajectory(scenario)
    read = simulate_imu(scenario.true, trajectory, runs)
    truth = np.hstack([trajectory.specific_force, trajectory.angular_rate])
    return trajectory, np.dstack([read.specific_force, read.angular_rate]) - truth


def sizes(grade):
    """Biases (6,) and noise (6,) of accelerometers and gyroscopes."""
    it = Imu(grade=grade).sensors
    return (
        np.array([*it.accelerometer.bias, *it.gyroscope.bias]),
        np.array([*it.accelerometer.random_walk, *it.gyroscope.random_walk]),
    )


def simulate_only(runs, duration=12000.0, rate=1.0, **given):
    """The same of sensors that have only some errors."""
    sensors = {name: NOTHING[name] | given.get(name, {}) for name in NOTHING}
    return simulate(runs, duration, rate=rate, **sensors)


def series(errors, part):
    """The errors of accelerometers (0) or gyroscopes (1) as (3 R, K) series."""
    axes = errors[:, :, 3 * part : 3 * part + 3]
    return axes.transpose(0, 2, 1).reshape(3 * len(errors), -1)


@pytest.mark.parametrize("grade", TABLE_1)
def test_grades_are_table_1(grade):
    accelerometer_bias, accelerometer_noise, gyroscope_bias, gyroscope_noise = TABLE_1[grade]
    bias, noise = sizes(grade)
    rates = np.array([gyroscope_bias, gyroscope_noise]) * DEG_PER_HOUR
    np.testing.assert_allclose(bias, [*accelerometer_bias, *rates[0]], rtol=1e-15)
    np.testing.assert_allclose(noise, [*accelerometer_noise, *rates[1]], rtol=1e-15)


@pytest.mark.parametrize("grade", TABLE_1)
def test_noise_has_the_density_of_the_grade(grade):
    """And is white: without correlation from sample to sample, or from axis to axis."""
    _, error = simulate(range(5), 200.0, grade=grade)
    apart = (error - error.mean(axis=1, keepdims=True)) / sizes(grade)[1]
    assert within_chi_square((apart**2).sum(axis=(0, 1)), 5 * 199)
    neighbours = (apart[:, 1:] * apart[:, :-1]).mean(axis=(0, 1))
    axes = np.corrcoef(apart.reshape(-1, 6).T) - np.eye(6)
    assert np.abs([*neighbours, *axes.ravel()]).max() < 4.0 / np.sqrt(5 * 199)


@pytest.mark.parametrize("grade", TABLE_1)
def test_biases_are_drawn_once_per_run(grade):
    bias, noise = sizes(grade)
    trajectory, error = simulate(range(400), 2.0, grade=grade)
    assert len(trajectory) == 2
    # what is common to both samples of a run: bias; variance of a mean of two: b² + n² / 2
    square = error.mean(axis=1) ** 2 / (bias**2 + noise**2 / 2)
    assert within_chi_square(square.sum(axis=0), 400)


def test_bias_instability_is_a_gauss_markov_process():
    time, sigma = 100.0, 0.35 * np.pi / 180.0 / 3600.0
    _, errors = simulate_only(
        range(4), gyroscope={"bias_instability": "0.35deg/h", "bias_time": "100s"}
    )
    rates = series(errors, 1)
    taus = np.array([10.0, 50.0, 189.0, 500.0, 1000.0])
    x = taus / time
    expected = sigma * np.sqrt(2.0 / x * (1.0 - (3.0 - 4.0 * np.exp(-x) + np.exp(-2 * x)) / 2 / x))
    np.testing.assert_allclose(allan_deviation(rates, 1.0, taus), expected, rtol=0.12)
    # the highest point of the curve, as docs/inertial-sensors.md says
    assert expected[2] == pytest.approx(0.618 * sigma, rel=5e-3)
    # stationary from the start
    assert 0.6 < rates[:, 0].std() / sigma < 1.5
    assert errors[:, :, :3].any() == 0.0


def test_quantisation_falls_with_time():
    _, errors = simulate_only(
        range(2), gyroscope={"quantisation": "1arcsec", "random_walk": "0.01deg/rt-h"}
    )
    taus = np.array([1.0, 4.0, 16.0])
    rates = series(errors, 1)
    of_counts = np.sqrt(3.0) * (np.pi / 648000.0 / np.sqrt(12.0)) / taus
    of_noise = np.radians(0.01) / 60.0 / np.sqrt(taus)
    np.testing.assert_allclose(
        allan_deviation(rates, 1.0, taus), np.hypot(of_counts, of_noise), rtol=0.1
    )


def test_rounded_readings_are_whole_counts_and_lose_nothing():
    readings = np.random.default_rng(1).standard_normal((5000, 2)) + 0.3
    rounded = quantise(readings, np.array([0.25, 0.0]), 0.1)
    counts = rounded[:, 0] * 0.1 / 0.25
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-9)
    drift = np.cumsum(rounded - readings, axis=0)[:, 0] * 0.1
    assert np.abs(drift).max() <= 0.125 + 1e-9
    assert (rounded[:, 1] == readings[:, 1]).all()


@pytest.mark.parametrize(("section", "sigma"), [("accelerometer", 3e-4), ("gyroscope", 1e-4)])
def test_scale_factor_errors_multiply_what_is_measured(section, sigma):
    settings = {section: {"scale_factor": sigma}}
    trajectory, errors = simulate_only(range(200), duration=4.0, **settings)
    truth = np.hstack([trajectory.specific_force, trajectory.angular_rate]).mean(axis=0)
    across = [1, 2] if section == "accelerometer" else [4, 5]  # nothing along the course
    factor = (errors / truth)[:, :, across]
    np.testing.assert_allclose(factor, np.broadcast_to(factor[:, :1], factor.shape), rtol=1e-4)
    assert within_chi_square(((factor[:, 0] / sigma) ** 2).sum(axis=0), 200)


def test_weight_comes_to_horizontal_axes_by_misalignment_and_into_rates_by_g_sensitivity():
    tilted, turned = {"misalignment": "1mrad"}, {"g_sensitivity": "0.1deg/h/g"}
    trajectory, errors = simulate_only(
        range(200), duration=4.0, accelerometer=tilted, gyroscope=turned
    )
    force = trajectory.specific_force[0]
    assert within_chi_square(((errors[:, 0, :2] / force[2] / 1e-3) ** 2).sum(axis=0), 200)
    # the vertical axis sees only the small horizontal force
    assert np.abs(errors[:, 0, 2]).max() < 5e-3 * np.abs(force[:2]).max()
    rate = 0.1 * DEG_PER_HOUR / 9.80665 * np.linalg.norm(force)
    assert within_chi_square(((errors[:, 0, 3:] / rate) ** 2).sum(axis=0), 200)


RUNS = 500


def draw(runs, **sigma):
    scenario = Scenario(route=Route(duration=10.0), initial_error=InitialError(**sigma))
    trajectory = build_trajectory(scenario)
    drawn = draw_initial_state(scenario.initial_error, trajectory, scenario.seed, runs)
    return drawn, trajectory


def test_errors_have_the_sigma_of_the_scenario():
    sigma = {"position": 80.0, "velocity": 0.3, "tilt": 1e-4, "heading": 2e-3}
    nav, trajectory = draw(range(RUNS), **sigma)
    shift = horizontal_difference(
        *nav.position[:, :2].T, trajectory.latitude[0], trajectory.longitude[0]
    )
    faster = (nav.velocity - trajectory.velocity[0])[:, :2]
    true = Rotation.from_quat(trajectory.attitude[0], scalar_first=True)
    about_ned = Rotation.from_quat(nav.attitude, scalar_first=True) * true.inv()
    turn = about_ned.as_rotvec()
    errors = np.column_stack([shift / 80.0, faster / 0.3, turn / [1e-4, 1e-4, 2e-3]])
    assert within_chi_square((errors**2).sum(axis=0), RUNS)
    assert np.abs(np.corrcoef(errors.T) - np.eye(7)).max() < 4.0 / np.sqrt(RUNS)
    assert np.abs(errors.mean(axis=0)).max() < 4.0 / np.sqrt(RUNS)
    assert (nav.position[:, 2] == 100.0).all()
    assert (nav.velocity[:, 2] == 0.0).all()
