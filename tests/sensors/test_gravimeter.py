"""Measured gravity, its reductions and their derivatives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.aids import in_turns
from helpers.statistics import within_chi_square
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import FREE_AIR, normal_gravity
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulator import true_readings
from isogal.inertial.rotations import matrix
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction
from isogal.sensors.reduction import State, reduction_variance
from isogal.sensors.satellites import turn_rates

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


def test_felt_gravity():
    # 31 mGal less at 100 m (free air); about 220 mGal less on the default course, as motion to the
    # east reduces gravity (Eötvös)
    still = GRAVITY.raw(9.8, State(-0.64, 2.5, 100.0, 0.0, 0.0))
    assert (still - 9.8) / 1e-5 == pytest.approx(-30.86)
    course = np.radians(57.0)
    moving = GRAVITY.raw(
        9.8, State(-0.64, 2.5, 100.0, 22.0 * np.cos(course), 22.0 * np.sin(course))
    )
    assert (moving - still) / 1e-5 == pytest.approx(-220.0, abs=10.0)


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


def test_a_simulated_reading_at_a_lever_arm_is_reduced_to_the_map():
    """What simulator and reduction know of the arm is the same; what it amounts to is not small:
    the arm is 2 m above the inertial sensors, and swings in turns."""
    plain, trajectory = in_turns("gravity.field=normal")
    with_arm, _ = in_turns("gravity.field=normal", "gravimeter.lever_arm=[40, 0, -2]")
    field_map = map_for_scenario(plain, trajectory)
    sensed = [true_readings(one.true, trajectory, field_map) for one in (plain, with_arm)]
    apart = sensed[1] - sensed[0]
    assert np.median(apart) == pytest.approx(-2.0 * 3.086e-6, rel=0.2)
    assert np.ptp(apart) > 1e-5  # by the Eötvös effect of turns
    i = np.arange(10, len(trajectory) + 1, 10)
    at = State(
        trajectory.latitude[i], trajectory.longitude[i], trajectory.height[i],
        *trajectory.velocity[i, :2].T, matrix(trajectory.attitude[i]), turn_rates(trajectory)[i],
    )  # fmt: skip
    reduced = GravityReduction(with_arm.gravimeter.lever_arm).reduce(sensed[1], at)
    np.testing.assert_allclose(reduced, GravityReduction().reduce(sensed[0], at), atol=1e-12)
