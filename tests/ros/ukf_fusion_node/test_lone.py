"""A single IMU sample that is out of line is not used; a manoeuvre is."""

import numpy as np
import pytest

from helpers.node_bench import bench, stamps
from isogal_ros import topics
from ukf_fusion_node.watch import REMEMBERED, LoneSamples

LEVEL = np.array([0.0, 0.0, -9.8])
NOISE = np.random.default_rng(1).normal(0.0, 1e-5, (500, 6))
LATER = REMEMBERED + 10


def found(*changes: tuple[int, int, float]) -> list[int]:
    """Indices of samples at which the one before was out of line; changes are (index, axis,
    value)."""
    samples = NOISE.copy()
    for index, axis, value in changes:
        samples[index, axis] += value
    lone = LoneSamples()
    return [k for k, each in enumerate(samples) if lone.take(LEVEL + each[:3], each[3:])]


def test_noise_is_in_line() -> None:
    assert found() == []


@pytest.mark.parametrize(("axis", "size"), [(0, 0.2), (2, -5.0), (5, 0.05)])
def test_one_sample_is_out_of_line(axis: int, size: float) -> None:
    assert found((LATER, axis, size)) == [LATER + 1]
    assert found((LATER, axis, size), (LATER + 7, axis, size)) == [LATER + 1, LATER + 8]


def test_a_manoeuvre_is_believed() -> None:
    step = [(k, 0, 0.2) for k in range(LATER, LATER + 30)]
    assert found(*step) == []
    assert found((LATER, 1, 0.2), (LATER, 5, 0.05)) == []  # a turn of one sample
    assert found((LATER, 1, 0.02), (LATER, 5, 9e-4)) == []  # a slight one
    assert found((LATER, 0, 0.2), (LATER + 1, 0, -0.2)) == []  # there and back
    assert found((5, 0, 0.2)) == []  # it is not yet known how the vehicle moves


def test_a_sea_way_is_not_out_of_line() -> None:
    waves = [(k, 0, 0.5 * np.sin(1.3 * k)) for k in range(500)]
    assert found(*waves, (LATER, 0, 1.5)) == []


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
