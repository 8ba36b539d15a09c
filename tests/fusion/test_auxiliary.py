"""Auxiliary states of the filter: against filterpy with a sigma point for each, and against the
processes that they stand for."""

import dataclasses
import math

import numpy as np
import pytest

from helpers.navigators import SIGMA, error_between, fly, random_covariance
from isogal.fields.known_gravity import KnownGravity, Residual
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.model import FilterModel
from isogal.fusion.navigator import assume_map_error, propagate, update_linear
from isogal.fusion.state import FilterState

# The filter is compiled for each number of states, ten seconds each: eight auxiliary states, as
# with a barometer and a log, and two, as where the map says its error, are compiled anyway.
EVERY_KIND = (
    AuxiliaryState("gravity_north", "gravity", 0, 2e-4, length=8e3),
    AuxiliaryState("gravity_down", "gravity", 2, 3e-4, length=9e3, time=900.0),
    AuxiliaryState("accelerometer_y", "accelerometer", 1, 1e-4, time=300.0),
    AuxiliaryState("gyroscope_x", "gyroscope", 0, 1e-7, time=600.0, walk=1e-10),
    AuxiliaryState("gyroscope_scale_z", "gyroscope_scale", 2, 1e-3),
    AuxiliaryState("barometer_bias", "none", 0, 5.0, walk=0.1),
    AuxiliaryState("gyroscope_misalignment", "gyroscope_scale", 0, 1e-5, source=2),
    AuxiliaryState("accelerometer_misalignment", "accelerometer_scale", 1, 1e-5, source=0),
)
SPARE = AuxiliaryState("spare", "none", 0, 1.0)
"""Does nothing."""


def with_states(states, filter_name="compiled") -> FilterModel:
    plain = fly().model
    return dataclasses.replace(plain, auxiliary=tuple(states), filter=filter_name)


def start(model: FilterModel, seed: int = 3) -> FilterState:
    """A start with a full covariance, and auxiliary states that are not zero."""
    plain = fly().start
    sigma = np.array([*SIGMA, *(state.sigma for state in model.auxiliary)])
    means = sigma[15:] * np.random.default_rng(seed).standard_normal(len(sigma) - 15)
    return dataclasses.replace(
        plain, auxiliary=means[None], covariance=random_covariance(sigma, seed)[None]
    )


@pytest.mark.parametrize("count", [2, 8])
def test_every_kind_equals_a_filter_with_sigma_points_for_all_states(count):
    flight = fly()
    force = flight.imu.specific_force[:, :20].copy()
    force[..., 0] += 0.5  # scale factors have something to act on
    rate = flight.imu.angular_rate[:, :20] + [0.0, 0.0, 0.01]
    ends = []
    for name in ("compiled", "reference"):
        model = with_states(EVERY_KIND[:count], name)
        state = start(model)
        propagate(state, model, force, rate, flight.trajectory.height[1:21])
        ends.append(state)
    sigma = np.sqrt(np.diag(ends[1].covariance[0]))
    # the columns of auxiliary states leave out what a turning body does within a second
    np.testing.assert_allclose(error_between(*ends) / sigma, 0.0, atol=1.2e-4)
    np.testing.assert_allclose(
        (ends[0].covariance[0] - ends[1].covariance[0]) / sigma / sigma[:, None], 0.0, atol=1.2e-4
    )


def test_a_steady_process_keeps_its_variance_and_forgets_its_value():
    states = (AuxiliaryState("a", "none", 0, 2.0, time=50.0), SPARE)
    model, flight = with_states(states), fly()
    state = start(model)
    state.covariance[0, 15, :] = state.covariance[0, :, 15] = 0.0
    state.covariance[0, 15, 15], state.auxiliary[0, 0] = 4.0, 3.0
    propagate(
        state,
        model,
        flight.imu.specific_force[:, :100],
        flight.imu.angular_rate[:, :100],
        flight.trajectory.height[1:101],
    )
    assert state.covariance[0, 15, 15] == pytest.approx(4.0)
    assert state.auxiliary[0, 0] == pytest.approx(3.0 * math.exp(-2.0))


