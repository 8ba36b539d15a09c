"""nav/smoothed: each state once, a lag later, as the library smooths it."""

import numpy as np
import pytest

from helpers.node_bench import bench
from isogal_ros import topics
from isogal_ros.messages.adapter import topics_in_use
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.position import read_position
from isogal_ros.messages.stamps import to_ns

LAG = "fusion.lag=20"
TODAY = 1_764_187_200_123_456_789
"""ns; a float of seconds is 11 ns off, and up to 119 of others."""


@pytest.fixture
def made(scenario):
    with bench(topics.UKF_FUSION, scenario(LAG)) as one:
        yield one


def stamps_of(one) -> list[int]:
    return [message.header.stamp.sec for message in one.heard["nav/smoothed"]]


def test_each_state_comes_once_and_is_at_least_a_lag_old(made) -> None:
    for k in range(1, 61):
        made.imu(k)
        stamps = stamps_of(made)
        assert not stamps or 20 <= k - stamps[-1] <= 22
    assert stamps == list(range(1, 40))


def test_it_knows_of_a_fix_that_came_within_the_lag(made) -> None:
    for k in range(1, 31):
        made.imu(k)
    latitude, longitude, _ = read_position(made.heard["nav/fix"][-1])
    made.fix(30, latitude + 1e-5, longitude, variance=1.0)
    for k in range(31, 61):
        made.imu(k)
    then = {one.header.stamp.sec: one for one in made.heard["nav/odom"]}
    later = {one.header.stamp.sec: one for one in made.heard["nav/smoothed"]}
    moved = [
        later[k].pose.pose.position.y - then[k].pose.pose.position.y for k in (5, 15, 25)
    ]  # 1e-5 rad are 64 m
    assert moved[0] == pytest.approx(0.0, abs=0.1)  # said before the fix
    np.testing.assert_allclose(moved[1:], 63.0, atol=3.0)
    variance = np.reshape(later[25].pose.covariance, (6, 6))[1, 1]
    assert variance < 0.1 * np.reshape(then[25].pose.covariance, (6, 6))[1, 1]
    assert later[25].child_frame_id == "base_link" and later[25].header.frame_id == "map"


def test_stamps_of_today_are_those_of_the_samples_to_the_nanosecond(scenario) -> None:
    stamps = [TODAY + k * 1_000_000_007 for k in range(60)]
    with bench(topics.UKF_FUSION, scenario(LAG), start_time=float("nan")) as made:
        for ns in stamps:
            message = topics.IMU.type()
            message.header.frame_id = "base_link"
            fill_imu(message, ns, np.array([0.0, 0.0, -9.8]), np.zeros(3))
            made.publish(topics.IMU, message)
        said = [to_ns(message.header.stamp) for message in made.heard["nav/smoothed"]]
    assert len(said) > 35
    assert said == stamps[: len(said)]


def test_without_a_lag_there_is_no_such_topic(scenario) -> None:
    assert topics.SMOOTHED not in topics_in_use(scenario())
    assert topics.SMOOTHED in topics_in_use(scenario(LAG))
    with bench(topics.UKF_FUSION, scenario()) as one:
        for k in range(1, 4):
            one.imu(k)
        assert not one.heard["nav/smoothed"]
