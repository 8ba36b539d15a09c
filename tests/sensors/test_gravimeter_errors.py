"""Slow errors of a gravimeter by their autocorrelation and Allan deviation, and readings that are
missing."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.allan import allan_deviation
from isogal.scenario import Gravimeter, Scenario
from isogal.sensors.gravimeter_errors import (
    accelerations,
    missing,
    noise_of,
    reading_errors,
    without_readings,
)
from isogal.sensors.noise import RunScans, gauss_markov
from isogal.sensors.trajectory import build_trajectory

TURNS = [[-37.9, 144.8, 22], [-37.75, 145.0, 22], [-37.8, 145.3, 22], [-37.4, 145.5, 22]]


def trajectory_of(**route):
    return build_trajectory(Scenario(route={"duration": 20000.0, **route}))


def scans(trajectory, interval=10):
    return np.arange(interval, len(trajectory) + 1, interval)


def errors_of(runs, **keys):
    """Return errors (R, N) beside white noise, every 10 s."""
    time, noise = np.arange(10.0, 20001.0, 10.0), replace(noise_of(Gravimeter(**keys)), white=0.0)
    return np.stack([noise.draw(3, run, time) for run in range(runs)])


def test_time_correlated_noise_has_the_autocorrelation_of_a_gauss_markov_process():
    error = errors_of(40, correlated_sigma=1e-5, correlation_time=60.0) / 1e-5
    for lag in (0, 1, 3, 6, 12, 30):
        products = error[:, lag:] * error[:, : error.shape[1] - lag]
        # of 80 000 products, correlated over 60 s: some 12 000 independent ones
        expected = np.exp(-10.0 * lag / 60.0)
        assert abs(products.mean() - expected) < 4.0 * np.sqrt(2.0 / 12e3), lag


def test_a_walk_of_the_bias_has_the_allan_deviation_of_a_random_walk():
    # K sqrt(t / 3) for a continuous rate (IEEE Std 952-1997, eq. C.16); here of means over t of
    # samples
    walk, taus = errors_of(60, bias_walk=1e-7), np.array([40.0, 160.0, 640.0])
    n = (taus / 10.0) ** 2
    expected = 1e-7 * np.sqrt(taus / 3.0) * np.sqrt(1.0 + 1.0 / (2.0 * n))
    np.testing.assert_allclose(allan_deviation(walk, 0.1, taus), expected, rtol=0.08)
    assert walk[:, -1].std() == pytest.approx(1e-7 * np.sqrt(20000.0), rel=0.3)


def test_the_process_is_stationary_and_knows_uneven_times():
    time = np.array([0.0, 1.0, 50.0, 55.0, 400.0])
    normal = np.random.default_rng(1).standard_normal((40000, 5))
    process = 2.0 * gauss_markov(np.exp(-np.diff(time) / 60.0), normal)
    expected = 4.0 * np.exp(-np.abs(time[:, None] - time) / 60.0)
    np.testing.assert_allclose(process.T @ process / 40000, expected, atol=0.12)
    even = gauss_markov(np.full(4, 0.6), normal[:7])
    np.testing.assert_allclose(gauss_markov(0.6, normal[:7]), even, rtol=1e-12)


def test_accelerations_of_a_turn():
    time = np.arange(0.0, 100.0, 10.0)
    heading = 0.3 + 0.02 * time
    speed = 20.0 + 0.1 * time
    velocity = np.stack([speed * np.cos(heading), speed * np.sin(heading)], axis=1)
    moving = accelerations(time, velocity)
    assert moving.shape == (10, 2)
    np.testing.assert_allclose(moving[1:, 0], 0.1, rtol=0.02)
    middle = 20.0 + 0.1 * (time[1:] - 5.0)
    np.testing.assert_allclose(moving[1:, 1], 0.02 * middle, rtol=0.02)
    np.testing.assert_array_equal(moving[0], moving[1])
    assert not accelerations(time, np.full((10, 2), 20.0)).any()


def test_cross_coupling_acts_in_turns_only():
    trajectory = trajectory_of(waypoints=TURNS, duration=None)
    index = scans(trajectory)
    settings = Gravimeter(sigma=1e-12, cross_coupling=1e-3)
    error = np.stack(
        [reading_errors(settings, RunScans(0, run, trajectory, index)) for run in range(200)]
    )
    heading = np.unwrap(np.arctan2(*trajectory.velocity[index, 1::-1].T))
    turned = np.abs(np.diff(heading, prepend=heading[0]))  # in the interval before each
    turning = turned > 0.05
    assert 3 < turning.sum() < 40
    # half a coefficient of 1e-3 at 0.02 rad/s * 22 m/s = 0.44 m/s²
    assert error[:, turning].std() > 2e-4
    assert np.abs(error[:, turned < 1e-3]).max() < 1e-5


def test_dynamic_pressure_is_a_share_of_the_square_of_the_speed():
    trajectory = trajectory_of(speed=20.0)
    index = scans(trajectory)
    settings = Gravimeter(sigma=1e-9, dynamic_pressure=5e-3)
    error = np.stack(
        [reading_errors(settings, RunScans(0, run, trajectory, index)) for run in range(400)]
    )
    np.testing.assert_allclose(error, np.tile(error[:, :1], len(index)), atol=1e-6)
    assert error[:, 0].std() == pytest.approx(5e-3 * 20.0**2, rel=0.1)


def test_missing_readings_by_chance_in_gaps_and_in_turns():
    trajectory = trajectory_of(waypoints=TURNS, duration=None)
    index = scans(trajectory)
    time = trajectory.time[index]
    some = RunScans(0, 0, trajectory, index)
    assert not missing(Gravimeter(), some).any()
    share = missing(Gravimeter(missing_fraction=0.4), some).mean()
    assert abs(share - 0.4) < 4.0 * np.sqrt(0.24 / len(index))
    gaps = without_readings(Gravimeter(gaps=((100.0, 50.0), (300.0, 10.0))), trajectory, index)
    np.testing.assert_array_equal(time[gaps], [100.0, 110.0, 120.0, 130.0, 140.0, 300.0])
    turns = without_readings(Gravimeter(dead_turn_rate=0.01), trajectory, index)
    heading = np.unwrap(np.arctan2(*trajectory.velocity[:, 1::-1].T))
    rate = np.abs(np.diff(heading))  # of the second before each reading
    np.testing.assert_array_equal(turns, rate[index - 1] > 0.01)
    assert 2 < turns.sum() < 40
    longer = without_readings(Gravimeter(dead_turn_rate=0.01, dead_time=100.0), trajectory, index)
    assert longer[turns].all()
    assert turns.sum() + 15 < longer.sum() < turns.sum() + 25  # ten more after each of two turns
    none = Gravimeter(dead_turn_rate=0.4, dead_time=100.0)
    assert not without_readings(none, trajectory, index).any()
