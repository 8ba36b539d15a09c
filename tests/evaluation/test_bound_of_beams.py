"""The bound of an altimeter with several beams: what it is for one, and that more tell more."""

import numpy as np
import pytest

from helpers.sea_floor import SOUNDING, sea_floor
from isogal.evaluation.bound import posterior_cramer_rao
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory


@pytest.fixture(scope="module")
def floor():
    return sea_floor()


def bound_of(floor, *items):
    error = "map_error.sigma=2", "map_error.correlation_length=400", "gravimeter.bias=3"
    scenario = load_scenario(None, [*SOUNDING, *error, *items])
    return posterior_cramer_rao(scenario.true, build_trajectory(scenario), floor).rms


def test_one_beam_straight_down_is_a_clearance_meter(floor):
    one = bound_of(floor, "altimeter.directions=[[0, 0]]")
    np.testing.assert_allclose(one, bound_of(floor), rtol=1e-9)


def test_a_beam_twice_is_one_with_half_of_the_noise(floor):
    twice = bound_of(floor, "altimeter.directions=[[0, 0], [0, 0]]")
    better = bound_of(floor, f"gravimeter.sigma={0.5 / np.sqrt(2.0)}")
    np.testing.assert_allclose(twice, better, rtol=1e-9)


def test_more_beams_tell_more(floor):
    one, five, nine = (
        bound_of(floor, f"altimeter.beams={count}", "altimeter.opening=110")[-1]
        for count in (1, 5, 9)
    )
    assert nine < five < 0.8 * one
