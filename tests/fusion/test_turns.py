"""How a vehicle on wheels turns while nothing measures it: the law, and a navigator's NEES."""

import math

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import normal_gravity_at
from isogal.fusion.assumed import filter_model
from isogal.fusion.measurements import VelocityReading
from isogal.fusion.outage import Turns, _steps, keep_going
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_rotation_vector, matrix
from isogal.navigator import Navigator
from isogal.scenario import load_scenario
from isogal.seeds import generator

CAR = load_scenario(
    None,
    [
        "imu.grade=phone",
        "imu.rate=1.0",
        "initial_error={position: 3, velocity: 0.3, tilt: 0.01, heading: 0.02}",
        "velocity={kind: wheels, sigma: 0.1, scale: 0, misalignment: 0}",
        "gravity={field: normal, compensation: none}",
    ],
)
MAP = field_map_of(wavy, half=5e3, step=500.0)
TURNS = Turns(0.036)
SPEED = 15.0
GRAVITY = float(normal_gravity_at(math.sin(ORIGIN[0]), 0.0))
BEFORE, GAP, AFTER = 10, 30, 3
"""s."""
SUB = 10
"""Steps of the truth in a second."""


@pytest.mark.parametrize("gap", [2.0, 12.0, 40.0])
def test_the_law_is_a_bridge(gap) -> None:
    """The integral of a Gaussian process between two values of it, by sums over 400 steps."""
    time = (np.arange(401) - 0.5) * gap / 400.0
    time = np.concatenate([[0.0, gap], time[1:]])
    K = TURNS.sigma**2 * np.exp(-np.abs(time[:, None] - time) / TURNS.time)
    sums = np.zeros((2, 402))
    sums[0, 2:], sums[1, 2:202] = gap / 400.0, gap / 400.0
    rates = np.array([0.1, -0.02])
    gain = np.linalg.solve(K[:2, :2], K[:2] @ sums.T).T
    mean, P = gain @ rates, sums @ K @ sums.T - gain @ K[:2] @ sums.T
    given = float(rates[0]), float(rates[1])
    assert TURNS.angle(gap, given, gap) == pytest.approx(mean[0], rel=1e-3)
    assert TURNS.angle(gap, given, gap / 2.0) == pytest.approx(mean[1], rel=1e-3)
    seen = rates @ np.linalg.solve(K[:2, :2], rates)
    scale = (TURNS.freedom - 2.0 + seen) / TURNS.freedom
    assert TURNS.variance(gap, given) == pytest.approx(scale * P[0, 0], rel=1e-3)


@pytest.mark.parametrize("seconds", [11.0, 30.0, 1000.0, 40_000.0])
def test_steps_cover_the_gap(seconds) -> None:
    for turns in (None, TURNS):
        ends = _steps(seconds, turns)
        assert ends[0] == 0.0 and ends[-1] == seconds
        assert np.diff(ends).min() > 0.0 and np.diff(ends).max() <= 10.0 + 1e-9


def test_a_turn_that_has_begun_goes_on() -> None:
    """It turns by the mean angle at a constant speed, to either side of which it is as likely."""
    start = Estimate(np.array([0.7, -1.3, 0.0]), np.array([SPEED, 0.0, 0.0]), np.eye(4)[0])
    state = FilterState.start(start, filter_model(CAR))
    keep_going(state, filter_model(CAR), 30.0, 0.0, None, TURNS, (0.2, 0.1))
    angle = TURNS.angle(30.0, (0.2, 0.1), 30.0)
    assert angle == pytest.approx(0.3 * TURNS.time, rel=0.01)
    forward = matrix(state.attitude)[:2, 0]
    assert math.atan2(forward[1], forward[0]) == pytest.approx(angle, abs=1e-3)
    np.testing.assert_allclose(state.velocity[:2], SPEED * forward, atol=0.02 * SPEED)


def turn_rates(random: np.random.Generator) -> np.ndarray:
    """Return (K,) turn rates of a vehicle, rad/s, for each step of the truth."""
    count = (BEFORE + GAP + AFTER) * SUB
    keep = math.exp(-1.0 / SUB / TURNS.time)
    rate = random.standard_normal(count)
    for k in range(1, count):
        rate[k] = keep * rate[k - 1] + math.sqrt(1.0 - keep**2) * rate[k]
    return TURNS.sigma * rate * math.sqrt((TURNS.freedom - 2.0) / random.chisquare(TURNS.freedom))


def after_gap(random: np.random.Generator) -> tuple[np.ndarray, float]:
    """Return the squares of the errors in heading and north and east, each over its variance, of a
    navigator after a gap, and the angle (rad) by which the vehicle turned in it."""
    rates = turn_rates(random)
    heading = np.concatenate([[0.0], np.cumsum(rates)]) / SUB
    middle = 0.5 * (heading[1:] + heading[:-1])
    place = SPEED / SUB * np.cumsum([np.cos(middle), np.sin(middle)], axis=1)
    off = np.array([0.0, 0.0, CAR.initial_error.heading * random.standard_normal()])
    attitude = np.array(from_rotation_vector(*off))
    start = Estimate(np.array([*ORIGIN, 0.0]), matrix(attitude) @ [SPEED, 0.0, 0.0], attitude)
    navigator = Navigator(CAR, [MAP], start)
    end, missing = BEFORE + GAP + AFTER, 0.0
    for k in range(1, end + 1):
        if BEFORE < k <= BEFORE + GAP:
            missing += 1.0
            continue
        turn = np.array([0.0, 0.0, rates[(k - 1) * SUB : k * SUB].mean()])
        force = np.array([0.0, SPEED * turn[2], -GRAVITY])
        navigator.imu(float(k), force, turn, 0.0, missing)
        forward = np.array([SPEED, math.nan, math.nan])
        navigator.measure(float(k), VelocityReading.of(CAR.velocity, forward, None, turn))
        missing = 0.0
    state = navigator.state
    metres = metres_per_radian(state.position[0], 0.0)
    error = (state.position[:2] - ORIGIN) * metres - place[:, -1]
    nose = matrix(state.attitude)[:2, 0]
    turned = math.remainder(math.atan2(nose[1], nose[0]) - heading[-1], math.tau)
    variance = state.covariance[[0, 1, 8], [0, 1, 8]]
    squares = np.square([*error, turned]) / variance
    inside = slice(BEFORE * SUB, (BEFORE + GAP) * SUB)
    return squares, float(rates[inside].sum() / SUB)


def test_nees_after_a_gap_in_which_the_vehicle_turns() -> None:
    """Of 200 gaps of half a minute, fixed seeds. The square of a Student t variable of six degrees
    of freedom has a mean of 1 and a standard deviation of sqrt(5): the mean of 200 lies between
    0.5 and 1.5 with three of its own. What a turn makes of the place is no Gaussian: up to 2."""
    drives = [after_gap(generator(seed, 0, "a car that turns")) for seed in range(200)]
    squares, turned = np.array([one[0] for one in drives]), np.array([one[1] for one in drives])
    assert (np.abs(turned) > 0.3).mean() > 0.2
    along, across, heading = squares.mean(axis=0)
    assert 0.5 < heading < 1.5
    assert 0.5 < across < 2.0
    assert 0.5 < along < 2.0
