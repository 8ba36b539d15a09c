"""A late fix equals an on-time fix, bit for bit, in any order of arrival; what cannot be used
changes nothing."""

import re
from itertools import permutations

import numpy as np
import pytest

from helpers.navigators import ROUTE, error_between, fly
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.navigator import (
    propagate,
    update_information,
    update_position,
    widen,
)
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import batch_covariance, batch_difference

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 120.0}))
R = np.array([[40.0**2, 300.0], [300.0, 25.0**2]])
FIXES = {20: (30.0, -40.0), 50: (-25.0, 10.0), 90: (15.0, 20.0)}
"""Stamp -> metres from the truth."""


def navigator(**keys) -> BufferedNavigator:
    return BufferedNavigator(FLIGHT.model, FLIGHT.start.copy(), **keys)


def advance(it: BufferedNavigator, until: int) -> None:
    for k in range(round(it.time), until):
        it.propagate(
            k + 1.0,
            FLIGHT.imu.specific_force[0, k],
            FLIGHT.imu.angular_rate[0, k],
            FLIGHT.trajectory.height[k + 1],
        )


def reference(until: int, fixes) -> FilterState:
    """The same by the functions of `fusion.navigator`, in order of the stamps."""
    state = FLIGHT.start.copy()
    for k in range(until):
        force, rate = (
            FLIGHT.imu.specific_force[:, k : k + 1],
            FLIGHT.imu.angular_rate[:, k : k + 1],
        )
        propagate(state, FLIGHT.model, force, rate, FLIGHT.trajectory.height[k + 1 : k + 2])
        for update in fixes.get(k + 1, []):
            update(state)
    return state


def position_fix(stamp: int):
    fix = FLIGHT.fix(stamp, *FIXES[stamp])
    return lambda state: update_position(state, FLIGHT.model, 0, *fix, R)


def information_at(state: FilterState, stamp: int, attitude: bool = False):
    """The information that a fix holds on the error of a state; its attitude is compared with that
    of an unaided one."""
    metres = metres_per_radian(state.position[0, 0], state.position[0, 2])
    error = (state.position[0, :2] - FLIGHT.fix(stamp, *FIXES[stamp])) * metres
    M = np.zeros((4, 4))
    M[:2, :2] = np.linalg.inv(R)
    M[2:, 2:] = np.eye(2) / 0.1**2
    error = np.append(
        error, state.velocity[0, :2] - FLIGHT.trajectory.velocity[stamp, :2] - [0.02, -0.01]
    )
    if attitude:
        unaided = reference(stamp, {}).estimate_of(0)
        turn = batch_difference(state.estimate_of(0), unaided)[4:]
        M = np.block([[M, np.zeros((4, 3))], [np.zeros((3, 4)), np.eye(3) / 1e-4**2]])
        M[4, 0] = M[0, 4] = 0.3 * np.sqrt(M[0, 0] * M[4, 4])
        error = np.append(error, turn + np.array([2e-5, -1e-5, 1e-5]))
    return M @ error, M


def identical(a: FilterState, b: FilterState) -> bool:
    return all((x == y).all() for x, y in zip(a.arrays(), b.arrays(), strict=True))


@pytest.mark.parametrize("arrival", [20, 21, 50, 120])
def test_late_position_fix_equals_on_time(arrival):
    it = navigator()
    advance(it, arrival)
    result = it.update_position(20.0, *FLIGHT.fix(20, *FIXES[20]), R)
    assert (result.accepted, result.reason, result.late) == (True, None, arrival - 20.0)
    advance(it, 120)
    assert identical(it.state, reference(120, {20: [position_fix(20)]}))
    before = reference(20, {})
    innovation, nis = position_fix(20)(before)
    assert (result.innovation == innovation).all()
    assert result.nis == nis


