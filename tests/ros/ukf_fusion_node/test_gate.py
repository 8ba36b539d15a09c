"""A false fix moves nothing, and the node says so."""

import numpy as np
import pytest

from helpers.node_bench import bench
from isogal.matching.interfaces import Fix
from isogal_ros import topics
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.messages.whole_fix import WholeFix, fill_whole_fix
from isogal_ros.nodes.health import ERROR, WARN

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
        fill_whole_fix(message, from_seconds(seconds), WholeFix(fix))
        made.publish(topics.INFORMATION, message)
    assert made.node.answered == before + 1


def fly(made, first: int, last: int) -> None:
    """Send samples of these stamps."""
    for k in range(first, last + 1):
        made.imu(k)


@pytest.mark.parametrize("bare", [True, False], ids=["NavSatFix", "whole fix"])
def test_one_false_fix_is_rejected_counted_and_said(scenario, start, bare) -> None:
    with bench(topics.UKF_FUSION, scenario()) as made:
        fly(made, 1, 3)
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
        fly(made, 1, 6)
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
        fly(made, 1, 3)
        send(made, 3, (start[0] + FAR, start[1]))
        assert read_position(made.heard["nav/fix"][-1])[0] == pytest.approx(
            start[0] + FAR, abs=NEAR
        )
