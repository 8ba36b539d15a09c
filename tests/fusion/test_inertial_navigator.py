"""A late measurement equals one that came on time, in any order of arrival; what cannot be used
changes nothing; several states of which one is true."""

import re

import numpy as np
import pytest

from helpers.navigators import ROUTE, assert_close, fly, identical
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import (
    HeightReading,
    InformationUpdate,
    Innovation,
    Outcome,
    PositionFix,
    Widening,
)
from isogal.fusion.mixture import Mixture
from isogal.fusion.outage import HELD, MANOEUVRE
from isogal.fusion.prediction import propagate
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import batch_covariance, batch_difference

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 120.0}))
R = np.array([[40.0**2, 300.0], [300.0, 25.0**2]])
FIXES = {20: (30.0, -40.0), 50: (-25.0, 10.0), 90: (15.0, 20.0)}
"""Stamp -> metres from the truth."""


def navigator(**keys) -> InertialNavigator:
    return InertialNavigator(FLIGHT.model, FLIGHT.start, **keys)


def advance(it: InertialNavigator, until: int, at_once: int = 1) -> None:
    for k in range(round(it.time), until, at_once):
        last = min(k + at_once, until)
        it.imu(np.arange(k + 1.0, last + 1.0), *FLIGHT.samples(k, last))


def reference(until: int, fixes) -> FilterState:
    """The same step by step, in order of the stamps."""
    state = FLIGHT.start.copy()
    for k in range(until):
        propagate(state, FLIGHT.model, *FLIGHT.samples(k, k + 1))
        for measurement in fixes.get(k + 1, []):
            measurement.update(state, FLIGHT.model)
    return state


def position_fix(stamp: int) -> PositionFix:
    return PositionFix(*FLIGHT.fix(stamp, *FIXES[stamp]), R)


def information_at(state: FilterState, stamp: int, attitude: bool = False) -> InformationUpdate:
    """The information that a fix holds on the error of a state; its attitude is compared with that
    of an unaided one."""
    metres = metres_per_radian(state.position[0], state.position[2])
    error = (state.position[:2] - FLIGHT.fix(stamp, *FIXES[stamp])) * metres
    M = np.zeros((4, 4))
    M[:2, :2] = np.linalg.inv(R)
    M[2:, 2:] = np.eye(2) / 0.1**2
    slip = state.velocity[:2] - FLIGHT.trajectory.velocity[stamp, :2] - [0.02, -0.01]
    error = np.append(error, slip)
    if attitude:
        turn = batch_difference(state.estimate, reference(stamp, {}).estimate)[4:]
        M = np.block([[M, np.zeros((4, 3))], [np.zeros((3, 4)), np.eye(3) / 1e-4**2]])
        M[4, 0] = M[0, 4] = 0.3 * np.sqrt(M[0, 0] * M[4, 4])
        error = np.append(error, turn + np.array([2e-5, -1e-5, 1e-5]))
    return InformationUpdate(M @ error, M)


@pytest.mark.parametrize("arrival", [50, 120])
@pytest.mark.parametrize("what", ["position", "information", "widened"])
def test_a_late_measurement_equals_one_on_time(what, arrival):
    told = position_fix(50) if what == "position" else information_at(reference(50, {}), 50)
    parts = [Widening(batch_covariance(3000.0, 0.5, 1e-4, 0.0))] * (what == "widened") + [told]
    it = navigator()
    advance(it, arrival)
    result = it.measure(50.0, *parts)
    advance(it, 120)
    assert identical(it.state, reference(120, {50: parts}))
    assert bool(it.state.contradicted) == (what == "widened")
    on_time = told.update(reference(50, {50: parts[:-1]}), FLIGHT.model)
    assert result.outcome is on_time.outcome is Outcome.USED
    assert (result.innovation == on_time.innovation).all()
    assert result.nis == on_time.nis


ORDERS = (20, 50, 90), (90, 50, 20), (50, 90, 20)


@pytest.mark.parametrize("attitude", [False, True])
@pytest.mark.parametrize("order", ORDERS)
def test_information_in_any_order_of_arrival(order, attitude):
    """Each piece refers to the estimate of its stamp when it comes, whatever older ones change
    later."""
    expected = navigator()
    for stamp in FIXES:
        advance(expected, stamp)
        expected.measure(float(stamp), information_at(expected.state, stamp, attitude))
    advance(expected, 120)
    it = navigator()
    advance(it, 95)
    for stamp in order:
        seen = it.state_at(float(stamp))
        assert it.measure(float(stamp), information_at(seen, stamp, attitude)).used
    advance(it, 120)
    # the fix is linear in the error, metres are not quite linear in the place
    assert_close(it.state, expected.state, 1e-4, 1e-4)


