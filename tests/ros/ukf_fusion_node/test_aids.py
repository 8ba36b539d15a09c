"""Readings of other sensors that the filter cannot use: dropped, counted, named, and the next one
is used."""

import math
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from std_srvs.srv import Trigger

from helpers.node_bench import Bench, bench
from isogal_ros import topics
from isogal_ros.messages.frames import ANTENNA, framed
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.health import OK, WARN

AID = "positions=[{sigma: 20, interval: 2}]"
(POSITION, POSE) = topics.aid_topics("position")


@pytest.fixture
def aided(scenario) -> Iterator[Bench]:
    with bench(topics.UKF_FUSION, scenario(AID)) as made:
        yield made


def position(
    made: Bench,
    seconds: float,
    altitude: float = 100.0,
    variance: float = 400.0,
    away: float = 0.0,
):
    """Publish a position of a stamp: where the filter is, or so many radians north of there."""
    nav = made.node.navigator.state.position + np.array([away, 0.0, 0.0])
    message = framed(POSITION, ANTENNA)
    covariance = np.diag([variance] * 3)
    fill_fix(message, from_seconds(seconds), nav[0], nav[1], altitude, covariance)
    made.publish(POSITION, message)


def drive(
    made: Bench, begin: int, end: int, stamp: Callable[[int], float] = float, **more: float
) -> None:
    """Publish samples each second, and a position, of another stamp if need be, every two."""
    for second in range(begin, end):
        made.imu(second)
        if second % 2 == 0:
            position(made, stamp(second), **more)


def aids(made: Bench):
    """What nav/aids says of positions, by topic."""
    newest = made.heard[topics.NAV_AIDS.name][-1].status
    return {one.name: one for one in newest if one.name.startswith("position")}


def test_an_aid_is_said_by_the_topic_on_which_it_comes(aided) -> None:
    drive(aided, 1, 2)
    assert [(name, one.level) for name, one in aids(aided).items()] == [(POSITION.name, WARN)]
    aided.imu(2)
    aided.publish(POSE, framed(POSE, "map", from_seconds(2.0)))
    aided.imu(3)
    assert list(aids(aided)) == [POSE.name]


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"stamp": lambda t: 1.7e9 + t}, "ahead of the navigator"),
        ({"stamp": lambda t: 2.0}, "one of 2.000 s has come before"),
        ({"variance": -1.0}, "negative variance"),
        ({"away": 5e3 / 6.36e6}, " m from the estimate: normalised"),
    ],
    ids=["another clock", "again", "variance", "rejected"],
)
def test_what_cannot_be_used_is_said_and_kept_nowhere(aided, keys, words) -> None:
    drive(aided, 1, 3)
    drive(aided, 3, 12, **keys)
    level, message, _ = aided.told(words)
    assert (level, POSITION.name in message, message.count(words)) == (WARN, True, 1)
    aided.imu(12)
    aided.imu(13)
    assert aided.node.health.dropped == {POSITION.name: 4}
    assert words in aids(aided)[POSITION.name].message
    drive(aided, 14, 18)
    aided.imu(18)
    assert aids(aided)[POSITION.name].level == OK


def test_a_position_without_altitude_is_one(scenario) -> None:
    """NavSatFix: NaN if no altitude is available."""
    keys = "height.source=barometer", AID[:-2] + ", height: true}]"
    with bench(topics.UKF_FUSION, scenario(*keys)) as it:
        drive(it, 1, 8, altitude=math.nan)
        it.imu(8)
        assert it.node.health.figures[f"{POSITION.name} used"] == 3
        assert np.isfinite(it.node.navigator.state.covariance).all()


def test_while_there_is_no_navigator_readings_are_not_kept(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario(AID), start_time=10.0) as made:
        for second in range(1, 10):
            message = framed(POSITION, ANTENNA)
            fill_fix(message, from_seconds(second), -0.6, 2.5, 100.0, np.diag([400.0] * 3))
            made.publish(POSITION, message)
            made.imu(second)
        (source, _) = made.node._aids._sources.values()
        assert not source.waiting


def test_after_a_reset_the_same_stamps_may_come_again(aided, start) -> None:
    for _ in range(2):
        drive(aided, 1, 12)
        aided.imu(12)
        aided.fix(10.0, *start, variance=1e6)
        aided.call("reset", Trigger.Request())
    assert aided.node.health.dropped == {}
    assert aided.node.health.figures["fixes accepted"] == 2
    assert aided.node.health.figures[f"{POSITION.name} used"] == 10
