"""Measured gravity, its reductions and their derivatives; slow errors by their autocorrelation and
Allan deviation, a platform that is not level, and readings that are missing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import lsim, lti

from helpers.allan import allan_deviation
from helpers.batches import noise_covariance
from helpers.statistics import within_chi_square
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import FREE_AIR, normal_gravity
from isogal.matching.reading_noise import joined, noise_states
from isogal.scenario import Gravimeter, Scenario
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction
from isogal.sensors.gravimeter_errors import (
    missing,
    noise_of,
    reading_errors,
    without_readings,
)
from isogal.sensors.lag import Lag, low_pass
from isogal.sensors.noise import RunScans
from isogal.sensors.platform import levelling_error, mean_error
from isogal.sensors.reduction import State, reduction_variance
from isogal.sensors.trajectory import build_trajectory

GRAVITY, DISTURBANCE = GravityReduction(), DisturbanceReduction()
latitudes = st.floats(-1.4, 1.4)
speeds = st.floats(-100.0, 100.0)


@given(st.floats(9.7, 9.9), latitudes, st.floats(0.0, 9e3), speeds, speeds)
def test_reductions_with_the_true_state_are_exact(gravity, latitude, height, north, east):
    at, disturbance = State(latitude, 2.5, height, north, east), gravity - normal_gravity(latitude)
    felt = GRAVITY.raw(gravity, at)
    assert DISTURBANCE.raw(disturbance, at) == pytest.approx(float(felt), abs=1e-14)
    assert GRAVITY.reduce(felt, at) == pytest.approx(gravity, abs=1e-14)
    assert DISTURBANCE.reduce(felt, at) == pytest.approx(disturbance, abs=1e-14)


@pytest.mark.parametrize("reduction", [GRAVITY, DISTURBANCE])
def test_reduction_variance_is_that_of_drawn_navigator_errors(reduction):
    random = np.random.default_rng(4)
    latitude, north, east, height_sigma, draws = -0.64, 12.0, 18.4, 2.0, 20000
    root = np.diag([2000.0, 500.0, 0.05, 0.08]) @ (
        np.eye(4) + 0.3 * random.standard_normal((4, 4))
    )
    error = random.standard_normal((draws, 4)) @ root.T
    height = height_sigma * random.standard_normal(draws)
    estimate = latitude + error[:, 0] / metres_per_radian(latitude)[0]
    at = State(latitude, 2.5, 100.0, north, east)
    felt = GRAVITY.raw(9.8, at)
    readings = reduction.reduce(
        felt, State(estimate, 2.5, 100.0 + height, north + error[:, 2], east + error[:, 3])
    )
    variance = reduction_variance(reduction, at, root @ root.T, height_sigma**2)
    assert within_chi_square((draws - 1) * readings.var(ddof=1) / variance, draws - 1)
    alone = reduction_variance(reduction, at, np.zeros((4, 4)), height_sigma**2)
    assert alone == pytest.approx((FREE_AIR * height_sigma) ** 2)


ARM = (4.0, 1.0, -2.0)


@pytest.mark.parametrize("kind", [GravityReduction, DisturbanceReduction])
def test_one_at_a_lever_arm(kind):
    """On a vehicle that is rolled by 90 degrees and turns about its down axis, by hand: the arm's
    right end is down, its top to the right; the turn's axis points to the west, and the inward
    acceleration of the arm's forward and right parts is along them."""
    turn = 0.02
    rolled = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    at = State(-0.6, 2.5, 100.0, 15.0, -8.0, rolled, np.array([0.0, 0.0, turn]))
    velocity = rolled @ np.cross([0.0, 0.0, turn], ARM)
    inward = rolled @ (-(turn**2) * np.array([ARM[0], ARM[1], 0.0]))
    there = State(-0.6, 2.5, 100.0 - ARM[1], 15.0 + velocity[0], -8.0 + velocity[1])
    read = float(kind(ARM).raw(9.8, at))
    assert read == pytest.approx(float(kind().raw(9.8, there)) - inward[2], abs=1e-15)
    assert abs(read - float(kind().raw(9.8, at))) > 2e-6
    assert float(kind(ARM).reduce(read, at)) == pytest.approx(9.8, abs=1e-14)
    level = at._replace(attitude=np.eye(3), turn=None)
    higher = float(kind(ARM).raw(9.8, level)) - float(kind().raw(9.8, level))
    assert higher == pytest.approx(-2.0 * 3.086e-6, rel=1e-3)


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


