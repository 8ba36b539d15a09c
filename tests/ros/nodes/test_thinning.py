"""Which readings of an instrument are scans."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("rclpy", reason="needs ROS 2 (rclpy)")

from gravimeter_node.thinning import Thinning

INTERVAL = 10_000


def scans(stamps) -> np.ndarray:
    thinning = Thinning(INTERVAL)
    return np.array([ns for ns in stamps if thinning.takes(int(ns))])


@given(st.floats(10.0, 9000.0), st.integers(0, 10**9))
def test_a_fast_instrument_gives_a_scan_per_interval(period, first):
    stamps = (first + np.arange(0, 40 * INTERVAL, period)).astype(int)
    apart = np.diff(scans(stamps))
    assert apart[1:].mean() == pytest.approx(INTERVAL, rel=0.05)
    assert apart.max() < 1.5 * INTERVAL + period


@given(st.floats(1.0, 3.0), st.integers(0, 10**9), st.integers(0, 100))
def test_a_slow_or_unsteady_one_loses_nothing(slowness, first, seed):
    jitter = np.random.default_rng(seed).uniform(-0.12, 0.12, 50)
    stamps = (first + INTERVAL * (slowness * np.arange(50) + jitter)).astype(int)
    assert scans(stamps).tolist() == stamps.tolist()
