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
from isogal_ros.topics import UKF_FUSION
from ukf_fusion_node import stamp_queue
from ukf_fusion_node.stamp_queue import StampQueue

WHOLE = FixMessage(Fix(10.0, -0.6, 2.5, np.eye(2)))
FAR, NEAR = 78e3 / 6.36e6, 100.0 / 6.36e6
"""rad."""


def test_a_stamp_that_nobody_has_set_is_refused() -> None:
    """Within the horizon it would be a fix of the run's beginning."""
    queue = StampQueue()
    with pytest.raises(BadMessageError, match="not set"):
        queue.add(0, WHOLE)
    assert not queue


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


def test_a_burst_is_bounded_and_told(monkeypatch) -> None:
    """Those that wait are kept, those that were used are forgotten first."""
    monkeypatch.setattr(stamp_queue, "KEPT", 10)
    queue = StampQueue(1000)
    queue.add(1, WHOLE)
    assert [ns for ns, _ in queue.due(10)] == [1]
    for ns in reversed(range(100, 110)):
        queue.add(ns, WHOLE)
    with pytest.raises(BadMessageError, match="more than 10 wait"):
        queue.add(110, WHOLE)
    assert [ns for ns, _ in queue.due(109)] == list(range(100, 110))
    queue.add(1, WHOLE)  # forgotten


def send(made, seconds: float, place, **keys) -> None:
    """Send a fix of 1 m² with its information, and see it answered."""
    before = made.node.answered
    message = topics.INFORMATION.type()
    fix = Fix(seconds, *place, np.eye(2), **keys)
    fill_fix_information(message, from_seconds(seconds), FixMessage(fix))
    made.publish(topics.INFORMATION, message)
    assert made.node.answered == before + 1


def test_the_map_error_of_a_batch_without_a_fix_counts_and_waits_for_no_navigator(
    filtering, advance, start
) -> None:
    none = {"reason": "nothing new", "map_error": (8e-5, 3e3)}
    send(filtering, 12.0, start, **none)
    advance(filtering, 1, 1)
    it = filtering.node.navigator
    it.model = replace(it.model, gravity=KnownGravity(residual=Residual(0.0, 1.0)))
    advance(filtering, 2, 20)
    send(filtering, 15.0, start, **none)
    sigma, length = it.state.residual_gravity
    assert (sigma, length) == pytest.approx((np.hypot(8e-5 / np.sqrt(2.0), 1e-6), 3e3))
    assert "fixes accepted" not in filtering.node.health.figures
    assert not filtering.node.health.dropped


def test_false_fixes_are_rejected_and_an_error_until_one_is_taken(
    filtering, advance, start
) -> None:
    false = start[0] + FAR, start[1]
    advance(filtering, 1, 6)
    before = filtering.heard["nav/fix"][-1]
    send(filtering, 3, false)
    after, (level, words, figures) = filtering.heard["nav/fix"][-1], filtering.says()[-1]
    assert read_position(after) == read_position(before)
    np.testing.assert_array_equal(read_covariance(after), read_covariance(before))
    assert level == WARN
    assert "pmht_mm/fix: 77.9 km from the estimate: normalised innovation squared" in words
    assert "allowed 41.4" in words
    assert figures["pmht_mm/fix rejected"] == figures["dropped pmht_mm/fix"] == "1"
    assert "in a row" not in words
    send(filtering, 4, false)
    send(filtering, 5, false)
    level, words, figures = filtering.says()[-1]
    assert level == ERROR
    assert "3 in a row on pmht_mm/fix rejected: measurement or navigator wrong" in words
    send(filtering, 6, false, reset=True)
    end, (_, words, figures) = filtering.heard["nav/fix"][-1], filtering.says()[-1]
    assert read_position(end)[0] == pytest.approx(false[0], abs=NEAR)
    assert "in a row on" not in words
    assert figures["pmht_mm/fix rejected"] == "3"


def test_a_user_may_have_no_gate(scenario, advance, start) -> None:
    with bench(UKF_FUSION, scenario("fusion.false_rejection=0")) as made:
        advance(made, 1, 3)
        send(made, 3, (start[0] + FAR, start[1]))
        found = read_position(made.heard["nav/fix"][-1])
    assert found[0] == pytest.approx(start[0] + FAR, abs=NEAR)
