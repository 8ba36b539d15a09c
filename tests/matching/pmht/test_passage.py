"""What the filter's own data make of hypotheses where the heading is not known well, or a velocity
along the body's axes is measured."""

import math
from dataclasses import replace

import numpy as np
import pytest

from helpers.bank import models
from isogal.fusion.assumed import filter_model
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import VelocityReading
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import BATCH_STATES, HEADING, Estimate
from isogal.inertial.rotations import cross_matrix, from_rotation_vector, multiply
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.passage import Passage
from isogal.scenario import Scenario
from isogal.scenario.loading import changed_scenario

SPEED, BEGIN, END = 20.0, 30, 80
GYROSCOPE, IN_RUN = BATCH_STATES + 4, 5
CAR = changed_scenario(
    Scenario(),
    [
        "imu.grade=phone",
        "imu.rate=1.0",
        "initial_error={position: 10.0, velocity: 0.1, tilt: 0.01, heading: 0.02}",
        "velocity={kind: wheels, sigma: 0.1, scale: 0.01, standstill_speed: 0.1}",
    ],
    "test",
)


def driven(
    turned: float = 0.0, bias: float = 0.0, vehicle: Scenario = CAR
) -> tuple[InertialNavigator, InertialNavigator]:
    """Navigators of a vehicle that goes 20 m/s with two turns; one of them has its heading turned
    by so much (rad), and its gyroscope's bias less, from BEGIN on."""
    model = filter_model(vehicle)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    start = Estimate(np.array([0.7, 0.2, 0.0]), np.array([SPEED, 0.0, 0.0]), level)
    navigator = InertialNavigator(model, FilterState.start(start, model))
    both = [navigator]
    for second in range(1, END + 1):
        turn = 0.1 if second % 40 < 10 else -0.02
        force, rate = np.array([0.0, SPEED * turn, -9.80]), np.array([0.0, 0.0, turn])
        for one in both:
            one.imu(float(second), force, rate)
            one.measure(
                float(second), VelocityReading.of(vehicle.velocity, np.array([SPEED, 0.0, np.nan]))
            )
        if second == BEGIN:
            other = navigator.known.copy()
            turn_back(other.merged, turned, bias)
            both.append(InertialNavigator(model, other, float(BEGIN), sample=navigator.sample))
    return both[0], both[1]


def turn_back(state: FilterState, by: float, bias: float) -> None:
    """Turn all that a state knows about the vertical."""
    before = state.velocity.copy()
    cos, sin = math.cos(by), math.sin(by)
    state.velocity[:2] = before[:2] @ np.array([[cos, -sin], [sin, cos]])
    state.attitude[:] = multiply(*from_rotation_vector(0.0, 0.0, -by), *state.attitude)
    state.auxiliary[IN_RUN] -= bias
    apart, P = cross_matrix(state.velocity - before), state.covariance
    P[3:6] -= apart @ P[6:9]
    P[:, 3:6] -= P[:, 6:9] @ apart.T


def bank_of(passage: Passage, covariance: np.ndarray) -> tuple[Hypotheses, np.ndarray]:
    """One hypothesis about the states of a passage, and which these are."""
    which = models(sigma=0.0, trust=1.0)
    slow = len(passage.before) - BATCH_STATES
    moving = np.r_[0:BATCH_STATES, BATCH_STATES + 1 : BATCH_STATES + 1 + slow]
    count = BATCH_STATES + 1 + slow
    P = np.eye(count)
    P[moving[:, None], moving] = covariance
    one = np.zeros(1, dtype=np.int64)
    return Hypotheses(which, one, np.zeros(1), np.zeros((1, count)), P[None]), moving


def test_a_hypothesis_as_wide_as_the_navigator_stays_it() -> None:
    passage = driven()[0].passage(float(BEGIN))
    assert passage is not None
    bank, moving = bank_of(passage, passage.before)
    after = bank.passed(passage, moving)
    scale = np.sqrt(np.diag(passage.after))
    np.testing.assert_allclose(after.mean[0, moving] / scale, 0.0, atol=0.02)
    found = after.covariance[0][np.ix_(moving, moving)]
    np.testing.assert_allclose(
        found / np.outer(scale, scale), passage.after / np.outer(scale, scale), atol=0.02
    )


def test_what_a_bias_adds_is_not_taken_for_new_at_every_fix() -> None:
    """With a velocity aid of however sure a heading: a model of faster growth is told of the bias,
    and only what is new grows faster."""
    ship = ["imu.grade=tactical", "imu.rate=1.0", "velocity.kind=dvl"]
    navigator = driven(vehicle=changed_scenario(Scenario(), ship, "test"))[0]
    assert not navigator.model.unsure_heading
    passage = navigator.passage(float(BEGIN))
    assert passage is not None
    bank, moving = bank_of(passage, passage.before)
    fast = bank.models._replace(growth=np.full_like(bank.models.growth, 100.0))
    heading = moving[HEADING]
    after = replace(bank, models=fast).passed(passage, moving).covariance[0, heading, heading]
    grown = passage.after[HEADING, HEADING] - passage.before[HEADING, HEADING]
    assert after < passage.after[HEADING, HEADING] + 0.3 * 99.0 * grown


