"""The matcher's node: fixes of batches, and that no message ends it."""

import math
from functools import partial

import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import NavSatStatus, PointCloud2

from helpers.node_bench import bench, vector_reading
from isogal.matching.interfaces import declined
from isogal.passage import Passage
from isogal.sensors.reduction import State, reduction_variance
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.gradiometer import GRADIOMETER
from isogal_ros.messages.stamps import from_seconds, set_stamp, to_ns, to_seconds
from isogal_ros.nodes import nav_queue
from isogal_ros.nodes.health import WARN
from isogal_ros.nodes.nav_queue import NavSample


@pytest.fixture
def matcher_bench(scenario):
    with bench(topics.PMHT_MM, scenario()) as made:
        yield made


@pytest.fixture
def drive(flight, matcher_bench):
    return partial(flight, matcher_bench)


def test_readings_may_come_before_the_navigators_state(matcher_bench, drive, scenario) -> None:
    trajectory = build_trajectory(scenario())
    for scan in range(1, 7):
        drive(scan, navigator=False)
    assert len(matcher_bench.node.scans.waiting) == 6
    for k in range(10, 70, 10):
        place = trajectory.latitude[k], trajectory.longitude[k]
        matcher_bench.nav(k, *place, tuple(trajectory.velocity[k, :2]))
    assert len(matcher_bench.node.scans.waiting) == 0


def test_bad_old_and_lost_readings_leave_a_batch_of_the_same_length(matcher_bench, drive) -> None:
    """What else is bad of a message, tests of its reader say."""
    drive(1)
    drive(2)
    drive(2)
    drive(1)
    assert matcher_bench.node.health.dropped == {"gravimeter/disturbance": 2}
    drive(3, value=math.nan)
    assert matcher_bench.told("not finite")[0] == WARN
    matcher_bench.nav(40, -0.637, 2.5656)  # the gravimeter was not heard
    drive(5)
    drive(6)
    assert to_ns(matcher_bench.heard["pmht_mm/fix"][0].header.stamp) == from_seconds(60.0)
    assert matcher_bench.says()[-1][2]["scans missing"] == "1"


def test_what_waits_for_a_silent_navigator_is_bounded(matcher_bench, drive, monkeypatch) -> None:
    monkeypatch.setattr(nav_queue, "LONGEST", 8)
    for scan in range(1, 37):
        drive(scan, navigator=False)
    assert len(matcher_bench.node.scans.waiting) == 8
    assert matcher_bench.node.health.dropped == {"nav/odom": 28}
    assert matcher_bench.told("more than 8 readings wait for the navigator")[0] == WARN


@pytest.mark.parametrize(("later", "used"), [(0, True), (10**9, False)])
def test_what_is_said_since_the_last_fix_counts_at_stamps_of_our_time(
    matcher_bench, monkeypatch, later, used
) -> None:
    """Of another fix than the last it does not; seconds in double precision are not exact."""
    node, seen, end = matcher_bench.node, [], 1_764_187_200_123_456_789
    begin = to_seconds(from_seconds(to_seconds(end + later)))
    passage = Passage.of_dynamics(begin, np.eye(7), np.eye(7), np.eye(7))
    node.scans.ended, node._matching.memory = end, "something"

    def match(_prior, _why, told):
        seen.append(told)
        raise StopIteration

    monkeypatch.setattr(node._matching, "match", match)
    nav = NavSample(
        end + 10**10, np.zeros(3), np.zeros(3), np.eye(3), np.eye(7), 1.0, passage=passage
    )
    with pytest.raises(StopIteration):
        node._match(nav)
    assert len(seen) == 1 and (seen[0] is passage) == used


def test_what_a_message_says_of_its_noise_is_used(matcher_bench, drive, monkeypatch) -> None:
    """Less what the navigator's error adds by the reduction: the batch has that of its own."""
    seen = []

    class Watching:
        context = 0

        def match(self, batch, field_map, memory):
            seen.append(batch.sigma)
            return declined(batch, "nothing"), memory

    monkeypatch.setattr(matcher_bench.node._matching, "matcher", Watching())
    at = State(-0.637, 2.5656, 100.0, 10.0, 10.0)
    reduction = matcher_bench.node._reductions[0]
    covariance = np.diag([900.0, 900.0, 0.01, 0.01])
    by_navigator = float(reduction_variance(reduction, at, covariance, 0.01))
    assert by_navigator > 1e-10
    variances = [0.0, 4e-10 + by_navigator, 4e-10 + by_navigator, 1e-12, 1e-10, 9e-12]
    for scan, variance in enumerate(variances, 1):
        drive(scan, variance=variance)
    own = matcher_bench.scenario.gravimeter.sigma
    expected = [own, 2e-5, 2e-5, 1e-6, 1e-5, 3e-6]
    np.testing.assert_allclose(seen[0], expected, rtol=0.02)


def test_a_matcher_that_fails_gives_no_fix(matcher_bench, drive, monkeypatch) -> None:
    class Broken:
        context = 0

        def match(self, batch, field_map, memory):
            raise ZeroDivisionError("division by zero")

    node = matcher_bench.node
    monkeypatch.setattr(node._matching, "matcher", Broken())
    monkeypatch.setattr(node._matching, "memory", "of earlier batches")
    for scan in range(1, 7):
        drive(scan)
    (fix,) = matcher_bench.heard["pmht_mm/fix"]
    assert fix.status.status == NavSatStatus.STATUS_NO_FIX
    words, figures = matcher_bench.batches()[0]
    assert figures["status"] == "failed"
    assert words.startswith("the matcher failed: ZeroDivisionError: division by zero (")
    assert node._matching.memory == "of earlier batches"
    level, text, figures = matcher_bench.says()[-1]
    assert level == WARN and text.startswith("1 batches without a fix: the matcher failed: ")
    assert (figures["fixes declined"], figures["matcher failures"]) == ("1", "1")


def test_settings_may_change_between_batches(matcher_bench) -> None:
    node = matcher_bench.node
    assert node.set_parameters([Parameter("matcher.map_sigma", value=3e-5)])[0].successful
    assert node.scenario.matcher.map_sigma == 3e-5
    refused = node.set_parameters([Parameter("matcher.options", value="{no_such_option: 1}")])[0]
    assert not refused.successful
    assert "no_such_option" in refused.reason
    assert node.scenario.matcher.options == {}


def test_a_vector_that_cannot_be_read_is_an_empty_scan(gradient) -> None:
    with bench(topics.PMHT_MM, gradient) as made:
        for scan in range(1, 7):
            if scan == 3:
                item = PointCloud2(width=1, height=1)
                item.header.frame_id = GRADIOMETER
                set_stamp(item.header.stamp, from_seconds(10.0 * scan))
            else:
                item = vector_reading(gradient, 10.0 * scan, [1e-8, 2e-8, 0.0])
            made.nav(10.0 * scan, np.radians(-36.5) + 2e-5 * scan, np.radians(147.0))
            made.publish(topics.GRADIENT, item)
        assert made.node.health.dropped == {"gradiometer/gradient": 1}
