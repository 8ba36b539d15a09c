"""Several states of which one is true: what fixes say of them."""

import numpy as np
import pytest

from helpers.navigators import ROUTE, error_between, fly
from isogal.earth.frames import horizontal_difference
from isogal.fusion.belief import COVERED, Belief, InformationUpdate
from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.navigator import update_position
from isogal.fusion.outage import MANOEUVRE
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 900.0}))
R = 50.0**2 * np.eye(2)


def flown(gap: int, until: int, wrong: tuple[float, float] = (0.0, 0.0)) -> BufferedNavigator:
    """A navigator without samples for a time after 300 s; then with a fix of 50 m each 60 s, of
    a vehicle whose velocity changed by `wrong` (m/s, north and east) when the gap began."""
    it = BufferedNavigator(FLIGHT.model, FLIGHT.start.copy())
    for k in range(until):
        if not 300 <= k < 300 + gap:
            sample = FLIGHT.imu.specific_force[0, k], FLIGHT.imu.angular_rate[0, k]
            missing = float(gap) if k == 300 + gap else 0.0
            it.propagate(k + 1.0, *sample, FLIGHT.trajectory.height[k + 1], missing)
        if k > 300 + gap and (k + 1) % 60 == 0:
            away = np.array(wrong) * (k - 300)
            assert it.update_position(k + 1.0, *FLIGHT.fix(k + 1, *away), R).accepted
    return it


def sigma(state: FilterState) -> float:
    return float(np.sqrt(np.trace(state.covariance[0, :2, :2])))


@pytest.mark.parametrize("gap", [60, 180])
def test_fixes_tell_that_there_was_no_manoeuvre(gap) -> None:
    """A navigator that had to reckon with one for ever had 1.6 times the error for an hour."""
    after, later = flown(gap, 301 + gap), flown(gap, 301 + gap + 400)
    assert sigma(after.state) > 0.5 * 0.1 * MANOEUVRE * gap
    assert len(later._steps[-1].belief) == 1
    assert sigma(later.state) < 1.1 * sigma(flown(0, 301 + gap + 400).state)


@pytest.mark.parametrize("wrong", [(4.0, 0.0), (-3.0, 3.0)])
def test_fixes_tell_that_there_was_a_manoeuvre(wrong) -> None:
    it = flown(60, 660, wrong)
    state, truth, k = it.state, FLIGHT.trajectory, 660
    off = np.array(
        horizontal_difference(*state.position[0, :2], truth.latitude[k], truth.longitude[k])
    )
    assert len(it._steps[-1].belief) == 1
    assert np.hypot(*(off - np.array(wrong) * 360.0)) < 3.0 * sigma(state) < 300.0
    slip = state.velocity[0, :2] - truth.velocity[k, :2] - np.array(wrong)
    assert (np.abs(slip) < 3.0 * np.sqrt(np.diag(state.covariance[0])[3:5])).all()


def of_two(apart: float) -> Belief:
    """Two states, the second north of the first by a distance (m), and ten times as uncertain."""
    belief = Belief.sure(FLIGHT.start.copy()).divided(np.log([0.9, 0.1]).tolist())
    belief.state.position[1, 0] += apart / 6.36e6
    belief.state.covariance[1] *= 100.0
    return belief


def test_others_are_told_of_the_most_uncertain_state() -> None:
    belief = of_two(1000.0)
    one, first, second = belief.merged, *belief.each()
    shift = error_between(one, first)
    assert shift[0] == pytest.approx(100.0, rel=0.01)
    P = second.covariance[0, :2, :2] + np.diag([900.0**2, 0.0])
    np.testing.assert_allclose(one.covariance[0, :2, :2], P, rtol=0.02)
    belief.log_weight = np.log([1.0 - 0.5 * COVERED, 0.5 * COVERED])
    mixed = 0.995 * first.covariance[0, 1, 1] + 0.005 * second.covariance[0, 1, 1]
    assert belief.merged.covariance[0, 1, 1] == pytest.approx(mixed)


