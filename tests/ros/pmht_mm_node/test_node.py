"""The matcher's node: fixes of batches, and that no message ends it."""

import math
from functools import partial

import numpy as np
import pytest
from rclpy.parameter import Parameter
from sensor_msgs.msg import NavSatStatus

from helpers.node_bench import bench
from isogal.matching.interfaces import declined
from isogal.sensors.reduction import State, reduction_variance
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes import nav_queue
from isogal_ros.nodes.health import WARN


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
    assert matcher_bench.node.scans.waiting == 6
    for k in range(10, 70, 10):
        place = trajectory.latitude[k], trajectory.longitude[k]
        matcher_bench.nav(k, *place, tuple(trajectory.velocity[k, :2]))
    assert matcher_bench.node.scans.waiting == 0


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
    assert matcher_bench.node.scans.waiting == 8
    assert matcher_bench.node.health.dropped == {"nav/odom": 28}
    assert matcher_bench.told("more than 8 readings wait for the navigator")[0] == WARN


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
