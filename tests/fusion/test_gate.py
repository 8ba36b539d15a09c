"""The innovation gate: what cannot be right changes nothing, whoever filters."""

import math

import numpy as np
import pytest
from scipy.stats import chi2

from helpers.navigators import ROUTE, error_between, fly
from isogal.errors import InputError
from isogal.fix import apply_fix
from isogal.fusion.aiding import update_height
from isogal.fusion.belief import Belief
from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.gate import RejectedError, quantile
from isogal.fusion.navigator import NavigatorRun, propagate
from isogal.matching.interfaces import Fix, Information
from isogal.scenario import Fusion, Height, load_scenario

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 120.0}))
FAR = 78e3
"""m."""


def fix_away(metres: float, sigma: float = 1.0, whole: bool = False, **keys) -> Fix:
    """A fix to the north of the navigator's own place at the start."""
    place = FLIGHT.start.position[0].copy()
    M = np.diag([sigma**-2, sigma**-2, 0.0, 0.0])
    told = Information(M @ [-metres, 0.0, 0.0, 0.0], M) if whole else None
    place[0] += metres / 6.36e6
    return Fix(0.0, *place[:2], sigma**2 * np.eye(2), information=told, **keys)


def changed(state) -> bool:
    pairs = zip(state.arrays(), FLIGHT.start.arrays(), strict=True)
    return not all(np.array_equal(one, other) for one, other in pairs)


@pytest.mark.parametrize("probability", [1e-2, 1e-9])
def test_the_quantiles_are_those_of_chi_square(probability):
    expected = [chi2.isf(probability, k) for k in range(1, 8)]
    got = [quantile(probability, k) for k in range(1, 8)]
    np.testing.assert_allclose(got, expected, rtol=1e-7)
    assert quantile(0.0, 2) == math.inf
    assert FLIGHT.model.gates == tuple(quantile(1e-9, k) for k in range(1, 8))


@pytest.mark.parametrize("whole", [False, True], ids=["position", "information"])
@pytest.mark.parametrize("filter_", ["compiled", "reference"])
def test_a_fix_78_km_off_is_rejected_and_one_within_the_prior_is_not(whole, filter_):
    model = fly(fusion=Fusion(filter=filter_)).model
    state = FLIGHT.start.copy()
    run = NavigatorRun(state, model, 0)
    with pytest.raises(RejectedError, match=r"km from the estimate: normalised innovation"):
        apply_fix(fix_away(FAR, whole=whole), run)
    assert not changed(state)
    apply_fix(fix_away(4.0 * sigma(), whole=whole), run)
    assert changed(state)


def sigma() -> float:
    return float(np.sqrt(FLIGHT.start.covariance[0, 0, 0]))


@pytest.mark.parametrize("whole", [False, True], ids=["position", "information"])
def test_no_gate(whole):
    state = FLIGHT.start.copy()
    model = fly(fusion=Fusion(false_rejection=0.0)).model
    _, nis = apply_fix(fix_away(FAR, whole=whole), NavigatorRun(state, model, 0))
    assert nis > 1e5
    assert error_between(state, FLIGHT.start)[0] == pytest.approx(FAR, rel=0.01)


@pytest.mark.parametrize("whole", [False, True], ids=["position", "information"])
def test_what_the_matcher_widens_for_passes(whole):
    state = FLIGHT.start.copy()
    apply_fix(fix_away(FAR, 50.0, whole, reset=True), NavigatorRun(state, FLIGHT.model, 0))
    assert error_between(state, FLIGHT.start)[0] == pytest.approx(FAR, rel=0.01)


def test_weak_information_is_judged_by_what_it_does():
    """A direction of which next to nothing is told implies a place far away."""
    tiny = 1e-8 / sigma() ** 2
    M = np.diag([tiny, tiny, 0.0, 0.0])
    told = Information(np.array([1e-3 / sigma(), 0.0, 0.0, 0.0]), M)
    fix = Fix(0.0, 0.0, 0.0, np.eye(2), information=told)
    state = FLIGHT.start.copy()
    _, nis = apply_fix(fix, NavigatorRun(state, FLIGHT.model, 0))
    assert nis > FLIGHT.model.gate(4)
    assert np.hypot(*error_between(state, FLIGHT.start)[:2]) < 0.01 * sigma()