@pytest.mark.parametrize(
    ("keys", "followed"),
    [
        (["imu.grade=navigation"], False),
        (["imu.grade=tactical"], True),
        (["velocity.kind=log"], True),
        (["gnss.available=[[0, 600]]"], True),
        (["gnss={available: [[0, 600]], judged: false}"], False),
    ],
)
def test_slow_errors_are_followed_where_they_decide(keys, followed) -> None:
    model = filter_model(changed_scenario(Scenario(), keys, "test"))
    assert model.slow_errors == followed
    assert (len(model.passage_rows()) > BATCH_STATES) == followed


def test_a_navigator_that_is_worse_than_it_says_has_been_told_less() -> None:
    """What the odometer says of the heading at the beginning tells a model of a hundredfold growth
    a hundredth of it."""
    passage = driven()[0].passage(float(BEGIN))
    assert passage is not None
    S, none = passage.smoothed, np.zeros_like(passage.mean)
    still = replace(passage, cross=S, after=S, mean=none)
    bank, moving = bank_of(still, still.before)
    models = bank.models
    for growth in (1.0, 100.0):
        of = models._replace(growth=np.full_like(models.growth, growth))
        after = (
            replace(bank, models=of).passed(still, moving).covariance[0][np.ix_(moving, moving)]
        )
        gained = np.linalg.inv(after) - np.linalg.inv(still.before)
        expected = (np.linalg.inv(S) - np.linalg.inv(still.before)) / growth
        sigma = np.sqrt(np.diag(S))
        size = np.outer(sigma, sigma)
        np.testing.assert_allclose(gained * size, expected * size, atol=2e-3)


def test_kernels_take_the_dynamics_of_a_passage_as_those_of_a_search() -> None:
    """In one memory layout; for another they would be compiled anew."""
    passage = driven()[0].passage(float(BEGIN))
    assert passage is not None
    assert all(one.flags.c_contiguous for one in passage.transition)


def test_before_any_sample_nothing_has_become_of_an_error() -> None:
    model = filter_model(CAR)
    still = Estimate(np.array([0.7, 0.2, 0.0]), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    assert InertialNavigator(model, FilterState.start(still, model)).passage(0.0) is None


@pytest.mark.parametrize(("turned", "bias"), [(0.3, 0.0), (-0.3, 0.0), (0.0, 5e-4), (0.3, 5e-4)])
def test_another_heading_goes_another_way(turned, bias) -> None:
    one, other = driven(turned, bias)
    passage = one.passage(float(BEGIN))
    assert passage is not None
    nothing = replace(passage, before=passage.smoothed)  # the data tell nothing of the beginning
    bank, moving = bank_of(passage, 1e-12 * np.diag(np.diag(passage.before)))
    mean = bank.mean.copy()
    mean[0, moving] = passage.mean
    mean[0, moving[HEADING]] += turned
    mean[0, moving[2:4]] += turned * np.array([-passage.velocity[1], passage.velocity[0]])
    mean[0, moving[GYROSCOPE]] += bias
    after = replace(bank, mean=mean).passed(nothing, moving).mean[0]
    north = 6.37e6 * (one.state.position[0] - other.state.position[0])
    east = 6.39e6 * math.cos(0.7) * (one.state.position[1] - other.state.position[1])
    assert math.hypot(north, east) > 10.0
    assert after[:2] == pytest.approx([north, east], abs=4.0)


def test_a_heading_that_is_unsure_is_split_and_keeps_its_moments() -> None:
    passage = driven()[0].passage(float(BEGIN))
    assert passage is not None
    wide = passage.before.copy()
    wide[HEADING, HEADING] += 0.3**2
    bank, _ = bank_of(passage, wide)
    parts = bank.headed()
    assert (np.sqrt(parts.covariance[:, HEADING, HEADING]) <= 0.1).all()
    mean, covariance = parts.moments()
    np.testing.assert_allclose(mean, 0.0, atol=1e-6)
    assert covariance[HEADING, HEADING] == pytest.approx(wide[HEADING, HEADING], rel=1e-6)


def test_errors_are_kept_where_they_are_asked_for_alone() -> None:
    one, _ = driven()
    assert len(one.state.clone.shift) == 0
    assert one.passage(float(BEGIN)) is not None
    assert len(one.state.clone.shift) > 0


def test_measurements_of_the_newest_stamp_count_though_a_passage_was_asked_for_before() -> None:
    def passage_of(asked: bool) -> Passage:
        one, _ = driven()
        one.imu(END + 1.0, np.array([0.0, 0.0, -9.8]), np.zeros(3))
        if asked:
            assert one.passage(float(BEGIN)) is not None
        one.measure(END + 1.0, VelocityReading(np.array([SPEED, 0.0, 0.0]), 0.01 * np.eye(3)))
        found = one.passage(float(BEGIN))
        assert found is not None
        return found

    for asked, other in zip(passage_of(True).arrays, passage_of(False).arrays, strict=True):
        np.testing.assert_allclose(asked, other, rtol=1e-9, atol=1e-12)
