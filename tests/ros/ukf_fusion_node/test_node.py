"""The filter's node: what it answers, and that no message ends it."""

import math

import numpy as np
import pytest

from helpers.node_bench import bench, stamps
from isogal.earth.frames import horizontal_difference
from isogal.fusion.protection_level import protection_level
from isogal.matching.interfaces import Fix
from isogal_ros import topics
from isogal_ros.messages.adapter import topics_in_use
from isogal_ros.messages.fix_information import FixMessage, fill_fix_information
from isogal_ros.messages.imu import fill_imu
from isogal_ros.messages.position import read_position
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.nodes.health import OK, WARN


@pytest.fixture
def filter_bench(scenario):
    with bench(topics.UKF_FUSION, scenario()) as made:
        yield made


def test_the_path_stays_short_and_whole_and_ends_with_the_newest(scenario, monkeypatch) -> None:
    monkeypatch.setattr("ukf_fusion_node.outputs.PATH_POSES", 4)
    with bench(topics.UKF_FUSION, scenario(), path_interval=2.0) as made:
        for k in range(1, 14):
            made.imu(k)
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


def test_the_protection_level_is_that_of_the_odometrys_covariance(scenario) -> None:
    settings = "integrity.risk=1e-3", "integrity.correlation_time=500"
    with bench(topics.UKF_FUSION, scenario(*settings)) as made:
        for k in range(1, 4):
            made.imu(k)
        odometry, levels = made.heard["nav/odom"], made.heard["nav/protection_level"]
    assert len(levels) == len(odometry) == 4
    covariance = [np.reshape(one.pose.covariance, (6, 6))[:2, :2] for one in odometry]
    expected = protection_level(covariance, 1e-3, 500.0)
    np.testing.assert_allclose([level.data for level in levels], expected, rtol=1e-9)
    assert np.all(expected > 3.0 * np.sqrt([one[0, 0] for one in covariance]))


def test_a_fix_moves_it_and_is_answered(filter_bench, start) -> None:
    filter_bench.imu(1)
    filter_bench.imu(2)
    before = read_position(filter_bench.heard["nav/fix"][-1])
    filter_bench.fix(2, before[0] + 1e-5, before[1], variance=1.0)
    after = read_position(filter_bench.heard["nav/fix"][-1])
    assert (after[0] - before[0]) / 1e-5 == pytest.approx(1.0, abs=0.01)
    assert stamps(filter_bench, topics.NAV_FIX) == [0, 1, 2, 2]
    assert filter_bench.says()[-1][0] == OK


def test_a_late_fix_equals_one_in_time(scenario, start) -> None:
    results = []
    for late in (False, True):
        with bench(topics.UKF_FUSION, scenario()) as made:
            for k in range(1, 21):
                made.imu(k, (0.1, 0.02 * k, -9.8))
                if k == (20 if late else 8):
                    made.fix(8, start[0] + 1e-5, start[1] - 1e-5)
            assert len(made.heard["nav/fix"]) == 22
            results.append(read_position(made.heard["nav/fix"][-1]))
    assert horizontal_difference(*results[0][:2], *results[1][:2]) == pytest.approx(
        [0, 0], abs=1e-6
    )


@pytest.mark.parametrize(
    ("send", "topic", "words"),
    [
        (lambda b: b.imu(3, (math.nan, 0.0, -9.8)), "imu/data_raw", "not finite"),
        (lambda b: b.imu(2), "imu/data_raw", "not later than"),
        (lambda b: b.fix(2, math.nan, 0.0), "pmht_mm/fix", "not finite"),
        (lambda b: b.fix(2, -0.6, 2.5, variance=0.0), "pmht_mm/fix", "not positive definite"),
        (lambda b: b.fix(99, -0.6, 2.5), "pmht_mm/fix", "ahead of the navigator"),
    ],
)
def test_bad_messages_are_dropped_and_said(filter_bench, send, topic, words) -> None:
    """What else is bad of a message, tests of its reader say."""
    filter_bench.imu(1)
    filter_bench.imu(2)
    send(filter_bench)
    level, message, figures = filter_bench.told(words)
    assert level == WARN
    assert topic in message
    assert figures[f"dropped {topic}"] == "1"
    # and it goes on
    filter_bench.imu(3)
    filter_bench.imu(4)
    assert 4 in stamps(filter_bench, topics.NAV_FIX)
    position = read_position(filter_bench.heard["nav/fix"][-1])
    assert np.isfinite(position).all()
    assert not filter_bench.node.finished


def test_a_fix_older_than_the_horizon_is_dropped_and_said(scenario, start) -> None:
    with bench(topics.UKF_FUSION, scenario(), horizon=5.0) as made:
        for k in range(1, 31):
            made.imu(k)
        made.fix(8, *start)
        level, words, _ = made.told("older than the buffer")
        assert (level, words.count("pmht_mm/fix")) == (WARN, 1)


def test_what_a_fix_says_and_its_position_are_used_once_in_either_order(scenario, start) -> None:
    """The whole fix long after its position, as far as stamps go."""
    whole = topics.INFORMATION.type()
    covariance = np.diag([100.0, 100.0])
    one = Fix(8.0, start[0] + 1e-5, start[1] - 1e-5, covariance)
    fill_fix_information(whole, from_seconds(8.0), FixMessage(one))
    results = []
    for position_first in (True, False):
        with bench(topics.UKF_FUSION, scenario()) as made:
            made.publisher(topics.INFORMATION)
            for k in range(1, 61):
                made.imu(k)
            for is_whole in (False, True) if position_first else (True, False):
                if is_whole:
                    made.publish(topics.INFORMATION, whole)
                else:
                    made.fix(8, start[0] + 2e-3, start[1])  # not to be used
                    assert made.node.answered == (0 if position_first else 1)
            results.append(read_position(made.heard["nav/fix"][-1]))
            assert made.node.answered == 1
    assert results[0] == results[1]


def test_lost_samples_are_bridged_and_counted(filter_bench) -> None:
    for k in (1, 2, 5, 6):
        filter_bench.imu(k)
    warnings = [item for item in filter_bench.says() if item[0] == WARN]
    assert "2 IMU samples missing" in warnings[0][1]
    assert filter_bench.says()[-1][2]["IMU samples missing"] == "2"
    assert filter_bench.says()[-1][0] == OK  # over when the next sample is in time


def test_a_given_start(scenario) -> None:
    own = {
        "start_time": math.nan,
        "start_position": [-35.0, 149.0, 50.0],
        "start_velocity": [1.0, 2.0, 0.0],
        "start_attitude": [0.0, 0.0, 90.0],
    }
    with bench(topics.UKF_FUSION, scenario(), **own) as made:
        made.imu(1_700_000_000)  # stamps of the wall clock
        first = made.heard["nav/fix"][0]
        assert (first.latitude, first.longitude, first.altitude) == pytest.approx(
            (-35.0, 149.0, 50.0)
        )
        twist = made.heard["nav/odom"][0].twist.twist.linear
        assert (twist.x, twist.y) == pytest.approx(
            (2.0, 1.0)
        )  # nose to the east: forward is east, left is north


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
