"""What is still known after a time without inertial data, in which a vehicle on wheels may have
turned, and of a heading that is not known well."""

import math
from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.navigators import ROUTE, error_between, fly
from isogal.earth.ellipsoid import EARTH_RATE, metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.earth.gravity import normal_gravity_at
from isogal.fusion.alignment import UNKNOWN
from isogal.fusion.assumed import UNKNOWN_GRAVITY, filter_model
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import Outcome, PositionFix, VelocityReading
from isogal.fusion.measurements.trust import AGREEING, CONFIRMED
from isogal.fusion.outage import (
    HELD,
    MANOEUVRE,
    Turns,
    UnknownMotion,
    grow,
    outage_covariance,
)
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import cross_matrix, from_rotation_vector, matrix
from isogal.navigator import Navigator
from isogal.scenario import Velocity, changed_scenario, load_scenario
from isogal.seeds import generator

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 900.0}))


@pytest.mark.parametrize("seconds", [0.0, 30.0, 3600.0])
def test_growth(seconds) -> None:
    """Of a constant acceleration while it is short, and never faster than the vehicle."""
    P = outage_covariance(seconds, 20.0, UnknownMotion(0.1, 1e-3))
    assert np.linalg.eigvalsh(P).min() > -1e-9 * max(P.max(), 1.0)
    sigma = np.sqrt(np.diag(P))
    assert sigma[3] <= 20.0
    assert sigma[0] == pytest.approx(sigma[3] * seconds / 2.0)
    if seconds <= 30.0:
        assert sigma[3] == pytest.approx(0.1 * seconds, rel=0.02)
        assert sigma[8] == pytest.approx(1e-3 * seconds)
    assert sigma[8] <= 0.5


def test_a_manoeuvre_ends() -> None:
    """In a gap of three times as long as a manoeuvre lasts, at a time that is uniform in it: by
    simulation."""
    motion = UnknownMotion(0.02, 0.0).seen((np.zeros(3), np.zeros(3)), manoeuvre=True)
    assert motion.lasts == MANOEUVRE
    rng = np.random.default_rng(1)
    change = 0.02 * MANOEUVRE * rng.standard_normal(100_000)
    begun = rng.uniform(0.0, 2.0 * MANOEUVRE, change.size)
    moved = change * (3.0 * MANOEUVRE - begun - 0.5 * MANOEUVRE)
    P = outage_covariance(3.0 * MANOEUVRE, 1e3, motion)
    np.testing.assert_allclose(P[np.ix_([0, 3], [0, 3])], np.cov(moved, change), rtol=0.02)


def test_samples_at_either_side_say_how_steady_the_vehicle_was() -> None:
    nothing, unknown = np.zeros(3), UnknownMotion()
    steady = unknown.seen((nothing, nothing), manoeuvre=False)
    assert (steady.acceleration, steady.turn_rate, steady.tilt) == (0.0, 0.0, 0.0)
    turning = (np.array([0.0, 0.3, 0.0]), np.array([0.0, 0.0, 0.02]))
    seen = unknown.seen(turning, manoeuvre=False)
    assert (seen.acceleration, seen.turn_rate) == (0.3, 0.02)
    inside = unknown.seen((nothing, nothing), manoeuvre=True)
    assert (inside.acceleration, inside.turn_rate) == (0.1, 1e-3)
    # after the time between manoeuvres one has come with 1 - 1/e
    (without, _), (one, _) = unknown.possible(600.0, (nothing, nothing), (0.0, 0.0))
    assert np.exp(one) == pytest.approx(1.0 - np.exp(-1.0))
    assert np.exp(without) + np.exp(one) == pytest.approx(1.0)