def test_linear_update_equals_the_kalman_filter():
    model = with_states(EVERY_KIND)
    state = start(model)
    before = state.copy()
    random = np.random.default_rng(0)
    sigma = np.array([*SIGMA, *(one.sigma for one in EVERY_KIND)])
    H = random.standard_normal((2, len(sigma))) / sigma
    R, z = np.array([[1.0, 0.3], [0.3, 2.0]]), np.array([0.7, -1.2])
    error, nis = update_linear(state, 0, H, z, R)
    P = before.covariance[0]
    S = H @ P @ H.T + R
    gain = np.linalg.solve(S, H @ P).T
    np.testing.assert_allclose(error / sigma, gain @ z / sigma, atol=1e-9)
    np.testing.assert_allclose(error_between(state, before) / sigma, gain @ z / sigma, atol=1e-6)
    np.testing.assert_allclose(
        state.covariance[0] / sigma / sigma[:, None],
        (P - gain @ H @ P) / sigma / sigma[:, None],
        atol=1e-8,
    )
    assert nis == pytest.approx(float(z @ np.linalg.solve(S, z)))


def test_a_measurement_that_is_not_finite_changes_nothing():
    model = with_states(EVERY_KIND[:1])
    state = start(model)
    before = state.copy()
    H = np.zeros((1, 16))
    for innovation, R in ((np.nan, 1.0), (1.0, np.inf), (1.0, -1.0)):
        with pytest.raises(ValueError):
            update_linear(state, 0, H, np.array([innovation]), np.array([[R]]))
    for array, old in zip(state.arrays(), before.arrays(), strict=True):
        np.testing.assert_array_equal(array, old)


@pytest.mark.parametrize("filter_name", ["compiled", "reference"])
def test_gravity_states_go_by_what_has_been_learnt(filter_name):
    """A run whose residual gravity was learnt propagates as under a model that knows it; one of
    which nothing was learnt, beside it, as under its own."""
    told = (AuxiliaryState("gravity_north", "gravity", 0, 2e-5, length=4e3), SPARE)
    true = (AuxiliaryState("gravity_north", "gravity", 0, 2e-4, length=9e3), SPARE)
    flight, steps = fly(), 20
    ends = []
    for states, residual in ((told, [[2e-4, 9e3], [0.0, 0.0]]), (true, None), (told, None)):
        model = with_states(states, filter_name)
        one = start(with_states(told))
        runs = 1 if residual is None else 2
        state = FilterState(*(np.repeat(array, runs, axis=0) for array in one.arrays()))
        if residual is not None:
            state.residual_gravity[:] = residual
        force, rate = (
            np.repeat(array[:, :steps], runs, axis=0)
            for array in (flight.imu.specific_force, flight.imu.angular_rate)
        )
        propagate(state, model, force, rate, flight.trajectory.height[1 : 1 + steps])
        ends.append(state)
    assert ends[1].covariance[0, 15, 15] > 1.5 * ends[2].covariance[0, 15, 15]
    for row, expected in enumerate(ends[1:]):
        np.testing.assert_array_equal(ends[0].covariance[row], expected.covariance[0])
        np.testing.assert_array_equal(ends[0].position[row], expected.position[0])


def test_a_map_error_is_the_navigators_residual_gravity():
    model = with_states((AuxiliaryState("gravity_north", "gravity", 0, 2e-5, length=4e3), SPARE))
    state = start(model)
    assume_map_error(state, model, 0, 8e-5, 5e3)  # has no map to take off
    assert not state.residual_gravity.any()
    model = dataclasses.replace(model, gravity=KnownGravity(residual=Residual(0.0, 1.0)))
    assume_map_error(state, model, 0, 8e-5, 5e3)
    sigma, length = state.residual_gravity[0]
    assert (sigma, length) == pytest.approx((np.hypot(8e-5 / np.sqrt(2.0), 1e-6), 5e3))
    for wrong in ((0.0, 5e3), (np.nan, 5e3), (1e-5, np.inf)):
        with pytest.raises(ValueError, match="map error"):
            assume_map_error(state, model, 0, *wrong)
    assert tuple(state.residual_gravity[0]) == (sigma, length)


def test_felt_gravity_that_is_known_to_a_state_moves_the_estimate():
    """A constant residual of 1e-3 m/s² over 100 s: half a t squared, 5 m."""
    states = (AuxiliaryState("gravity_north", "gravity", 0, 1e-3), SPARE)
    model, flight = with_states(states), fly()
    ends = []
    for value in (0.0, 1e-3):
        state = dataclasses.replace(
            flight.start.copy(),
            auxiliary=np.array([[value, 0.0]]),
            covariance=np.diag(np.square([*model.initial_sigma, 1e-3, 1.0]))[None],
        )
        propagate(
            state,
            model,
            flight.imu.specific_force[:, :100],
            flight.imu.angular_rate[:, :100],
            flight.trajectory.height[1:101],
        )
        ends.append(state)
    moved = error_between(ends[1], ends[0])
    assert moved[0] == pytest.approx(5.0, rel=0.01)
    assert moved[3] == pytest.approx(0.1, rel=0.01)
