"""Scans that wait to become a batch: a buffer that moves, against plain lists."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from isogal.matching.scans import Scan, Scans


def scan(k: int, channels: int = 0) -> Scan:
    reading = 0.1 * k if not channels else np.arange(2.0 * channels).reshape(channels, 2) + k
    velocity = np.array([10.0 + k, -k])
    return Scan(10.0 * k, -0.6, 2.5 + 1e-6 * k, velocity, reading, 1.0, 0.5 * k, 100.0 + k)


def scans_of(most: int, channels: int) -> Scans:
    return Scans(most, (channels, 2)) if channels else Scans(most)


@given(most=st.integers(1, 7), added=st.integers(1, 40), channels=st.integers(0, 2))
def test_the_last_scans_are_kept_in_their_order(most: int, added: int, channels: int) -> None:
    scans, plain = scans_of(most, channels), [scan(k, channels) for k in range(added)]
    scans.extend(plain)
    kept = plain[-most:]
    assert len(scans) == len(kept)
    assert scans.last(most + 30) == scans.every
    latitude, longitude, velocity, times = scans.track(scans.every)
    np.testing.assert_array_equal(times, [one.time for one in kept])
    np.testing.assert_array_equal(latitude, [one.latitude for one in kept])
    np.testing.assert_array_equal(longitude, [one.longitude for one in kept])
    np.testing.assert_array_equal(velocity, [one.velocity for one in kept])
    readings = np.array([one.reading for one in kept]).reshape(len(kept), *scans.shape)
    np.testing.assert_array_equal(scans.readings(scans.every), readings)
    np.testing.assert_array_equal(scans.offsets(scans.every), [one.offset for one in kept])
    np.testing.assert_array_equal(scans.heights(scans.every), [one.height for one in kept])
    for k in (0, len(kept) - 1, -1):
        one, same = scans[k], kept[k]
        assert (one.time, one.offset, one.height) == (same.time, same.offset, same.height)
        np.testing.assert_array_equal(one.velocity, same.velocity)
        np.testing.assert_array_equal(one.reading, same.reading)


@pytest.mark.parametrize("channels", [0, 2])
def test_a_move_reaches_the_scans_that_are_told_and_no_batch(channels: int) -> None:
    scans = scans_of(5, channels)
    scans.extend(scan(k, channels) for k in range(12))
    before = scans.track(scans.every), scans.readings(scans.every)
    which = scans.until(100.0)  # without the last one
    shift = np.array([[6378.0, 0.0, 1.0, 2.0]] * 4)
    scans.move(which, shift, np.arange(4.0))
    latitude, longitude, velocity, _ = scans.track(scans.every)
    moved = latitude - before[0][0]
    assert moved[:4] == pytest.approx(1e-3, rel=0.01)
    assert moved[4] == 0.0
    np.testing.assert_array_equal(longitude, before[0][1])
    np.testing.assert_array_equal(velocity - before[0][2], [[1.0, 2.0]] * 4 + [[0.0, 0.0]])
    change = scans.readings(scans.every) - before[1]
    expected = np.zeros_like(change)
    expected[:4, :, 0] = np.arange(4.0)[:, None]
    np.testing.assert_allclose(change, expected, atol=1e-12)


def test_readings_before_a_gap_are_given_up() -> None:
    scans = Scans(4)
    scans.extend(scan(k) for k in range(6))
    scans.forget_readings(40.0)
    np.testing.assert_array_equal(
        np.isnan(scans.readings(scans.every)).ravel(), [True, True, False, False]
    )