@pytest.mark.parametrize("gap", [3, 60, 600])
def test_a_gap_widens_the_filter_and_is_replayed_for_a_late_fix(gap) -> None:
    ends = []
    for late in (False, True):
        it = InertialNavigator(FLIGHT.model, FLIGHT.start)
        fix = FLIGHT.fix(50, 20.0, -10.0)
        for k in [*range(100), *range(100 + gap, 130 + gap)]:
            missing = float(gap) if k == 100 + gap else 0.0
            it.imu(k + 1.0, *FLIGHT.samples(k, k + 1), missing)
            if k + 1 == (120 + gap if late else 50):
                assert it.measure(50.0, PositionFix(*fix, 400.0 * np.eye(2))).used
        ends.append(it.state)
    assert np.abs(error_between(*ends)).max() < 1e-12
    sigma = np.sqrt(np.diag(ends[0].covariance))
    change = tuple(part[100 + gap] - part[99] for part in (FLIGHT.force, FLIGHT.rate))
    motion = UnknownMotion().seen(change, manoeuvre=gap > HELD)
    added = np.sqrt(np.diag(outage_covariance(float(gap), ROUTE.speed, motion)))
    assert sigma[0] >= added[0]
    # with the height known the vertical force tells the east velocity by its Eötvös term, as well
    # as unknown gravity lets it in the 30 s since
    eotvos = 2.0 * EARTH_RATE * np.cos(ends[0].position[0])
    told = UNKNOWN_GRAVITY / np.sqrt(30.0) / eotvos
    assert sigma[4] >= 0.98 / np.hypot(1.0 / max(added[4], 1e-9), 1.0 / told)
    truth = FLIGHT.fix(130 + gap, 0.0, 0.0)
    off = horizontal_difference(*ends[0].position[:2], *truth)
    assert np.hypot(*off) < 3.0 * np.hypot(*sigma[:2])
    assert (gap > HELD) == (gap >= 60)