@pytest.mark.parametrize("at_once", [1, 10])
@pytest.mark.parametrize("stamp", [19.6, 20.3])
def test_a_stamp_within_a_sample_divides_it(stamp, at_once):
    """The vehicle is there at that time, not where it is at the next sample, 20 m further on."""
    it = navigator()
    advance(it, 40, at_once)
    before = it.state_at(stamp).copy()
    k = int(stamp)
    truth = FLIGHT.trajectory
    share = stamp - k
    place = (1.0 - share) * truth.latitude[k] + share * truth.latitude[k + 1]
    start = FLIGHT.start.position[0] - truth.latitude[0]
    assert abs(before.position[0] - place - start) * 6.4e6 < 4.0
    fix = PositionFix(before.position[0], before.position[1], R)
    result = it.measure(stamp, fix)
    assert result.used
    np.testing.assert_allclose(result.innovation, 0.0, atol=1e-9)
    state = FLIGHT.start.copy()
    propagate(state, FLIGHT.model, *FLIGHT.samples(0, k))
    part = FLIGHT.samples(k, k + 1)
    propagate(state, FLIGHT.model, *part, dt=share)
    fix.update(state, FLIGHT.model)
    propagate(state, FLIGHT.model, *part, dt=1.0 - share)
    propagate(state, FLIGHT.model, *FLIGHT.samples(k + 1, 40))
    assert_close(it.state, state, 1e-6, 1e-6)


WRONG = InformationUpdate(np.ones(4), np.diag([1.0, 1.0, -1e6, 1.0]))


def fix_of(covariance) -> list[PositionFix]:
    return [PositionFix(*FLIGHT.fix(20, 0.0, 0.0), covariance)]


@pytest.mark.parametrize(("stamp", "parts", "reason"), [
    (41.0, fix_of(R), r"stamp 41\.0 s is ahead of the navigator \(40\.0 s\)"),
    (5.0, fix_of(R), r"stamp 5\.0 s is older than the buffer \(\d+\.\d s\)"),
    (np.nan, fix_of(R), "older than the buffer"),
    (20.0, fix_of(np.full((2, 2), np.nan)), "not positive definite"),
    (20.0, fix_of(-R), "covariance of the measurement is not positive definite"),
    (35.0, [Widening(np.eye(7)), WRONG], "too negative"),
    (40.0, [Widening(np.eye(7)), WRONG], "too negative"),
])  # fmt: skip
def test_what_is_refused_changes_nothing_nor_does_what_comes_with_it(stamp, parts, reason):
    it, fresh = navigator(horizon=25.0), navigator(horizon=25.0)
    other = PositionFix(*FLIGHT.fix(20, *FIXES[20]), R)
    for one in (it, fresh):
        advance(one, 35)
        one.measure(30.0, other)
        advance(one, 40)
    result = it.measure(stamp, *parts)
    assert result.outcome is Outcome.REFUSED
    assert np.isnan([result.nis, *result.innovation]).all()
    assert re.search(reason, result.reason or "")
    assert identical(it.state, fresh.state)
    for one in (it, fresh):
        advance(one, 45)
    assert identical(it.state, fresh.state)


def test_a_fix_that_would_cost_the_covariance_is_refused():
    """A fix to the millimetre after a start that may be anywhere: the difference of their
    covariances is below the last digit, and the filter was lost with the sample after it."""
    start = FLIGHT.start.copy()
    start.covariance[:2, :2] = 1e12 * np.eye(2)
    it = InertialNavigator(FLIGHT.model, start)
    advance(it, 100)
    exact = PositionFix(*it.state.position[:2], 1e-6 * np.eye(2))
    assert it.measure(it.time, exact).reason == "the filter's covariance is not positive definite"
    advance(it, 101)
    assert it.measure(it.time, position_fix(90)).used
    advance(it, 120)


def test_late_a_fix_is_rejected_as_in_time_and_passes_if_an_older_reset_comes():
    alone, it = navigator(), navigator()
    for one in (alone, it):
        advance(one, 100)
    far = PositionFix(*FLIGHT.fix(60, 78e3, 0.0), np.eye(2))
    result = it.measure(60.0, far)
    assert result.outcome is Outcome.REJECTED
    assert result.innovation[0] == pytest.approx(78e3, rel=0.01)
    assert identical(it.state, alone.state)
    widening = Widening(np.diag([30e3**2, 30e3**2, 1.0, 1.0, 0.0, 0.0, 0.0]))
    assert it.measure(30.0, widening).used
    assert alone.measure(30.0, widening).used
    assert alone.measure(60.0, far).used
    np.testing.assert_array_equal(it.state.position, alone.state.position)