@pytest.mark.parametrize("lost", [None, batch_covariance(3000.0, 0.5, 1e-4, 0.0)])
@pytest.mark.parametrize("arrival", [50, 51, 120])
def test_late_information_equals_on_time(arrival, lost):
    state = reference(50, {})
    vector, M = information_at(state, 50)

    def on_time(state: FilterState) -> None:
        if lost is not None:
            widen(state, 0, lost)
        update_information(state, 0, vector, M)

    it = navigator()
    advance(it, arrival)
    if lost is not None:
        assert it.widen(50.0, lost).accepted
    assert it.update_information(50.0, vector, M).accepted
    advance(it, 120)
    assert identical(it.state, reference(120, {50: [on_time]}))


@pytest.mark.parametrize("order", list(permutations(FIXES)))
def test_position_fixes_in_any_order_of_arrival(order):
    it = navigator()
    for arrival, stamp in zip((95, 100, 110), order, strict=True):
        advance(it, arrival)
        assert it.update_position(float(stamp), *FLIGHT.fix(stamp, *FIXES[stamp]), R).accepted
    advance(it, 120)
    assert identical(it.state, reference(120, {stamp: [position_fix(stamp)] for stamp in FIXES}))


@pytest.mark.parametrize("attitude", [False, True])
@pytest.mark.parametrize("order", list(permutations(FIXES)))
def test_information_in_any_order_of_arrival(order, attitude):
    """Each piece refers to the estimate of its stamp when it comes, whatever older ones change
    later."""
    expected = navigator()
    for stamp in FIXES:
        advance(expected, stamp)
        expected.update_information(float(stamp), *information_at(expected.state, stamp, attitude))
    advance(expected, 120)
    it = navigator()
    advance(it, 95)
    for stamp in order:
        seen = reference_of(it, stamp)
        assert it.update_information(float(stamp), *information_at(seen, stamp, attitude)).accepted
    advance(it, 120)
    scale = np.sqrt(np.diag(expected.state.covariance[0]))
    apart = error_between(it.state, expected.state) / scale
    assert (
        np.abs(apart).max() < 1e-4
    )  # the fix is linear in the error, metres are not quite linear in the place
    unlike = (it.state.covariance[0] - expected.state.covariance[0]) / scale / scale[:, None]
    assert np.abs(unlike).max() < 1e-6


def reference_of(it: BufferedNavigator, stamp: int) -> FilterState:
    return next(step.belief.merged for step in it._steps if step.time == stamp)


def test_two_fixes_of_one_stamp_in_either_order():
    other = np.diag([60.0**2, 10.0**2])
    ends = []
    for order in ((0, 1), (1, 0)):
        it = navigator()
        advance(it, 30)
        for i in order:
            it.update_position(
                20.0, *FLIGHT.fix(20, *((30.0, -40.0), (5.0, 8.0))[i]), (R, other)[i]
            )
        ends.append(it.state)
    deviation = np.sqrt(np.diag(ends[0].covariance[0]))
    np.testing.assert_allclose(error_between(ends[0], ends[1]) / deviation, 0.0, atol=1e-4)
    np.testing.assert_allclose(
        (ends[0].covariance - ends[1].covariance)[0] / deviation / deviation[:, None],
        0.0,
        atol=1e-6,
    )


@pytest.mark.parametrize(("stamp", "sample"), [(19.6, 20), (20.4, 20), (20.6, 21)])
def test_a_stamp_between_samples_counts_at_the_nearest(stamp, sample):
    it = navigator()
    advance(it, 40)
    fix = FLIGHT.fix(20, *FIXES[20])
    assert it.update_position(stamp, *fix, R).accepted
    assert identical(
        it.state,
        reference(40, {sample: [lambda state: update_position(state, FLIGHT.model, 0, *fix, R)]}),
    )


