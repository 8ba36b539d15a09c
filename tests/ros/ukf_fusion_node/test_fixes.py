"""Which fixes are used: each stamp once, whole if it comes whole, in any order of arrival; a false
one moves nothing, and the node says so."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.node_bench import bench
from isogal.fields.known_gravity import KnownGravity, Residual
from isogal.matching.interfaces import Fix
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.fix_information import FixMessage, fill_fix_information
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.health import ERROR, WARN
from isogal_ros.topics import INFORMATION, UKF_FUSION
from ukf_fusion_node.stamp_queue import StampQueue

WHOLE = FixMessage(Fix(10.0, -0.6, 2.5, np.eye(2)))


def test_a_stamp_that_nobody_has_set_is_refused() -> None:
    """Within the horizon it would be a fix of the run's beginning."""
    queue = StampQueue()
    with pytest.raises(BadMessageError, match="not set"):
        queue.add(0, WHOLE)
    assert not queue


def test_a_position_is_used_where_nobody_publishes_the_whole(scenario) -> None:
    with bench(UKF_FUSION, scenario()) as made:
        for k in range(1, 6):
            made.imu(k)
        nav = made.heard["nav/fix"][-1]
        place = np.radians([nav.latitude, nav.longitude])
        made.fix(3.0, *place)
        assert made.node.health.figures["fixes accepted"] == 1
        made.publisher(INFORMATION)
        made.fix(4.0, *place)
        assert made.node.health.figures["fixes accepted"] == 1


def test_a_fix_waits_for_the_navigator_but_not_long() -> None:
    queue = StampQueue(100)
    queue.add(150, WHOLE)
    queue.add(300, WHOLE)
    assert queue.due(100) == [(300, WHOLE)]  # to be refused
    assert queue.due(150) == [(150, WHOLE)]


@given(st.permutations([30, 10, 20] * 2), st.integers(0, 40))
def test_in_any_order_each_stamp_is_used_once(arrivals, now) -> None:
    queue, used, repeated = StampQueue(100), [], 0
    for stamp in arrivals:
        try:
            queue.add(stamp, WHOLE)
        except BadMessageError:
            repeated += 1
        used += queue.due(now)
    used += queue.due(40)
    assert not queue
    assert sorted(ns for ns, _ in used) == [10, 20, 30]
    assert repeated == 3


FAR, NEAR = 78e3 / 6.36e6, 100.0 / 6.36e6
"""rad."""


def send(made, seconds: float, place, bare: bool = False, **keys) -> None:
    """Send a fix of 1 m² (bare: a NavSatFix that is all there is), and wait for the answer."""
    before = made.node.answered
    if bare:
        made.fix(seconds, *place, variance=1.0)
    else:
        message = topics.INFORMATION.type()
        fix = Fix(seconds, *place, np.eye(2), **keys)
        fill_fix_information(message, from_seconds(seconds), FixMessage(fix))
        made.publish(topics.INFORMATION, message)
    assert made.node.answered == before + 1


def advance(made, first: int, last: int) -> None:
    """Send samples of these stamps."""
    for k in range(first, last + 1):
        made.imu(k)


def test_the_map_error_of_a_batch_without_a_fix_counts_and_waits_for_no_navigator(
    scenario, start
) -> None:
    none = {"reason": "nothing new", "map_error": (8e-5, 3e3)}
    with bench(topics.UKF_FUSION, scenario()) as made:
        send(made, 12.0, start, **none)
        advance(made, 1, 1)
        it = made.node.navigator
        it.model = replace(it.model, gravity=KnownGravity(residual=Residual(0.0, 1.0)))
        advance(made, 2, 20)
        send(made, 15.0, start, **none)
        sigma, length = it.state.residual_gravity
        assert (sigma, length) == pytest.approx((np.hypot(8e-5 / np.sqrt(2.0), 1e-6), 3e3))
        assert "fixes accepted" not in made.node.health.figures
        assert not made.node.health.dropped


@pytest.mark.parametrize("bare", [True, False], ids=["NavSatFix", "whole fix"])
def test_one_false_fix_is_rejected_counted_and_said(scenario, start, bare) -> None:
    with bench(topics.UKF_FUSION, scenario()) as made:
        advance(made, 1, 3)
        before = made.heard["nav/fix"][-1]
        send(made, 3, (start[0] + FAR, start[1]), bare)
        after, (level, words, figures) = made.heard["nav/fix"][-1], made.says()[-1]
    assert read_position(after) == read_position(before)
    np.testing.assert_array_equal(read_covariance(after), read_covariance(before))
    assert level == WARN
    assert "pmht_mm/fix: 77.9 km from the estimate: normalised innovation squared" in words
    assert "allowed 41.4" in words
    assert figures["pmht_mm/fix rejected"] == figures["dropped pmht_mm/fix"] == "1"
    assert "in a row" not in words


def test_several_in_a_row_are_an_error_until_one_is_taken(scenario, start) -> None:
    with bench(topics.UKF_FUSION, scenario()) as made:
        advance(made, 1, 6)
        for k in range(1, 4):
            send(made, k, (start[0] + FAR, start[1]))
        level, words, figures = made.says()[-1]
        assert level == ERROR
        assert "3 in a row on pmht_mm/fix rejected: measurement or navigator wrong" in words
        assert figures["pmht_mm/fix rejected"] == "3"
        send(made, 5, (start[0] + FAR, start[1]), reset=True)
        end, (_, words, figures) = made.heard["nav/fix"][-1], made.says()[-1]
    assert read_position(end)[0] == pytest.approx(start[0] + FAR, abs=NEAR)
    assert "in a row on" not in words
    assert figures["pmht_mm/fix rejected"] == "3"


def test_a_user_may_have_no_gate(scenario, start) -> None:
    with bench(topics.UKF_FUSION, scenario("fusion.false_rejection=0")) as made:
        advance(made, 1, 3)
        send(made, 3, (start[0] + FAR, start[1]))
        assert read_position(made.heard["nav/fix"][-1])[0] == pytest.approx(
            start[0] + FAR, abs=NEAR
        )
