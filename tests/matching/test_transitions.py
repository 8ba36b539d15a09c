"""The compiled loops of transitions against NumPy."""

import numpy as np

from isogal.earth.ellipsoid import radii
from isogal.earth.gravity import normal_gravity
from isogal.inertial.error_model import STATES, fill_dynamics
from isogal.matching.transitions import backwards, rates

TIME = np.array([0.0, 10.0, 25.0, 30.0, 50.0])
VELOCITY = np.array([[10.0, 5.0], [11.0, 4.0], [9.0, 6.0], [9.5, 6.5], [10.0, 7.0]])
LATITUDE = -0.6 + 1e-5 * np.arange(5)


def test_rates_are_those_of_numpy():
    np.testing.assert_allclose(rates(VELOCITY, TIME), np.gradient(VELOCITY, TIME, axis=0))
    assert not rates(VELOCITY[:1], TIME[:1]).any()


def test_backwards_is_a_product_of_exponentials_to_third_order():
    meridian, normal = radii(LATITUDE)
    force = np.column_stack([np.gradient(VELOCITY, TIME, axis=0), -normal_gravity(LATITUDE)])
    geometry = np.column_stack([LATITUDE, VELOCITY, 1.0 / meridian, 1.0 / normal])
    following, step = np.eye(7), np.diff(np.append(TIME, 60.0))
    got = backwards(LATITUDE, VELOCITY, TIME, 60.0)
    unit = np.array([10.0, 10.0, 0.1, 0.1, 1e-4, 1e-4, 1e-4])
    for i in range(4, -1, -1):
        dynamics = np.zeros((STATES, STATES))
        fill_dynamics(dynamics, geometry[i], force[i], np.eye(3))
        f = -step[i] * dynamics[:7, :7]
        following = (np.eye(7) + f + f @ f / 2.0 + f @ f @ f / 6.0) @ following
        difference = (got[i] - following) * unit / unit[:, None]
        np.testing.assert_allclose(difference, 0.0, atol=1e-12)
