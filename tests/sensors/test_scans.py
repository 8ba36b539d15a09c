"""Which readings of an instrument are scans, and which are missing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isogal.sensors.scans import MOST_MISSING, Thinning, missing_scans

INTERVAL = 10_000


def scans(stamps):
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


@pytest.mark.parametrize(
    ("now", "missing"),
    [
        (20_000, []),
        (24_999, []),  # late
        (25_000, [20_000]),
        (30_000, [20_000]),
        (51_000, [20_000, 30_000, 40_000]),
    ],
)
def test_scans_are_missing_where_a_gap_is_longer_than_an_interval(now, missing):
    assert list(missing_scans(10_000, now, INTERVAL)) == missing


def test_a_very_long_gap_is_not_filled_to_its_end():
    assert len(missing_scans(0, 10**9 * INTERVAL, INTERVAL)) == MOST_MISSING
