"""Readings of other sensors that the filter cannot use: dropped, counted, named, and the next one
is used."""

import math
import re
from collections.abc import Callable, Iterator

import numpy as np
import pytest
from std_srvs.srv import Trigger

from helpers.node_bench import Bench, bench
from isogal_ros import topics
from isogal_ros.messages.frames import ANTENNA, framed
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamps import from_seconds, set_stamp
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


def drive(made: Bench, begin: int, end: int, stamp: Callable[[int], float], **more: float) -> None:
    """Publish samples each second, and a position of another stamp every two."""
    for second in range(begin, end):
        made.imu(second)
        if second % 2 == 0:
            position(made, stamp(second), **more)


def aid(made: Bench):
    """What nav/aids says of the position."""
    return next(
        one for one in made.heard[topics.NAV_AIDS.name][-1].status if one.name == POSITION.name
    )


def test_an_aid_is_said_by_the_topic_on_which_it_comes(aided) -> None:
    def said() -> dict[str, bytes]:
        newest = aided.heard[topics.NAV_AIDS.name][-1].status
        return {one.name: one.level for one in newest if one.name.startswith("position")}

    drive(aided, 1, 2, float)
    assert said() == {POSITION.name: WARN}
    pose = framed(POSE, "map")
    set_stamp(pose.header.stamp, from_seconds(2.0))
    aided.imu(2)
    aided.publish(POSE, pose)
    aided.imu(3)
    assert list(said()) == [POSE.name]


@pytest.mark.parametrize(
    ("stamp", "words"),
    [
        (lambda t: 1.7e9 + t, "ahead of the navigator"),
        (lambda t: 0.0, "stamp is zero"),
        (lambda t: 2.0, "one of 2.000 s has come before"),
    ],
)
def test_stamps_of_another_clock_are_said_and_kept_nowhere(aided, stamp, words) -> None:
    drive(aided, 1, 3, float)
    drive(aided, 3, 12, stamp)
    level, message, _ = aided.told(words)
    assert (level, POSITION.name in message) == (WARN, True)
    aided.imu(12)
    aided.imu(13)
    assert aided.node.health.dropped == {POSITION.name: 4}
    assert words in aid(aided).message
    drive(aided, 14, 18, float)
    aided.imu(18)
    assert aid(aided).level == OK


def test_how_far_a_rejected_position_is_is_said_once(aided) -> None:
    drive(aided, 1, 4, float, away=5e3 / 6.36e6)
    level, message, _ = aided.told("from the estimate")
    assert level == WARN
    assert message.count("from the estimate") == 1
    assert re.search(r"(49|50)\d\d m from the estimate: normalised", message)
    assert " m from the estimate" in aid(aided).message


def test_what_cannot_be_used_is_why_an_aid_is_not_in_use(aided) -> None:
    drive(aided, 1, 12, float, variance=-1.0)
    assert aid(aided).level == WARN
    assert "negative variance" in aid(aided).message


def test_a_position_without_altitude_is_one(scenario) -> None:
    """NavSatFix: NaN if no altitude is available."""
    with bench(
        topics.UKF_FUSION, scenario("height.source=barometer", AID[:-2] + ", height: true}]")
    ) as it:
        drive(it, 1, 8, float, altitude=math.nan)
        it.imu(8)
        assert it.node.health.figures[f"{POSITION.name} used"] == 3
        assert np.isfinite(it.node.navigator.state.covariance).all()
        drive(it, 9, 12, float, altitude=math.inf)
        assert it.node.health.dropped[POSITION.name] == 1


def test_while_there_is_no_navigator_readings_are_not_kept(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario(AID), start_time=50.0) as made:
        for second in range(1, 40):
            message = framed(POSITION, ANTENNA)
            fill_fix(message, from_seconds(second), -0.6, 2.5, 100.0, np.diag([400.0] * 3))
            made.publish(POSITION, message)
            made.imu(second)
        (source, _) = made.node._aids._sources.values()
        assert not source.waiting


def test_after_a_reset_the_same_stamps_may_come_again(scenario, start) -> None:
    with bench(topics.UKF_FUSION, scenario(AID)) as made:
        for _ in range(2):
            drive(made, 1, 12, float)
            made.imu(12)
            made.fix(10.0, *start, variance=1e6)
            made.call("reset", Trigger.Request())
        assert made.node.health.dropped == {}
        assert made.node.health.figures["fixes accepted"] == 2
        assert made.node.health.figures[f"{POSITION.name} used"] == 10


@pytest.mark.parametrize("variance", [1e20, math.inf, math.nan])
def test_a_declared_noise_beyond_all_sensors_is_refused(scenario, variance) -> None:
    with bench(topics.UKF_FUSION, scenario("imu.declared_noise=true")) as made:
        made.imu(1)
        message = topics.IMU.type()
        message.header.frame_id, message.header.stamp.sec = "base_link", 2
        message.linear_acceleration.z = 9.8
        message.angular_velocity_covariance[:] = np.diag([variance] * 3).ravel()
        made.publish(topics.IMU, message)
        assert made.told("variance of the angular rate")[0] == WARN
        made.imu(3)
        assert np.isfinite(made.heard["nav/fix"][-1].position_covariance).all()


def test_an_imu_faster_than_told_is_said(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in range(1, 60):
            made.imu(0.05 * k, (0.0, 0.0, -9.8 + 1e-4 * (k % 7)))
        level, _, _ = made.told("IMU samples come at 20 Hz, imu.rate says 1")
        assert level == WARN
