"""The filter's node with an IMU of 200 Hz: jitter, lost samples, long gaps, another rate; what
comes within a step."""

import numpy as np
import pytest

from helpers.node_bench import Bench, bench, stamps
from isogal.earth.frames import horizontal_difference
from isogal.sensors.imu import simulate_samples
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.stamps import to_ns
from isogal_ros.nodes.health import ERROR, OK, WARN

SECONDS = 6
KEYS = (
    "imu.rate=200.0",
    "imu.grade=navigation",
    "gravity.field=normal",
    f"route.duration={SECONDS}.0",
)


@pytest.fixture(scope="module")
def fast(scenario):
    return scenario(*KEYS)


@pytest.fixture(scope="module")
def samples(fast):
    """(K, 6) samples of run 0."""
    return simulate_samples(fast, build_trajectory(fast), 0)


def send(made: Bench, samples, stamps_s) -> None:
    for k, stamp in stamps_s:
        made.imu(stamp, tuple(samples[k, :3]), tuple(samples[k, 3:]))


def regular(first: int, last: int, rate: float = 200.0):
    """Sample number and stamp (s) of samples."""
    return [(k, (k + 1) / rate) for k in range(first, last)]


@pytest.fixture(scope="module")
def undisturbed(fast, samples) -> Bench:
    """The bench of a filter that has had all samples."""
    with bench(topics.UKF_FUSION, fast) as made:
        send(made, samples, regular(0, 200 * SECONDS))
        return made


def apart(made: Bench, undisturbed: Bench, second: int) -> float:
    """Distance (m) of two filters at a second; the first may have begun within one."""
    found = []
    for one in (made, undisturbed):
        fixes = dict(zip(stamps(one, topics.NAV_FIX), one.heard["nav/fix"], strict=True))
        found += read_position(fixes[second])[:2]
    return np.hypot(*horizontal_difference(*found))


def test_jitter_and_lost_samples_move_it_by_millimetres(fast, samples, undisturbed) -> None:
    random = np.random.default_rng(1)
    whole = regular(0, 200 * SECONDS)
    kept = [(k, t + random.uniform(-8e-4, 8e-4)) for k, t in whole if k % 157 != 50]
    lost = str(len(whole) - len(kept))
    with bench(topics.UKF_FUSION, fast) as made:
        send(made, samples, kept)
        made.wait(lambda: SECONDS - 1 in stamps(made, topics.NAV_FIX))
        made.wait(lambda: made.says()[-1][2].get("IMU samples missing") == lost)
    assert apart(made, undisturbed, SECONDS - 1) < 0.02


def test_a_long_gap_is_said_and_known(fast, samples) -> None:
    with bench(topics.UKF_FUSION, fast) as made:
        send(made, samples, regular(0, 400))
        before = read_covariance(made.heard["nav/fix"][-1])
        send(made, samples, [(k, (k + 1) / 200.0 + 60.0) for k in range(400, 900)])
        assert made.told("IMU samples missing")[0] == ERROR
        after = read_covariance(made.heard["nav/fix"][-1])
    # a minute in which 0.1 m/s² may have acted: 5.8 m/s, since the vehicle has 22 m/s, that is
    # 174 m, and 12 m in the two seconds since, along two axes
    grown = np.sqrt(after[:2, :2].trace() - before[:2, :2].trace())
    assert grown == pytest.approx(np.sqrt(2.0) * (174.0 + 12.0), rel=0.03)


@pytest.mark.parametrize("rate", [100.0, 400.0])
def test_another_rate_than_told_is_said_once_and_does_no_harm(
    fast, samples, undisturbed, rate
) -> None:
    every = samples[1::2] if rate < 200.0 else np.repeat(samples, 2, axis=0)
    with bench(topics.UKF_FUSION, fast) as made:
        send(made, every, regular(0, int(4 * rate), rate))
        # the start is a told interval before the first sample
        assert [stamp for stamp in stamps(made, topics.NAV_FIX) if stamp > 0] == list(range(1, 5))
        assert made.told(f"come at {rate:.0f} Hz, imu.rate says 200")[0] == WARN
        assert sum("imu.rate says" in text for _, text, _ in made.says()) <= 8
        assert "IMU samples missing" not in made.says()[-1][2]
    assert undisturbed.says()[-1][0] == OK
    assert apart(made, undisturbed, 4) < 0.2  # milliseconds of the start, at 22 m/s


def test_odometry_comes_at_50_hz_and_is_smooth(undisturbed) -> None:
    odometry = undisturbed.heard["nav/odom"]
    times = np.array([to_ns(one.header.stamp) / 1e9 for one in odometry])
    assert stamps(undisturbed, topics.NAV_FIX) == list(range(SECONDS + 1))
    points = np.array([[p.x, p.y, p.z] for p in (one.pose.pose.position for one in odometry)])
    assert np.diff(times) == pytest.approx(0.02)
    assert times[-1] == SECONDS
    # 22 m/s, and no jump where a step ends
    moved = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert moved == pytest.approx(0.02 * 22.0, abs=2e-3)
    assert np.abs(np.diff(moved)).max() < 1e-3


def test_a_fix_or_a_pose_that_comes_within_a_step_is_used_at_its_end(fast, samples) -> None:
    with bench(topics.UKF_FUSION, fast) as made:
        send(made, samples, regular(0, 300))
        before = len(made.heard["nav/fix"])
        latitude, longitude, _ = read_position(made.heard["nav/fix"][-1])
        made.fix(1.0, latitude + 1e-5, longitude)
        assert len(made.heard["nav/fix"]) == before
        send(made, samples, regular(300, 500))
        assert stamps(made, topics.NAV_FIX)[before:] == [2, 2]
        times = [to_ns(one.header.stamp) for one in made.heard["nav/odom"]]
        assert times.count(2 * 10**9) == 2
        assert "dropped" not in " ".join(text for _, text, _ in made.says())
        pose = topics.INITIAL_POSE.type()
        pose.header.frame_id = "map"
        pose.pose.pose.position.x, pose.pose.pose.orientation.w = 1000.0, 1.0
        pose.pose.covariance[0] = pose.pose.covariance[7] = 1.0
        made.publish(topics.INITIAL_POSE, pose)
        send(made, samples, regular(500, 700))
        east = [one.pose.pose.position.x for one in made.heard["nav/odom"]]
        assert east[-25] == pytest.approx(1000.0, abs=1.0)
        times = [to_ns(one.header.stamp) for one in made.heard["nav/odom"]]
        assert times == sorted(times)