def test_errors_go_with_accelerations_in_turns_and_with_the_square_of_the_speed():
    trajectory = trajectory_of(waypoints=TURNS, duration=None)
    index = scans(trajectory)
    heading = np.unwrap(np.arctan2(*trajectory.velocity[index, 1::-1].T))
    turned = np.abs(np.diff(heading, prepend=heading[0]))  # in the interval before each

    def errors(runs, **keys):
        settings = Gravimeter(sigma=1e-12, **keys)
        each = [reading_errors(settings, RunScans(0, k, trajectory, index)) for k in range(runs)]
        return np.stack(each)

    coupled = errors(50, cross_coupling=1e-3)
    # half a coefficient of 1e-3 at 0.02 rad/s * 22 m/s = 0.44 m/s²
    assert coupled[:, turned > 0.05].std() > 2e-4
    assert np.abs(coupled[:, turned < 1e-3]).max() < 1e-5
    pressed = errors(400, dynamic_pressure=5e-3)
    np.testing.assert_allclose(pressed, np.tile(pressed[:, :1], len(index)), atol=1e-6)
    assert pressed[:, 0].std() == pytest.approx(5e-3 * 22.0**2, rel=0.1)


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


def levelling_of(runs, **keys):
    trajectory = build_trajectory(Scenario(route={"duration": 6000.0}))
    index = np.arange(10, len(trajectory) + 1, 10)
    return np.stack(
        [levelling_error(Gravimeter(**keys), RunScans(3, run, trajectory, index)) for run in runs]
    )


def test_its_mean_and_covariance_are_those_that_the_matcher_assumes():
    """60 runs of 6000 s, correlated over 150 s, so of some 1200 independent values; for a
    chi-square the standard error of a variance is 8 % then."""
    settings = Gravimeter(platform_tilt=2e-3)
    error = levelling_of(range(60), platform_tilt=2e-3)
    assert error.mean() == pytest.approx(mean_error(settings), rel=0.15)
    time, level = 10.0 * np.arange(60), np.tile([17.0, 13.0], (60, 1))
    assumed = noise_covariance(joined(noise_states(settings, time, level)), np.zeros(60), time)
    apart = error - mean_error(settings)
    for lag in (0, 1, 15, 30):
        measured = (apart[:, : apart.shape[1] - lag] * apart[:, lag:]).mean()
        assert measured == pytest.approx(assumed[0, lag], abs=0.25 * assumed[0, 0]), lag


def test_the_filter_is_that_of_scipy():
    """And starts settled."""
    time = np.arange(0.0, 600.0)
    signal = 3.0 + np.sin(time / 40.0) + 0.3 * np.cos(time / 9.0)
    _, expected, _ = lsim(lti([1.0], [25.0, 1.0]), signal - signal[0], time)
    np.testing.assert_allclose(low_pass(signal, 1.0, 25.0), signal[0] + expected, atol=1e-12)


def test_a_late_instrument_reads_what_was_once_its_filter_has_settled():
    time = np.arange(0.0, 201.0)
    signal = np.sin(time / 7.0)
    read = Lag(delay=12.5, filter_time=0.0).report(time, signal, np.array([5.0, 12.5, 40.0]))
    assert np.isnan(read[0])
    np.testing.assert_allclose(read[1:], np.interp([0.0, 27.5], time, signal))
    read = Lag(delay=5.0, filter_time=10.0).report(time, time, np.array([44.0, 45.0, 200.0]))
    assert np.isfinite(read).tolist() == [False, True, True]
    # of a ramp: the mean age is the delay and the time constant
    assert read[2] == pytest.approx(200.0 - 15.0, abs=1e-6)