def navigator(until: int) -> BufferedNavigator:
    it = BufferedNavigator(FLIGHT.model, FLIGHT.start.copy())
    for k in range(until):
        sample = FLIGHT.imu.specific_force[0, k], FLIGHT.imu.angular_rate[0, k]
        it.propagate(k + 1.0, *sample, FLIGHT.trajectory.height[k + 1])
    return it


def test_late_a_fix_is_rejected_as_in_time_and_passes_if_an_older_reset_comes():
    alone, it = navigator(100), navigator(100)
    far = FLIGHT.fix(60, FAR, 0.0)
    result = it.update_position(60.0, *far, np.eye(2))
    assert (result.accepted, result.rejected) == (False, True)
    assert result.innovation[0] == pytest.approx(FAR, rel=0.01)
    assert result.nis > 1e5
    np.testing.assert_array_equal(it.state.covariance, alone.state.covariance)
    np.testing.assert_array_equal(it.state.position, alone.state.position)
    widening = np.diag([30e3**2, 30e3**2, 1.0, 1.0, 0.0, 0.0, 0.0])
    assert it.widen(30.0, widening).accepted
    assert alone.widen(30.0, widening).accepted
    assert alone.update_position(60.0, *far, np.eye(2)).accepted
    np.testing.assert_array_equal(it.state.position, alone.state.position)


def test_of_several_states_the_one_that_foretold_a_fix_is_true():
    def two() -> Belief:
        belief = Belief.sure(FLIGHT.start.copy()).divided(np.log([0.5, 0.5]))
        belief.state.position[1, 0] += FAR / 6.36e6
        return belief

    def at(metres):
        run = fix_away(metres)
        return lambda state: NavigatorRun(state, FLIGHT.model, 0).update_position(
            run.latitude, run.longitude, run.covariance
        )

    belief = two()
    belief.apply(at(FAR))
    assert len(belief) == 1
    assert error_between(belief.state, FLIGHT.start)[0] == pytest.approx(FAR, rel=0.01)
    belief = two()
    with pytest.raises(RejectedError):
        belief.apply(at(2.0 * FAR))
    np.testing.assert_array_equal(belief.log_weight, two().log_weight)
    np.testing.assert_array_equal(belief.state.position, two().state.position)


@pytest.mark.parametrize("filter_", ["compiled", "reference"])
def test_heights_inside_the_filter_pass_the_same_gate(filter_):
    it = fly(height=Height(source="barometer"), fusion=Fusion(filter=filter_))
    force, rate = it.imu.specific_force[:, :2], it.imu.angular_rate[:, :2]
    state = it.start.copy()
    update_height(state, it.model, 0, 100.0)
    assert not update_height(state.copy(), it.model, 0, 10e3).accepted
    with_it, without = state.copy(), state.copy()
    propagate(with_it, it.model, force, rate, np.array([[np.nan, 10e3]]))
    propagate(without, it.model, force, rate, np.full(2, np.nan))
    np.testing.assert_array_equal(with_it.position, without.position)
    np.testing.assert_array_equal(with_it.covariance, without.covariance)


def test_a_known_height_passes_whatever_it_is():
    it = fly()
    force, rate = it.imu.specific_force[:, :1], it.imu.angular_rate[:, :1]
    state = it.start.copy()
    propagate(state, it.model, force, rate, np.array([10e3]))
    assert state.position[0, 2] > 1e3


@pytest.mark.parametrize("value", ["-1e-9", "0.5", "often"])
def test_a_probability_that_is_none_is_refused(value):
    with pytest.raises(InputError, match=r"fusion\.false_rejection"):
        load_scenario(None, [f"fusion.false_rejection={value}"])