WHEELS = load_scenario(
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
    off = np.array([0.0, 0.0, WHEELS.initial_error.heading * random.standard_normal()])
    attitude = np.array(from_rotation_vector(*off))
    start = Estimate(np.array([*ORIGIN, 0.0]), matrix(attitude) @ [SPEED, 0.0, 0.0], attitude)
    navigator = Navigator(WHEELS, [MAP], start)
    end, missing = BEFORE + GAP + AFTER, 0.0
    for k in range(1, end + 1):
        if BEFORE < k <= BEFORE + GAP:
            missing += 1.0
            continue
        turn = np.array([0.0, 0.0, rates[(k - 1) * SUB : k * SUB].mean()])
        force = np.array([0.0, SPEED * turn[2], -GRAVITY])
        navigator.imu(float(k), force, turn, 0.0, missing)
        forward = np.array([SPEED, math.nan, math.nan])
        navigator.measure(float(k), VelocityReading.of(WHEELS.velocity, forward, None, turn))
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


UNSURE = [
    "initial_error={position: 10, velocity: 0.05, tilt: 0.01, heading: 0.4}",
    "velocity={kind: odometer, sigma: 0.1, scale: 0, misalignment: 0}",
]
CAR = changed_scenario(WHEELS, UNSURE, "test")
MODEL = filter_model(CAR)


CARRIED = Velocity(standstill_speed=0.1, standstill_sigma=0.05, standstill_rate=6e-4)


def moving(*velocity: float, model=MODEL) -> FilterState:
    """A vehicle whose nose points north, with a velocity NED, m/s."""
    start = Estimate(np.array([0.7, -1.3, 0.0]), np.array(velocity), np.eye(4)[0])
    return FilterState.start(start, model)


def test_stops_and_starts_do_not_tell_the_heading():
    """From rest, 20 m/s straight on with one stop: nothing says where north is."""
    navigator = InertialNavigator(MODEL, moving(0.0, 0.0, 0.0))
    speed, sigma = 0.0, []
    for k in range(1, 61):
        before = speed
        speed = 20.0 * min(1.0, abs((k + 30) % 60 - 30) / 10.0)
        force = np.array([speed - before, 0.0, -9.8])
        navigator.imu(float(k), force, np.zeros(3), 0.0)
        reading = VelocityReading.of(CAR.velocity, np.array([speed, 0.0, math.nan]))
        navigator.measure(float(k), reading)
        sigma.append(math.sqrt(navigator.state.covariance[8, 8]))
    # of 0.4 rad; with errors that are not re-expressed 0.15, with sigma points far out 0.19
    assert sigma[-1] > 0.3


def test_a_standstill_does_not_tell_the_heading():
    """Of a vehicle that its accelerometers still have moving at 4 m/s."""
    state = moving(4.0, 0.0, 0.0)
    state.covariance[3:6, 3:6] = np.diag([4.0, 0.01, 0.01])
    across = cross_matrix(state.velocity)  # what a wrong heading does to the velocity
    state.covariance[3:6] -= across @ state.covariance[6:9]
    state.covariance[:, 3:6] -= state.covariance[:, 6:9] @ across.T
    before = state.covariance[8, 8]
    reading = VelocityReading(np.zeros(3), np.eye(3), Velocity(standstill_speed=1.0))
    assert reading.update(state, MODEL).used
    np.testing.assert_allclose(state.velocity, 0.0, atol=0.01)
    assert state.covariance[8, 8] == pytest.approx(before, rel=0.01)


def test_a_car_may_have_turned_while_samples_were_missing():
    wheels = changed_scenario(CAR, ["velocity.kind=wheels"], "test")
    assert UnknownMotion().of_vehicle(CAR.velocity_aids) == UnknownMotion()
    model = filter_model(wheels)
    state = moving(15.0, 0.0, 0.0, model=model)
    state.covariance[8, 8] = 1e-4
    motion = UnknownMotion().of_vehicle(wheels.velocity_aids)
    navigator = InertialNavigator(model, state, motion=motion)
    navigator.imu(31.0, np.array([0.0, 0.0, -9.8]), np.zeros(3), 0.0, missing=30.0)
    assert not navigator.undecided
    straight = motion.turns.variance(30.0, (0.0, 0.0))
    assert navigator.state.covariance[8, 8] == pytest.approx(straight, rel=0.01)
    # one that is in a turn afterwards may have come round any corner; no filter that takes its
    # heading to be known holds more
    for heading in (0.5, UNKNOWN):
        motion = replace(motion, heading=heading)
        navigator = InertialNavigator(model, state, motion=motion)
        turning = np.array([0.0, 0.0, 0.3])
        navigator.imu(31.0, np.array([0.0, 4.5, -9.8]), turning, 0.0, missing=30.0)
        sigma = math.sqrt(navigator.state.covariance[8, 8])
        assert sigma == pytest.approx(heading, rel=0.02)


@pytest.mark.parametrize(("speed", "few"), [(0.0, CONFIRMED), (15.0, AGREEING)])
def test_wheels_that_stand_of_a_vehicle_that_is_carried(speed, few):
    """From 15 m/s to nothing within a second, or at rest, and then turning for a while."""
    state = moving(speed, 0.0, 0.0)
    before = state.copy()

    def stands(rate: float, readings: int) -> set[Outcome]:
        reading = VelocityReading(np.zeros(3), np.eye(3), CARRIED, np.array([0.0, 0.0, rate]))
        return {reading.update(state, MODEL).outcome for _ in range(readings)}

    assert stands(0.0, few) == {Outcome.UNTRUSTED}
    np.testing.assert_array_equal(state.covariance, before.covariance)
    state.velocity[0] = 0.0
    assert stands(0.0, 1) == {Outcome.USED}
    assert np.sqrt(state.covariance[3, 3]) < 0.06
    assert stands(0.02, 10) == stands(0.0, CONFIRMED - 1) == {Outcome.UNTRUSTED}
    assert stands(0.0, 1) == {Outcome.USED}


def test_a_car_goes_where_it_has_turned_to():
    """In a gap of 20 s, at a time that is uniform in it, by 0.3 rad: by simulation."""
    state = moving(9.0, 12.0, 0.0)
    before = state.covariance.copy()
    grow(state, 20.0, UnknownMotion(0.0, 0.015, turns=Turns(0.0)))
    rng = np.random.default_rng(1)
    heading = 0.3 * rng.standard_normal(1_000_000)
    shorter = (1.0 - np.cos(heading))[:, None] * rng.choice([-1.0, 1.0], (1_000_000, 1))
    velocity = heading[:, None] * [-12.0, 9.0] + shorter * [9.0, 12.0]
    place = velocity * rng.uniform(0.0, 20.0, (1_000_000, 1))
    expected = np.cov(np.column_stack([place, velocity, heading]).T)
    faster = moving(9.0, 12.0, 0.0)
    grow(faster, 20.0, UnknownMotion(0.1, 1e-3))
    assert not (faster.covariance - before)[[2, 5]].any()  # the height is known
    states = [0, 1, 3, 4, 8]
    found = (state.covariance - before)[np.ix_(states, states)]
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose((found - expected) / np.outer(scale, scale), 0.0, atol=0.02)
