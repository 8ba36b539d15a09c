"""IMU samples that could each be right, and are not."""

import numpy as np
import pytest

from helpers.node_bench import bench, stamps
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.nodes.health import OK, WARN
from ukf_fusion_node.watch import LEARNT, LEAST, SILENT, STUCK, StuckError, Watch

LEVEL = np.array([0.0, 0.0, -9.8])
NOISE = np.random.default_rng(1).normal(0.0, 1e-5, (500, 6))


def test_a_stuck_axis_is_named_and_forgotten_when_it_moves() -> None:
    watch = Watch(30.0, 3.0)
    for k in range(STUCK + 1):
        force, rate = LEVEL + NOISE[k, :3], NOISE[k, 3:].copy()
        rate[1] = 1e-4
        watch.take(force, rate)
    assert watch.stuck == "stuck: gyroscope y"
    watch.take(LEVEL, NOISE[0, 3:])
    assert watch.stuck is None


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
        assert 19 in stamps(made, topics.NAV_FIX)
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
        assert made.told("stuck: accelerometer x")
        assert made.says()[-1][0] == WARN
        for k in range(STUCK + 5, STUCK + 8):
            made.imu(k, LEVEL + NOISE[k, :3], NOISE[k, 3:])
        made.wait(lambda: made.says()[-1][:2] == (OK, "navigating"))


def noisy(watch: Watch, count: int, step: float = 0.0) -> None:
    """Samples of an IMU at rest; it counts in steps where that is not zero."""
    for sample in NOISE[:count]:
        seen = sample if step == 0.0 else step * np.round(sample / step)
        watch.take(LEVEL + seen[:3], seen[3:])


def test_an_axis_that_stops_moving_is_stuck_after_a_few_samples() -> None:
    watch = Watch(30.0, 3.0)
    noisy(watch, LEARNT + 1)
    dead = NOISE[:, 3:] * [1.0, 1.0, 0.0]
    for k in range(LEAST):
        watch.take(LEVEL + NOISE[k, :3], dead[k])
    for later in range(30):
        with pytest.raises(StuckError, match="gyroscope z stuck") as caught:
            watch.take(LEVEL + NOISE[later, :3], dead[later])
        assert caught.value.samples == (LEAST if later == 0 else 0)
    noisy(watch, 10)


def test_coarse_steps_and_an_imu_without_noise_are_not_stuck() -> None:
    """Steps of five times the noise: four of five samples repeat the value before."""
    noisy(Watch(30.0, 3.0), 500, step=5e-5)
    perfect = Watch(30.0, 3.0, noisy=np.zeros(6, bool))
    noisy(perfect, LEARNT + 1)
    for _ in range(2 * STUCK):
        perfect.take(LEVEL, np.zeros(3))


def test_a_stuck_axis_is_an_outage(scenario) -> None:
    """Of its samples none is used, and the covariance grows as of missing ones."""
    first, last = LEARNT + 2, LEARNT + 22
    with bench(topics.UKF_FUSION, scenario()) as made:
        for k in range(1, last + 6):
            rate = NOISE[k, 3:] * (1.0 if not first <= k <= last else [1.0, 1.0, 0.0])
            made.imu(k, LEVEL + NOISE[k, :3], rate)
        made.wait(lambda: last + 5 in stamps(made, topics.NAV_FIX))
        kept = [part.end for part in made.node._navigation.navigator._segments]
        assert kept[first - 1 : first + 1] == [first - 1, last + 2]  # one more: its stamp leaps
        assert made.told("gyroscope z stuck")
        assert made.told("whether there was a sharp manoeuvre")
        assert made.says()[-1][0] == WARN
