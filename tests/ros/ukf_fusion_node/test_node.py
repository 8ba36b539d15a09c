"""The filter's node: what it publishes and answers, and that no message ends it."""

import math

import numpy as np
import pytest

from helpers.node_bench import bench, stamps
from isogal.fusion.protection_level import protection_level
from isogal.matching.interfaces import Fix
from isogal_ros import topics
from isogal_ros.messages.fix_information import FixMessage, fill_fix_information
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.position import read_position
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes.health import WARN

TODAY = 1_764_187_200_123_456_789
"""ns; a float of seconds is 11 ns off, and up to 119 of others."""


def test_the_path_stays_short_and_whole_and_ends_with_the_newest(
    scenario, advance, monkeypatch
) -> None:
    monkeypatch.setattr("ukf_fusion_node.outputs.PATH_POSES", 4)
    with bench(topics.UKF_FUSION, scenario(), path_interval=2.0) as made:
        advance(made, 1, 13)
        made.fix(13, 0.0, 0.0)  # answered with odometry of the same stamp
        paths, odometry = made.heard["nav/path"], made.heard["nav/odom"]
    seconds = [[pose.header.stamp.sec for pose in path.poses] for path in paths]
    assert seconds[:6] == [[0], [0, 1], [0, 2], [0, 2, 3], [0, 2, 4], [0, 2, 4, 5]]
    assert seconds[6:9] == [[0, 2, 4, 6], [0, 2, 4, 6, 7], [0, 4, 8]]
    since = [9], [10], [11], [12], [12, 13]
    assert seconds[9:] == [[0, 4, 8, *rest] for rest in since]
    for path, state in zip(paths, odometry, strict=False):
        assert path.header == state.header == path.poses[-1].header
        assert path.poses[-1].pose == state.pose.pose


def test_the_protection_level_is_that_of_the_odometrys_covariance(scenario, advance) -> None:
    settings = "integrity.risk=1e-3", "integrity.correlation_time=500"
    with bench(topics.UKF_FUSION, scenario(*settings)) as made:
        advance(made, 1, 3)
        odometry, levels = made.heard["nav/odom"], made.heard["nav/protection_level"]
    assert len(levels) == len(odometry) == 4
    covariance = [np.reshape(one.pose.covariance, (6, 6))[:2, :2] for one in odometry]
    expected = protection_level(covariance, 1e-3, 500.0)
    np.testing.assert_allclose([level.data for level in levels], expected, rtol=1e-9)
    assert np.all(expected > 3.0 * np.sqrt([one[0, 0] for one in covariance]))


@pytest.mark.parametrize(
    ("send", "topic", "words"),
    [
        (lambda b: b.imu(3, (math.nan, 0.0, -9.8)), "imu/data_raw", "not finite"),
        (lambda b: b.imu(3, (80.0, 0.0, -9.8)), "imu/data_raw", "beyond gravity"),
        (lambda b: b.imu(3, rate=(0.0, 0.0, 9.0)), "imu/data_raw", "angular rate"),
        (lambda b: b.fix(2, -0.6, 2.5, variance=0.0), "pmht_mm/fix", "not positive definite"),
        (lambda b: b.fix(99, -0.6, 2.5), "pmht_mm/fix", "ahead of the navigator"),
    ],
)
def test_bad_messages_are_dropped_and_said(filtering, advance, send, topic, words) -> None:
    """What else is bad of a message, tests of its reader say."""
    advance(filtering, 1, 2)
    send(filtering)
    level, message, figures = filtering.told(words)
    assert level == WARN
    assert topic in message
    assert figures[f"dropped {topic}"] == "1"
    # and it goes on
    advance(filtering, 4, 4)
    assert stamps(filtering, topics.NAV_FIX)[:4] in ([0, 1, 2, 4], [0, 1, 2, 2])
    assert np.isfinite(read_position(filtering.heard["nav/fix"][-1])).all()


@pytest.mark.parametrize("variance", [1e20, math.nan])
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


@pytest.mark.parametrize("position_first", [True, False])
def test_what_a_fix_says_and_its_position_are_used_once_in_either_order(
    filtering, advance, start, position_first
) -> None:
    """The whole fix long after its position, as far as stamps go."""
    whole = topics.INFORMATION.type()
    one = Fix(8.0, start[0] + 1e-5, start[1] - 1e-5, np.eye(2))
    fill_fix_information(whole, from_seconds(8.0), FixMessage(one))
    filtering.publisher(topics.INFORMATION)
    advance(filtering, 1, 60)
    if not position_first:
        filtering.publish(topics.INFORMATION, whole)
    filtering.fix(8, start[0] + 2e-3, start[1])  # not to be used
    assert filtering.node.answered == (0 if position_first else 1)
    if position_first:
        filtering.publish(topics.INFORMATION, whole)
    assert filtering.node.answered == 1
    assert abs(filtering.node.health.figures["innovation north"]) < 200.0  # of the whole one


def test_an_imu_faster_than_told_is_said(filtering) -> None:
    for k in range(1, 60):
        filtering.imu(0.05 * k, (0.0, 0.0, -9.8 + 1e-4 * (k % 7)))
    assert filtering.told("IMU samples come at 20 Hz, imu.rate says 1")[0] == WARN


def test_a_given_start(scenario) -> None:
    own = {
        "start_time": math.nan,
        "start_position": [-35.0, 149.0, 50.0],
        "start_velocity": [1.0, 2.0, 0.0],
        "start_attitude": [0.0, 0.0, 90.0],
    }
    with bench(topics.UKF_FUSION, scenario(), **own) as made:
        made.imu(1_700_000_000)  # stamps of the wall clock
        first, twist = made.heard["nav/fix"][0], made.heard["nav/odom"][0].twist.twist.linear
    place = first.latitude, first.longitude, first.altitude
    assert place == pytest.approx((-35.0, 149.0, 50.0))
    # nose to the east: forward is east, left is north
    assert (twist.x, twist.y) == pytest.approx((2.0, 1.0))


def test_a_smoothed_state_is_a_lag_old_and_knows_of_the_fixes_since(scenario, advance) -> None:
    with bench(topics.UKF_FUSION, scenario("fusion.lag=20")) as made:
        for k in range(1, 61):
            made.imu(k)
            if k == 30:
                latitude, longitude, _ = read_position(made.heard["nav/fix"][-1])
                made.fix(30, latitude + 1e-5, longitude, variance=1.0)
            said = stamps(made, topics.SMOOTHED)
            assert not said or 20 <= k - said[-1] <= 22
    assert said == list(range(1, 40))
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
    samples = [TODAY + k * 1_000_000_007 for k in range(40)]
    with bench(topics.UKF_FUSION, scenario("fusion.lag=20"), start_time=math.nan) as made:
        for ns in samples:
            message = topics.IMU.type()
            message.header.frame_id = "base_link"
            fill_imu(message, ns, np.array([0.0, 0.0, -9.8]), np.zeros(3))
            made.publish(topics.IMU, message)
        said = [to_ns(message.header.stamp) for message in made.heard["nav/smoothed"]]
    assert len(said) > 15
    assert said == samples[: len(said)]
