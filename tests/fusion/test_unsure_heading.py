"""A navigator that does not know its heading well: what an odometer tells of it, and what a
vehicle at rest, and samples that say their own noise."""

import math
from dataclasses import replace

import numpy as np
import pytest

from helpers.navigators import error_between, fly
from isogal.fusion.alignment import UNKNOWN
from isogal.fusion.assumed import filter_model
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import AtRest, Outcome, SampleNoise, VelocityReading
from isogal.fusion.measurements.trust import AGREEING, CONFIRMED
from isogal.fusion.outage import Turns, UnknownMotion, grow
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import cross_matrix
from isogal.scenario import changed_scenario, load_scenario

CAR = load_scenario(
    None,
    [
        "imu.grade=phone",
        "initial_error={position: 10, velocity: 0.05, tilt: 0.01, heading: 0.4}",
        "velocity={kind: odometer, sigma: 0.1, scale: 0, misalignment: 0}",
        "gravity={field: normal, compensation: none}",
    ],
)
FLIGHT = fly()
MODEL = filter_model(CAR)


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
    reading = VelocityReading(np.zeros(3), np.eye(3), math.inf, 0.05)
    assert reading.update(state, MODEL).used
    np.testing.assert_allclose(state.velocity, 0.0, atol=0.01)
    assert state.covariance[8, 8] == pytest.approx(before, rel=0.01)


def test_a_sample_of_more_noise_turns_the_covariance_alone():
    state, before = FLIGHT.start.copy(), FLIGHT.start
    SampleNoise(np.array([0.0, 0.0, 0.04]), 1.0).update(state, FLIGHT.model)
    assert state.covariance[8, 8] - before.covariance[8, 8] == pytest.approx(0.04, rel=1e-3)
    assert not error_between(state, before).any()
    with pytest.raises(ValueError, match="not finite"):
        SampleNoise(np.array([0.0, 0.0, math.nan]), 1.0).update(state, FLIGHT.model)


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
        gyroscopes = AtRest.of_gyroscopes(np.array([0.0, 0.0, rate]), 6e-4)
        reading = VelocityReading(np.zeros(3), np.eye(3), 0.1, 0.05, gyroscopes)
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
    states = [0, 1, 3, 4, 8]
    found = (state.covariance - before)[np.ix_(states, states)]
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose((found - expected) / np.outer(scale, scale), 0.0, atol=0.02)