@pytest.mark.parametrize(("stamp", "covariance", "reason"), [
    (41.0, R, r"fix of 41\.0 s is ahead of the navigator \(40\.0 s\)"),
    (5.0, R, r"fix of 5\.0 s is older than the buffer \(\d+\.\d s\)"),
    (np.nan, R, "older than the buffer"),
    (20.0, np.full((2, 2), np.nan), "fix is not finite"),
    (20.0, -R, "covariance of the fix is not positive definite"),
])  # fmt: skip
def test_a_refused_fix_changes_nothing(stamp, covariance, reason):
    it = navigator(horizon=25.0)
    advance(it, 35)
    it.update_position(30.0, *FLIGHT.fix(20, *FIXES[20]), R)
    advance(it, 40)
    before = it.state.copy()
    result = it.update_position(stamp, *FLIGHT.fix(20, 0.0, 0.0), covariance)
    assert not result.accepted
    assert result.reason is not None
    assert np.isnan(result.nis)
    assert np.isnan(result.innovation).all()
    assert re.search(reason, result.reason)
    assert identical(it.state, before)
    advance(it, 45)
    fresh = navigator(horizon=25.0)
    advance(fresh, 35)
    fresh.update_position(30.0, *FLIGHT.fix(20, *FIXES[20]), R)
    advance(fresh, 45)
    assert identical(it.state, fresh.state)


@pytest.mark.parametrize("stamp", [35, 40])
def test_refused_information_changes_nothing(stamp):
    it = navigator()
    advance(it, 40)
    before = it.state.copy()
    result = it.update_information(float(stamp), np.ones(4), np.diag([1.0, 1.0, -1e6, 1.0]))
    assert not result.accepted
    assert identical(it.state, before)


def test_the_horizon_is_kept():
    it = navigator(horizon=30.0)
    advance(it, 100)
    assert it.update_position(71.0, *FLIGHT.fix(71, 1.0, 1.0), R).accepted
    assert it.update_position(70.0, *FLIGHT.fix(70, 1.0, 1.0), R).accepted
    assert not it.update_position(60.0, *FLIGHT.fix(60, 1.0, 1.0), R).accepted


@pytest.mark.parametrize(("time", "force", "height", "message"), [
    (10.0, 0.0, 0.0, r"stamp 10\.000 s is not later than 10\.000 s"),
    (np.nan, 0.0, 0.0, "not later"),
    (11.0, np.nan, 0.0, "IMU sample is not finite"),
    (11.0, 0.0, np.inf, "IMU sample is not finite"),
])  # fmt: skip
def test_samples_that_cannot_be_used_change_nothing(time, force, height, message):
    it = navigator()
    advance(it, 10)
    before = it.state.copy()
    with pytest.raises(ValueError, match=message):
        it.propagate(time, np.full(3, force), np.zeros(3), height)
    assert it.time == 10.0
    assert identical(it.state, before)


def test_one_run_only():
    with pytest.raises(ValueError, match="one run"):
        BufferedNavigator(FLIGHT.model, fly(range(2)).start)


def test_samples_that_were_not_true_are_forgotten():
    """Up to one that a fix has been taken at: the last true one stands for those before it."""
    it = navigator()
    advance(it, 40)
    before = it.state.copy()
    wrong = np.array([0.0, 0.0, -9.0]), np.zeros(3)
    for k in range(41, 46):
        it.propagate(float(k), *wrong, FLIGHT.trajectory.height[k])
    it.back(5)
    assert it.time == 40.0
    assert identical(it.state, before)
    for k in range(41, 46):
        it.propagate(float(k), *wrong, FLIGHT.trajectory.height[k])
        if k == 42:
            assert it.update_position(42.0, *FLIGHT.fix(42, 5.0, 5.0), R).accepted
    it.back(5)
    assert it.time == 42.0
    held = navigator()
    advance(held, 40)
    for k in (41, 42):
        held.propagate(float(k), *held.sample, FLIGHT.trajectory.height[k])
    held.update_position(42.0, *FLIGHT.fix(42, 5.0, 5.0), R)
    assert identical(it.state, held.state)
    it.back(1000)
    assert it.time == 42.0
