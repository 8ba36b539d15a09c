"""Several states of which one is true: what measurements say of them."""

import numpy as np
import pytest

from helpers.navigators import ROUTE, error_between, fly
from isogal.earth.frames import horizontal_difference
from isogal.fusion.measurements import InformationUpdate, Innovation, Outcome, PositionFix
from isogal.fusion.mixture import COVERED, Mixture
from isogal.inertial.error_state import Estimate

FLIGHT = fly(route=ROUTE.model_copy(update={"duration": 120.0}))
R = 50.0**2 * np.eye(2)
FAR = 78e3
"""m."""


def of_two(apart: float, wider: float = 100.0) -> Mixture:
    """Two states, the second north of the first by a distance (m), and of a larger covariance."""
    mixture = Mixture.of(FLIGHT.start.copy()).divided(np.log([0.9, 0.1]).tolist())
    mixture.states[1].position[0] += apart / 6.36e6
    mixture.states[1].covariance *= wider
    return mixture


def test_others_are_told_of_the_most_uncertain_state():
    mixture = of_two(1000.0)
    one, (first, second) = mixture.merged, mixture.states
    assert error_between(one, first)[0] == pytest.approx(100.0, rel=0.01)
    P = second.covariance[:2, :2] + np.diag([900.0**2, 0.0])
    np.testing.assert_allclose(one.covariance[:2, :2], P, rtol=0.02)
    mixture.log_weights = np.log([1.0 - 0.5 * COVERED, 0.5 * COVERED])
    mixed = 0.995 * first.covariance[1, 1] + 0.005 * second.covariance[1, 1]
    assert mixture.merged.covariance[1, 1] == pytest.approx(mixed)


@pytest.mark.parametrize("apart", [0.0, 100.0, 300.0])
def test_a_position_and_its_information_say_the_same(apart):
    """Probabilities are those of Bayes' rule, with the normal density of the innovation."""
    fix = FLIGHT.fix(0, 60.0, -30.0)
    off = np.array(horizontal_difference(*FLIGHT.start.position[:2], *fix))
    M = np.zeros((4, 4))
    M[:2, :2] = np.linalg.inv(R)
    place = Estimate(*(part.copy() for part in FLIGHT.start.estimate))
    expected = []
    for weight, state in zip((0.9, 0.1), of_two(apart).states, strict=True):
        innovation = np.array(horizontal_difference(*fix, *state.position[:2]))
        S = state.covariance[:2, :2] + R
        density = np.exp(-0.5 * innovation @ np.linalg.solve(S, innovation))
        expected.append(weight * density / np.sqrt(np.linalg.det(S)))
    for one in (
        PositionFix(*fix, R),
        InformationUpdate(M @ np.array([*off, 0.0, 0.0]), M, place),
    ):
        mixture = of_two(apart)
        assert mixture.update(one, FLIGHT.model).used
        np.testing.assert_allclose(
            np.exp(mixture.log_weights), np.array(expected) / np.sum(expected), rtol=0.01
        )


def test_the_state_that_foretold_a_fix_is_true():
    far = PositionFix(FLIGHT.start.position[0] + FAR / 6.36e6, FLIGHT.start.position[1], np.eye(2))
    mixture = of_two(FAR, 1.0)
    assert mixture.update(far, FLIGHT.model).used
    assert len(mixture.states) == 1
    assert error_between(mixture.states[0], FLIGHT.start)[0] == pytest.approx(FAR, rel=0.01)
    mixture, before = of_two(2.0 * FAR, 1.0), of_two(2.0 * FAR, 1.0)
    assert mixture.update(far, FLIGHT.model).outcome is Outcome.REJECTED
    np.testing.assert_array_equal(mixture.log_weights, before.log_weights)
    for state, other in zip(mixture.states, before.states, strict=True):
        np.testing.assert_array_equal(state.position, other.position)


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
