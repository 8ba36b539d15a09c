"""Measured gravity, its reductions and their derivatives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.statistics import within_chi_square
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import FREE_AIR, normal_gravity
from isogal.sensors.gravimeter import DisturbanceReduction, GravityReduction
from isogal.sensors.reduction import State, reduction_variance

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
