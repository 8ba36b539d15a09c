"""Errors of a data sheet in the simulated readings: Allan deviations against those of
IEEE Std 952-1997, annex C, and what constant errors do on a known motion (chi-square intervals,
fixed seeds)."""

import numpy as np
import pytest
from scipy.stats import chi2

from helpers.allan import allan_deviation
from isogal.scenario import Imu, Route, Scenario
from isogal.sensors.imu import quantise, simulate_imu
from isogal.sensors.trajectory import build_trajectory

NOTHING = {
    "accelerometer": {"bias": 0.0, "random_walk": 0.0},
    "gyroscope": {"bias": 0.0, "random_walk": 0.0},
}
DURATION = 12000.0


def simulate(runs, duration=DURATION, rate=1.0, **given):
    """Trajectory, and errors of the readings (R, K, 6), of sensors that have only some errors."""
    sensors = {name: NOTHING[name] | given.get(name, {}) for name in NOTHING}
    scenario = Scenario(route=Route(duration=duration), imu=Imu(rate=rate, **sensors))
    trajectory = build_trajectory(scenario)
    imu = simulate_imu(scenario, trajectory, runs)
    truth = np.concatenate([trajectory.specific_force, trajectory.angular_rate], axis=1)
    return trajectory, np.concatenate([imu.specific_force, imu.angular_rate], axis=2) - truth


def test_white_noise_has_the_density_of_the_data_sheet():
    _, errors = simulate(
        range(3), rate=4.0, duration=6000.0,
        accelerometer={"random_walk": "30ug/rt-Hz"}, gyroscope={"random_walk": "0.12deg/rt-h"},
    )  # fmt: skip
    taus = np.array([1.0, 10.0, 100.0])
    force = allan_deviation(errors[:, :, :3].transpose(0, 2, 1).reshape(9, -1), 4.0, taus)
    rate = allan_deviation(errors[:, :, 3:].transpose(0, 2, 1).reshape(9, -1), 4.0, taus)
    np.testing.assert_allclose(force, 30e-6 * 9.80665 / np.sqrt(taus), rtol=0.1)
    np.testing.assert_allclose(rate, np.radians(0.12) / 60.0 / np.sqrt(taus), rtol=0.1)


def test_bias_instability_is_a_gauss_markov_process():
    time, sigma = 100.0, 0.35 * np.pi / 180.0 / 3600.0
    _, errors = simulate(
        range(4), gyroscope={"bias_instability": "0.35deg/h", "bias_time": "100s"}
    )
    rates = errors[:, :, 3:].transpose(0, 2, 1).reshape(12, -1)
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
    _, errors = simulate(
        range(2), gyroscope={"quantisation": "1arcsec", "random_walk": "0.01deg/rt-h"}
    )
    taus = np.array([1.0, 4.0, 16.0])
    rates = errors[:, :, 3:].transpose(0, 2, 1).reshape(6, -1)
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


@pytest.mark.parametrize(
    ("section", "key", "sigma"),
    [("accelerometer", "scale_factor", 3e-4), ("gyroscope", "scale_factor", 1e-4)],
)
def test_scale_factor_errors_multiply_what_is_measured(section, key, sigma):
    trajectory, errors = simulate(range(200), duration=4.0, **{section: {key: sigma}})
    part, truth = (
        (slice(0, 3), trajectory.specific_force)
        if section == "accelerometer"
        else (slice(3, 6), trajectory.angular_rate)
    )
    factor = (errors[:, :, part] / truth.mean(axis=0))[:, :, 1:]  # nothing along the course
    np.testing.assert_allclose(factor, np.broadcast_to(factor[:, :1], factor.shape), rtol=1e-4)
    low, high = chi2.ppf([0.0005, 0.9995], 200)
    of_axes = ((factor[:, 0] / sigma) ** 2).sum(axis=0)
    assert ((of_axes > low) & (of_axes < high)).all()


def test_misalignment_brings_weight_to_the_horizontal_axes():
    trajectory, errors = simulate(
        range(200), duration=4.0, accelerometer={"misalignment": "1mrad"}
    )
    weight = trajectory.specific_force[0, 2]
    low, high = chi2.ppf([0.0005, 0.9995], 200)
    for axis in range(2):
        assert low < ((errors[:, 0, axis] / weight / 1e-3) ** 2).sum() < high
    # the vertical axis sees only the small horizontal force
    assert np.abs(errors[:, 0, 2]).max() < 5e-3 * np.abs(trajectory.specific_force[0, :2]).max()
    assert not errors[:, :, 3:].any()


def test_g_sensitivity_turns_weight_into_rate():
    trajectory, errors = simulate(
        range(200), duration=4.0, gyroscope={"g_sensitivity": "0.1deg/h/g"}
    )
    size = 0.1 * np.pi / 180.0 / 3600.0 / 9.80665 * np.linalg.norm(trajectory.specific_force[0])
    low, high = chi2.ppf([0.0005, 0.9995], 200)
    of_axes = ((errors[:, 0, 3:] / size) ** 2).sum(axis=0)
    assert ((of_axes > low) & (of_axes < high)).all()
    assert not errors[:, :, :3].any()


def test_a_further_error_leaves_the_others_as_they_were():
    plain = Scenario(route=Route(duration=50.0))
    trajectory = build_trajectory(plain)
    more = plain.model_copy(update={"imu": Imu(gyroscope={"bias_instability": "0.1deg/h"})})
    before = simulate_imu(plain, trajectory, [3])
    after = simulate_imu(more, trajectory, [3])
    assert (before.specific_force == after.specific_force).all()
    change = after.angular_rate - before.angular_rate
    assert 0.1 < np.abs(change).mean() / (0.1 * np.pi / 180.0 / 3600.0) < 3.0


def test_a_run_draws_the_same_alone_and_among_others():
    scenario = Scenario(route=Route(duration=50.0), imu=Imu(grade="tactical"))
    trajectory = build_trajectory(scenario)
    together = simulate_imu(scenario, trajectory, [0, 7, 3])
    alone = simulate_imu(scenario, trajectory, [7])
    assert (together.angular_rate[1] == alone.angular_rate[0]).all()
    assert (together.specific_force[1] == alone.specific_force[0]).all()
