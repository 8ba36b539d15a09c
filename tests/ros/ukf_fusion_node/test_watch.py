"""IMU samples that could each be right, and are not."""

import numpy as np
import pytest

from helpers.node_bench import bench, stamps
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.nodes.health import OK, WARN
from ukf_fusion_node.watch import SILENT, STUCK, Watch

LEVEL = np.array([0.0, 0.0, -9.8])
NOISE = np.random.default_rng(1).normal(0.0, 1e-5, (500, 6))


def test_a_stuck_axis_is_named_and_forgotten_when_it_moves() -> None:
    watch = Watch(30.0, 3.0)
    for k in range(STUCK + 1):
        force, rate = LEVEL + NOISE[k, :3], NOISE[k, 3:].copy()
        rate[1] = 1e-4
        watch.take(force, rate)
    assert watch.stuck == "gyroscope y"
    watch.take(LEVEL, NOISE[0, 3:])
    assert watch.stuck == ""


@pytest.mark.parametrize(
    ("force", "rate", "words"),
    [
        ((80.0, 0.0, -9.8), (0.0, 0.0, 0.0), "beyond gravity"),
        ((0.0, 0.0, -9.8), (0.0, 0.0, 9.0), "angular rate"),
    ],
)
def test_a_spike_is_dropped_and_does_no_harm(scenario, force, rate, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        Watch(30.0, 3.0).take(np.array(force), np.array(rate))
    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in range(1, 20):
            made.imu(k, *((force, rate) if k == 10 else ()))
        made.wait(lambda: 19 in stamps(made, topics.NAV_FIX))
        assert made.node.health.dropped == {"imu/data_raw": 1}
        assert 10 not in stamps(made, topics.NAV_FIX)
        speed = made.heard["nav/odom"][-1].twist.twist.linear
        assert abs(speed.x) < 60.0


def test_silence() -> None:
    now = [0.0]
    watch = Watch(30.0, 3.0, lambda: now[0])
    now[0] = 100.0
    assert watch.silent is None  # nothing has begun
    watch.take(LEVEL, np.zeros(3))
    now[0] += 0.9 * SILENT
    assert watch.silent is None
    now[0] += SILENT
    assert "no IMU samples for 19 s" in watch.silent


def test_a_concern_stays_until_it_is_over(scenario) -> None:
    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in range(1, STUCK + 5):
            made.imu(k)
        made.wait(lambda: made.node.samples == STUCK + 4)
        made.wait(lambda: any("stuck: accelerometer x" in text for _, text, _ in made.says()))
        assert made.says()[-1][0] == WARN
        for k in range(STUCK + 5, STUCK + 8):
            made.imu(k, LEVEL + NOISE[k, :3], NOISE[k, 3:])
        made.wait(lambda: made.says()[-1][:2] == (OK, "navigating"))
