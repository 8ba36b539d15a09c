"""IMU samples that could each be right, and are not; what is not known where some were missing."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers.node_bench import bench, played, stamps
from isogal_ros import topics
from isogal_ros.faults.campaign import player_of, simulated
from isogal_ros.nodes.health import WARN
from ukf_fusion_node.sample_checks import (
    LASTS,
    LEARNT,
    LEAST,
    REMEMBERED,
    SILENT,
    GravityDirection,
    SampleMonitor,
)

LEVEL = np.array([0.0, 0.0, -9.8])
NOISE = np.random.default_rng(1).normal(0.0, 1e-5, (500, 6))


def monitor(clock=lambda: 0.0) -> SampleMonitor:
    return SampleMonitor(30.0, 3.0, clock, np.ones(6, dtype=bool))


def test_silence() -> None:
    now = [0.0]
    watch = monitor(lambda: now[0])
    now[0] = 100.0
    assert watch.silent is None  # nothing has begun
    watch.take(LEVEL, np.zeros(3))
    now[0] += 0.9 * SILENT
    assert watch.silent is None
    now[0] += SILENT
    assert "no IMU samples for 19 s" in watch.silent


def noisy(watch: SampleMonitor, count: int, step: float = 0.0) -> None:
    """Samples of an IMU at rest; it counts in steps where that is not zero."""
    for sample in NOISE[:count]:
        seen = sample if step == 0.0 else step * np.round(sample / step)
        assert watch.take(LEVEL + seen[:3], seen[3:]) is None


def test_an_axis_that_stops_moving_is_stuck_after_a_few_samples() -> None:
    watch = monitor()
    noisy(watch, LEARNT + 1)
    dead = NOISE[:, 3:] * [1.0, 1.0, 0.0]
    for k in range(LEAST):
        watch.take(LEVEL + NOISE[k, :3], dead[k])
    for later in range(30):
        found = watch.take(LEVEL + NOISE[later, :3], dead[later])
        assert found.refused and "gyroscope z stuck" in found.why
        assert found.before == (LEAST if later == 0 else 0)
    noisy(watch, 10)


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


LATER = REMEMBERED + 10


def found(*changes: tuple[int, int, float]) -> list[int]:
    """Indices of samples at which the one before was out of line; changes are (index, axis,
    value)."""
    samples = NOISE.copy()
    for index, axis, value in changes:
        samples[index, axis] += value
    watch = monitor()
    return [k for k, each in enumerate(samples) if watch.take(LEVEL + each[:3], each[3:])]


@pytest.mark.parametrize(("changes", "out_of_line"), [
    ([], []),
    ([(LATER, 2, -5.0)], [LATER + 1]),
    ([(LATER, 5, 0.05), (LATER + 7, 5, 0.05)], [LATER + 1, LATER + 8]),
    ([(k, 0, 0.2) for k in range(LATER, LATER + 30)], []),
    ([(LATER, 1, 0.2), (LATER, 5, 0.05)], []),
    ([(LATER, 1, 0.02), (LATER, 5, 9e-4)], []),
    ([(LATER, 0, 0.2), (LATER + 1, 0, -0.2)], []),
    ([(5, 0, 0.2)], []),  # it is not yet known how the vehicle moves
    ([*((k, 0, 0.5 * np.sin(1.3 * k)) for k in range(500)), (LATER, 0, 1.5)], []),
], ids=["noise", "force", "rate twice", "manoeuvre", "turn of one sample", "slight turn",
        "there and back", "early", "sea way"])  # fmt: skip
def test_one_sample_is_out_of_line_and_a_motion_is_believed(changes, out_of_line) -> None:
    assert found(*changes) == out_of_line


def test_the_filter_goes_on_as_if_it_had_not_been(scenario) -> None:
    """0.2 m/s² for a second would leave 0.2 m/s; the next sample stands for two seconds, which
    leaves less than 1e-3 m/s."""
    speeds = []
    for size in (0.0, 0.2):
        with bench(topics.UKF_FUSION, scenario()) as made:
            for k in range(1, LATER + 5):
                made.imu(k, LEVEL + NOISE[k, :3] + [size * (k == LATER), 0.0, 0.0], NOISE[k, 3:])
            made.wait(lambda: LATER + 4 in stamps(made, topics.NAV_FIX))
            linear = made.heard["nav/odom"][-1].twist.twist.linear
            speeds.append((linear.x, linear.y))
            told = any("0.2 m/s² out of line" in text for _, text, _ in made.says())
            assert told == (size > 0.0)
            assert made.node.health.dropped == ({"imu/data_raw": 1} if size else {})
    assert speeds[1] == pytest.approx(speeds[0], abs=1e-3)


BANKED = Rotation.from_euler("ZYX", [40.0, 5.0, 60.0], degrees=True)
"""Heading, pitch and roll of a turn with twice the weight on its wings."""
NO_TURN = Rotation.identity()


def told(force: np.ndarray, turn: Rotation = NO_TURN, minutes: float = 1.0) -> str:
    """Return what is said of a minute or more of the same sample."""
    upright, said = GravityDirection(), None
    attitude = turn.as_quat()[[3, 0, 1, 2]]
    for time in np.arange(0.0, minutes * LASTS + 0.1):
        said = upright.take(time, force, attitude)
    return said or ""


TURNING = BANKED.inv().apply([12.0, -12.0, -9.8])
WRONG = "upwards, not 9.81: axes"


@pytest.mark.parametrize(
    ("force", "turn", "words"),
    [
        (LEVEL, NO_TURN, ""),
        (TURNING, BANKED, ""),
        (-LEVEL, NO_TURN, WRONG),
        (LEVEL / 9.8, NO_TURN, WRONG),
        (LEVEL, BANKED, WRONG),
    ],
    ids=["level", "banked", "z down", "in g", "attitude lost"],
)
def test_what_is_not_gravity_is_said_after_a_minute(force, turn, words) -> None:
    assert told(force, turn, 0.9) == ""
    said = told(force, turn)
    assert words in said and bool(words) == bool(said)


GAP = 60.0
"""s."""


ELBOW = [[-36.6, 146.9, 22.0], [-36.558, 146.9522, 22.0], [-36.5930, 146.9958, 22.0]]
"""Waypoints (deg, m/s) of five minutes north-east, and four south-east."""


def test_a_sharp_turn_in_a_gap_is_never_silent(scenario) -> None:
    own = "matcher.name=pmht", "matcher.batch_length=30", "matcher.stride=5"
    way = f"route.waypoints={ELBOW}", "route.turn_rate=0.1", "route.duration=540.0"
    player = player_of(simulated(scenario(*way, *own), 0))
    player.bus.change = lambda topic, data: (
        [] if topic == topics.IMU.name and abs(player.bus.now - 300.0) <= GAP / 2.0 else [data]
    )
    track, silent = played(player)
    assert track.error[track.time > 300.0].max() > 150.0
    assert silent == []