@pytest.mark.parametrize("apart", [0.0, 100.0, 300.0])
def test_a_position_and_its_information_say_the_same(apart) -> None:
    """Probabilities are those of Bayes' rule, with the normal density of the innovation."""
    fix = FLIGHT.fix(0, 60.0, -30.0)
    by_position, by_information = of_two(apart), of_two(apart)
    start = FLIGHT.start
    off = np.array(horizontal_difference(*start.position[0, :2], *fix))
    M = np.zeros((4, 4))
    M[:2, :2] = np.linalg.inv(R)
    place = Estimate(*(part.copy() for part in start.estimate_of(0)))
    by_information.apply(InformationUpdate(M @ [*off, 0.0, 0.0], M, place))
    by_position.apply(lambda state: update_position(state, FLIGHT.model, 0, *fix, R))
    expected = []
    for weight, state in zip((0.9, 0.1), of_two(apart).each(), strict=True):
        innovation = np.array(horizontal_difference(*fix, *state.position[0, :2]))
        S = state.covariance[0, :2, :2] + R
        density = np.exp(-0.5 * innovation @ np.linalg.solve(S, innovation))
        expected.append(weight * density / np.sqrt(np.linalg.det(S)))
    expected = np.array(expected) / np.sum(expected)
    for belief in (by_position, by_information):
        np.testing.assert_allclose(np.exp(belief.log_weight), expected, rtol=0.01)


def test_a_fix_that_one_state_refuses_says_nothing_of_it() -> None:
    belief = of_two(0.0)

    def update(state: FilterState) -> tuple[np.ndarray, float]:
        if state.covariance[0, 0, 0] > 1e5:
            raise ValueError("of no use")
        return np.zeros(2), 1.0

    belief.apply(update)
    np.testing.assert_allclose(np.exp(belief.log_weight), [0.9, 0.1])
    with pytest.raises(ValueError, match="none"):
        belief.apply(lambda state: (_ for _ in ()).throw(ValueError("none")))


def test_a_fix_within_a_gap_is_refused_and_changes_nothing() -> None:
    """It was once applied at the gap's end: 250 m off, and 80 km after half an hour."""
    it = flown(60, 365)
    before = it.state
    result = it.update_position(330.0, *FLIGHT.fix(330, 0.0, 0.0), R)
    assert not result.accepted
    assert "no inertial data" in (result.reason or "")
    np.testing.assert_array_equal(before.covariance, it.state.covariance)
    assert it.update_position(300.0, *FLIGHT.fix(300, 0.0, 0.0), R).accepted
    assert it.update_position(361.0, *FLIGHT.fix(361, 0.0, 0.0), R).accepted


@pytest.mark.parametrize("information", [False, True])
def test_a_fix_between_two_samples_far_apart_is_carried_to_the_next(information) -> None:
    """With every second sample missing it was taken for one of a second later, 22 m off."""
    ends = []
    for stamp in (19.0, 20.0):
        it = BufferedNavigator(FLIGHT.model, FLIGHT.start.copy())
        for k in range(1, 20, 2):
            sample = FLIGHT.imu.specific_force[0, k], FLIGHT.imu.angular_rate[0, k]
            it.propagate(k + 1.0, *sample, FLIGHT.trajectory.height[k + 1], 1.0 if k > 1 else 0.0)
        if information:
            metres = it.state.position[0].copy(), it.state.velocity[0].copy()
            from isogal.inertial.dead_reckoning import dead_reckoned

            place = dead_reckoned(*metres, stamp - 20.0)
            at = Estimate(place, metres[1], it.state.attitude[0].copy())
            M = np.diag([1e-3, 1e-3, 0.0, 0.0])
            assert it.update_information(stamp, M @ [30.0, 20.0, 0.0, 0.0], M, at).accepted
        else:
            fix = FLIGHT.fix(int(stamp), 30.0, 20.0)
            assert it.update_position(stamp, *fix, R).accepted
        ends.append(it.state)
    assert np.abs(error_between(*ends)[:2]).max() < 0.1