@pytest.mark.parametrize(("time", "force", "height", "message"), [
    (10.0, 0.0, 0.0, r"stamp 10\.000 s is not later than 10\.000 s"),
    (np.nan, 0.0, 0.0, "not later"),
    (11.0, np.nan, 0.0, "IMU sample is not finite"),
    (11.0, 0.0, np.inf, "IMU sample is not finite"),
    (11.0, [0.0, 0.0], 0.0, r"must be \(S,\), \(S, 3\) and \(S, 3\), are \(1,\), \(1, 2\)"),
    ([], 0.0, 0.0, "IMU samples must be"),
    ([11.0, 12.0], 0.0, 0.0, "IMU samples must be"),
])  # fmt: skip
def test_samples_that_cannot_be_used_change_nothing(time, force, height, message):
    it = navigator()
    advance(it, 10)
    before = it.state.copy()
    with pytest.raises(ValueError, match=message):
        it.imu(time, np.full(3, force) if np.ndim(force) == 0 else force, np.zeros(3), height)
    with pytest.raises(ValueError, match="must increase"):
        it.imu([11.0, 11.0], np.zeros((2, 3)), np.zeros((2, 3)), 0.0)
    assert it.time == 10.0
    assert identical(it.state, before)


def test_samples_that_were_not_true_are_forgotten():
    """Up to one that a fix has been taken at: the last true one stands for those before it."""
    it = navigator()
    advance(it, 40)
    before = it.state.copy()
    wrong = np.array([0.0, 0.0, -9.0]), np.zeros(3)
    fix = PositionFix(*FLIGHT.fix(42, 5.0, 5.0), R)
    for k in range(41, 46):
        it.imu(float(k), *wrong, FLIGHT.trajectory.height[k])
    it.back(5)
    assert it.time == 40.0
    assert identical(it.state, before)
    for k in range(41, 46):
        it.imu(float(k), *wrong, FLIGHT.trajectory.height[k])
        if k == 42:
            assert it.measure(42.0, fix).used
    it.back(5)
    assert it.time == 42.0
    held = navigator()
    advance(held, 40)
    for k in (41, 42):
        held.imu(float(k), *held.sample, FLIGHT.trajectory.height[k])
    held.measure(42.0, fix)
    assert identical(it.state, held.state)
    it.back(1000)
    assert it.time == 42.0


LONG = fly(route=ROUTE.model_copy(update={"duration": 900.0}))


def long_fix(stamp: int, away=(0.0, 0.0)) -> PositionFix:
    return PositionFix(*LONG.fix(stamp, *away), 50.0**2 * np.eye(2))


def error_of(state: FilterState, stamp: int) -> np.ndarray:
    truth = LONG.trajectory
    metres = metres_per_radian(truth.latitude[stamp])
    return (state.position[:2] - [truth.latitude[stamp], truth.longitude[stamp]]) * metres


def flown(gap: int, until: int, wrong: tuple[float, float] = (0.0, 0.0)) -> InertialNavigator:
    """A navigator without samples for a time after 300 s; then with a fix of 50 m each 60 s, of
    a vehicle whose velocity changed by `wrong` (m/s, north and east) when the gap began."""
    it = InertialNavigator(LONG.model, LONG.start)
    for k in range(until):
        if not 300 <= k < 300 + gap:
            missing = float(gap) if k == 300 + gap else 0.0
            it.imu(k + 1.0, *LONG.samples(k, k + 1), missing)
        if k > 300 + gap and (k + 1) % 60 == 0:
            away = np.array(wrong) * (k - 300)
            assert it.measure(k + 1.0, long_fix(k + 1, away)).used
    return it


@pytest.mark.parametrize("gap", [60, 180])
def test_fixes_tell_that_there_was_no_manoeuvre_in_a_gap(gap):
    """A navigator that had to reckon with one for ever had twice the error for an hour."""
    after, later = flown(gap, 301 + gap), flown(gap, 301 + gap + 400)
    assert after.undecided
    assert spread(after) > 0.5 * 0.1 * MANOEUVRE * gap
    assert not later.undecided
    assert spread(later) < 1.1 * spread(flown(0, 301 + gap + 400))


