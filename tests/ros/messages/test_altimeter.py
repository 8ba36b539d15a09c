"""Messages of altimeters, of one beam and of several, and what cannot be used."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import NavSatStatus, PointField, Range

from isogal.scenario import Altimeter, load_scenario
from isogal.sensors.beams import beam_directions
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.altimeter import read_range
from isogal_ros.messages.checks import BadMessageError

FAN = ("altimeter.beams=5", "altimeter.opening=100", "altimeter.max_range=500")
LENGTH = np.float32([100.0, 120.0, 140.0, 160.0, 180.0]).astype(float)
DIRECTIONS = beam_directions(Altimeter(beams=5, opening=100.0))
SOUNDINGS = np.float32(LENGTH[:, None] * DIRECTIONS).astype(float)


def of(*overrides):
    """The adapter of an altimeter."""
    return adapter_of(load_scenario(None, ["field=terrain", *overrides]))


POINTS = of(*FAN, "altimeter.message=points")
SCAN = of(*FAN, "altimeter.message=scan")


def distance(value, low=0.0, high=1000.0, variance=0.0):
    return Range(
        range=float(value), min_range=float(low), max_range=float(high), variance=float(variance)
    )


def test_zero_variance_is_an_unknown_one() -> None:
    assert read_range(distance(100.0))[1] is None


@pytest.mark.parametrize(
    ("value", "low"),
    [(math.inf, 0.0), (-math.inf, 0.0), (1000.5, 0.0), (4.9, 5.0), (-1.0, 0.0)],
)
def test_out_of_range_is_no_reading_and_no_fault(value, low) -> None:
    assert math.isnan(read_range(distance(value, low))[0])


def test_the_ends_of_the_range_are_in_it() -> None:
    assert [read_range(distance(x, 5.0, 1000.0))[0] for x in (5.0, 1000.0)] == [5.0, 1000.0]


@pytest.mark.parametrize(("message", "words"), [
    (distance(math.nan), "not a number"),
    (distance(10.0, 10.0, 10.0), "fixed distance"),
    (distance(10.0, 20.0, 5.0), "min_range 20 m is not below max_range 5 m"),
    (distance(10.0, math.nan, 5.0), "is not below"),
    (distance(10.0, variance=-1.0), "negative variance"),
    (distance(10.0, variance=math.nan), "variance is not finite"),
])  # fmt: skip
def test_ranges_that_cannot_be_used(message, words) -> None:
    with pytest.raises(BadMessageError, match=words):
        read_range(message)


def test_nothing_in_range_is_infinity_then_no_altitude() -> None:
    adapter = of("altimeter.max_range=700")
    raw = adapter.write_raw(0, math.nan, 1.0, None)
    assert (raw.range, raw.max_range) == (math.inf, 700.0)
    reduced = adapter.write_reduced(0, math.nan, 1.0, None)
    assert reduced.status.status == NavSatStatus.STATUS_NO_FIX
    assert math.isnan(adapter.read_reduced(reduced)[0])
    reduced.status.status = NavSatStatus.STATUS_FIX  # says it has one
    with pytest.raises(BadMessageError, match="not finite"):
        adapter.read_reduced(reduced)


@pytest.mark.parametrize("adapter", [POINTS, SCAN])
def test_soundings_both_ways(adapter) -> None:
    sensed = SOUNDINGS.copy()
    sensed[3] = np.nan
    message = adapter.write_raw(1_500_000_000, sensed, 0.25, None)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    found, variance = adapter.read_raw(message)
    assert variance is None
    order = np.argsort(found[:, 1])  # NaN last
    np.testing.assert_allclose(found[order], sensed[np.argsort(sensed[:, 1])], atol=1e-4)


def test_axes_of_points_and_of_a_scan() -> None:
    message = POINTS.write_raw(0, SOUNDINGS, 0.25, None)
    first = np.frombuffer(bytes(message.data), "<f4").reshape(-1, 3)[0]
    assert message.header.frame_id == "base_link"
    np.testing.assert_allclose(first, (0.0, 0.0, -100.0), atol=1e-4)  # z up
    to_port = np.where(SOUNDINGS[:, 1:2] > 0.0, np.nan, SOUNDINGS)
    message = SCAN.write_raw(0, to_port, 0.25, None)
    assert message.angle_max == pytest.approx(np.radians(50.0))
    assert np.isinf(message.ranges[:2]).all() and np.isfinite(message.ranges[2:]).all()


def test_more_beams_than_wanted_in_other_layouts() -> None:
    message = POINTS.raw.type()
    message.header.frame_id = "base_link"
    across = np.linspace(-60.0, 60.0, 41)
    table = np.zeros(41, dtype=[("i", ">f4"), ("y", ">f8"), ("z", ">f8"), ("x", ">f8")])
    table["y"], table["z"] = across, -50.0
    message.fields = [
        PointField(name=name, offset=offset, datatype=kind, count=1)
        for name, offset, kind in (("i", 0, 7), ("y", 4, 8), ("z", 12, 8), ("x", 20, 8))
    ]
    message.is_bigendian, message.point_step = True, table.itemsize
    message.width, message.height, message.data = 41, 1, table.tobytes()
    found, _ = POINTS.read_raw(message)
    assert found.shape == (5, 3)
    np.testing.assert_array_equal(found[:, 2], 50.0)
    np.testing.assert_allclose(np.sort(found[:, 1]), [-60, -30, 0, 30, 60])


def test_footprints_both_ways() -> None:
    value = np.arange(20.0).reshape(5, 4)
    value[2] = np.nan
    found, variance = POINTS.read_reduced(POINTS.write_reduced(5, value, 0.5, None))
    np.testing.assert_array_equal(found, value)
    assert variance == 0.5
    silent = POINTS.write_reduced(5, np.full((5, 3), np.nan), 0.5, None)  # no navigator
    assert np.isnan(POINTS.read_reduced(silent)[0]).all()


@pytest.mark.parametrize(
    ("adapter", "change", "said"),
    [
        (POINTS, {"fields": []}, "fields x, y and z"),
        (POINTS, {"data": b""}, "beyond the end of the data"),
        (POINTS, {"point_step": 8}, "field z lies beyond"),
        (SCAN, {"ranges": [math.nan] * 5}, "not a number"),
    ],
)
def test_soundings_that_cannot_be_used(adapter, change, said) -> None:
    message = adapter.write_raw(0, SOUNDINGS, 0.25, None)
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(BadMessageError, match=said):
        adapter.read_raw(message)


def test_footprints_of_another_number_of_beams_are_refused() -> None:
    message = of("altimeter.beams=4").write_reduced(0, np.zeros((4, 4)), 1.0, None)
    with pytest.raises(BadMessageError, match="20 x float64"):
        SCAN.read_reduced(message)
