"""The simulated vehicle."""

from itertools import pairwise

import numpy as np
import pytest

from isogal.earth.frames import horizontal_difference
from isogal.fields.simulated_vehicle import simulate_vehicle
from isogal.inertial.rotations import multiply, to_rotation_vector
from isogal.scenario import load_scenario

ROUTE = "[[-37.0, 145.0, 20], [-36.99, 145.0, 20], [-36.99, 145.02, 20]]"


@pytest.fixture(scope="module")
def vehicle():
    settings = [f"route.waypoints={ROUTE}", "route.duration=120.0", "imu.rate=10.0"]
    scenario = load_scenario(None, settings)
    return simulate_vehicle(scenario, scenario.true, 0)


def test_the_turn_rate_is_that_of_the_attitude(vehicle):
    """Relative to north, east, down, which turn by less than 1e-5 rad/s at this speed."""
    q = vehicle.states[:, 6:]
    steps = [
        np.array(to_rotation_vector(*multiply(w, -x, -y, -z, *after)))
        for (w, x, y, z), after in pairwise(q)
    ]
    rate = np.array(steps) / vehicle.trajectory.dt
    assert np.abs(rate[:, 2]).max() > 0.01  # it does turn
    np.testing.assert_allclose(vehicle.turn_rate[1:], rate, atol=1e-5)
    off = horizontal_difference(*vehicle.unaided[0], *vehicle.states[0, :2])
    assert 0.0 < np.hypot(*off) < 300.0  # the initial error's 1-sigma is 50 m