def spread(it: InertialNavigator) -> float:
    return float(np.sqrt(np.trace(it.state.covariance[:2, :2])))


@pytest.mark.parametrize("wrong", [(4.0, 0.0), (-3.0, 3.0)])
def test_fixes_tell_that_there_was_a_manoeuvre_in_a_gap(wrong):
    it = flown(60, 660, wrong)
    assert not it.undecided
    sigma = np.sqrt(np.diag(it.state.covariance))
    assert (np.abs(error_of(it.state, 660) - np.array(wrong) * 360.0) < 3.0 * sigma[:2]).all()
    assert np.hypot(*sigma[:2]) < 100.0
    slip = it.state.velocity[:2] - LONG.trajectory.velocity[660, :2] - np.array(wrong)
    assert (np.abs(slip) < 3.0 * sigma[3:5]).all()


def test_a_fix_within_a_gap_is_refused_and_changes_nothing():
    """It was once applied at the gap's end: 250 m off, and 80 km after half an hour."""
    it = flown(60, 365)
    before = it.state.copy()
    result: Innovation = it.measure(330.0, long_fix(330))
    assert result.outcome is Outcome.REFUSED
    assert "no inertial data" in (result.reason or "")
    assert identical(it.state, before)
    assert it.measure(300.0, long_fix(300)).used
    assert it.measure(361.0, long_fix(361)).used


def test_a_fix_within_a_short_gap_is_where_the_vehicle_was():
    """With every second sample missing it was once taken for one of a second later, 22 m off."""
    it = InertialNavigator(LONG.model, LONG.start)
    for k in range(1, 20, 2):
        it.imu(k + 1.0, *LONG.samples(k, k + 1), 1.0 if k > 1 else 0.0)
    assert HELD > 1.0
    start = error_of(LONG.start, 0)
    apart = it.measure(19.0, PositionFix(*LONG.fix(19, *start), 1e6 * np.eye(2))).innovation
    assert np.abs(apart).max() < 5.0


def test_what_would_be_known_without_satellites() -> None:
    """Fixes after a time do not count, heights and fixes before it do; also where what has been
    found is gone on from, and where a fix or a height comes late."""
    place = FLIGHT.start.position
    height = HeightReading(float(place[2]), 0.25)

    def fix(k):
        return PositionFix(*FLIGHT.fix(k, 1.0, -1.0), np.eye(2) * 4.0, source="an aid")

    def flown(aids, late=()):
        it = navigator()
        for k in range(1, 41):
            advance(it, k)
            it.measure(float(k), height)
            if k in aids:
                it.measure(float(k), fix(k))
            if k == 30:
                it.measure(25.5, HeightReading(float(place[2]) + 1.0, 0.01))
                for time in late:
                    it.measure(float(time), fix(time))
            if aids and k % 7 == 0:
                it.unaided(10.0 if k > 10 else 0.0)
        return it

    alone = flown({5, 10}).state
    for it in (flown({5, 10, 12, 33}), flown({5, 10, 33}, late=[12])):
        without = it.unaided(10.0)
        np.testing.assert_allclose(without.covariance, alone.covariance, rtol=1e-12)
        np.testing.assert_allclose(np.r_[without.position], alone.position, rtol=1e-15)
        assert without.covariance[0, 0] > 2.0 * it.state.covariance[0, 0]
    assert flown({5, 10}).unaided(10.0) is None


def of_two(apart: float, wider: float = 100.0) -> Mixture:
    """Two states, the second north of the first by a distance (m), and of a larger covariance."""
    mixture = Mixture.of(FLIGHT.start.copy()).divided(np.log([0.9, 0.1]).tolist())
    mixture.states[1].position[0] += apart / 6.36e6
    mixture.states[1].covariance *= wider
    return mixture


class Choosy:
    """A measurement that wide states refuse, or all."""

    def __init__(self, largest: float) -> None:
        self.largest = largest

    def update(self, state, model) -> Innovation:
        if state.covariance[0, 0] > self.largest:
            raise ValueError("of no use")
        return Innovation.of(np.zeros(2), 1.0, model.gate(2))


def test_a_measurement_that_one_state_refuses_says_nothing_of_it():
    mixture = of_two(0.0)
    mixture.update(Choosy(1e5), FLIGHT.model)
    np.testing.assert_allclose(np.exp(mixture.log_weights), [0.9, 0.1])
    with pytest.raises(ValueError, match="of no use"):
        mixture.update(Choosy(0.0), FLIGHT.model)
