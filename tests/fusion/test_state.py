"""What the filter assumes, and its state."""

import numpy as np

from helpers.navigators import SIGMA, error_between, fly, random_covariance
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.fields.known_gravity import KnownGravity, Residual
from isogal.fusion.assumed import filter_model
from isogal.fusion.measurements.information import update_information
from isogal.inertial.error_state import batch_difference
from isogal.scenario import Fusion, Imu, InitialError, Scenario


def test_model_agrees_with_what_the_scenario_draws_from():
    model = filter_model(
        Scenario(imu=Imu(rate=2.0), initial_error=InitialError(position=70.0, heading=0.0)),
        KnownGravity(residual=Residual(0.0, 1.0, sigma=3e-5, length=7e3)),
    )
    states = [(one.name, one.sigma, one.length) for one in model.auxiliary]
    assert states == [("gravity_north", 3e-5, 7e3), ("gravity_east", 3e-5, 7e3)]
    assert model.dt == 0.5
    assert model.initial_sigma[:2] == (70.0, 70.0)
    # a perfect start still has a positive definite covariance
    assert 0.0 < model.initial_sigma[8] < 1e-8
    assert model.initial_sigma[9:12] == Imu().sensors.accelerometer.bias
    assert model.noise[3:] == Imu().sensors.gyroscope.random_walk
    assert model.noise[2] > 100.0 * Imu().sensors.accelerometer.random_walk[2]  # unknown gravity


def test_turn_rate_is_relative_to_the_earth():
    """Level on a meridian, nose north: the Earth's rate is along the nose and upwards."""
    state = fly().start
    state.attitude[:], state.gyroscope_bias[:] = [1.0, 0.0, 0.0, 0.0], [1e-6, 2e-6, 3e-6]
    latitude = state.position[0]
    of_earth = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    measured = np.array([0.1, 0.2, 0.3]) + of_earth + [1e-6, 2e-6, 3e-6]
    np.testing.assert_allclose(state.turn_rate(measured), [0.1, 0.2, 0.3], rtol=1e-12)


def test_difference_of_estimates():
    flight = fly(fusion=Fusion(false_rejection=0.0))
    before = flight.start
    before.covariance[:] = random_covariance(SIGMA)
    before.position[1] = np.pi - 1e-6  # the update crosses the date line
    after = before.copy()
    told = np.array([-3e-3, -4e-3, -2.0, 1.0]), np.diag([1e-5, 1e-5, 10.0, 10.0])
    update_information(after, flight.model, *told)
    after.position[1] -= 2.0 * np.pi
    difference = batch_difference(after.estimate, before.estimate)
    after.position[1] += 2.0 * np.pi
    expected = error_between(after, before)[[0, 1, 3, 4, 6, 7, 8]]
    assert np.abs(expected[:2]).max() > 30.0
    # on the ellipsoid, not 100 m above it
    np.testing.assert_allclose(difference, expected, rtol=2e-5, atol=1e-9)
    assert before.batch_prior.shape == (7, 7)
    np.testing.assert_array_equal(before.batch_prior[4:, 4:], before.covariance[6:9, 6:9])
