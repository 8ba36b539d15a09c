"""Messages of an altimeter with several beams, there and back."""

import numpy as np
import pytest
from sensor_msgs.msg import PointField

from isogal.scenario import Altimeter
from isogal.sensors.beams import beam_directions
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.soundings import PointsAdapter, ScanAdapter

FIVE = Altimeter(beams=5, opening=100.0, max_range=500.0)
LENGTH = np.float32([100.0, 120.0, 140.0, 160.0, 180.0]).astype(float)
FELT = np.float32(LENGTH[:, None] * beam_directions(FIVE)).astype(float)


@pytest.mark.parametrize("adapter", [PointsAdapter(FIVE), ScanAdapter(FIVE)])
def test_there_and_back(adapter):
    message = adapter.new_raw()
    felt = FELT.copy()
    felt[3] = np.nan
    adapter.fill_raw(message, 1_500_000_000, felt, 0.25)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    found, variance = adapter.read_raw(message)
    assert variance is None
    order = np.argsort(found[:, 1])  # NaN last
    expected = felt[np.argsort(felt[:, 1])]
    np.testing.assert_allclose(found[order], expected, atol=1e-4)


def test_axes_of_points_and_of_a_scan():
    points = PointsAdapter(FIVE)
    message = points.new_raw()
    points.fill_raw(message, 0, FELT, 0.25)
    first = np.frombuffer(bytes(message.data), "<f4").reshape(-1, 3)[0]
    assert message.header.frame_id == "base_link"
    np.testing.assert_allclose(first, (0.0, 0.0, -100.0), atol=1e-4)  # z up
    scan = ScanAdapter(FIVE)
    message = scan.new_raw()
    felt = FELT.copy()
    starboard = felt[:, 1] > 0.0
    felt[starboard] = np.nan
    scan.fill_raw(message, 0, felt, 0.25)
    assert message.angle_max == pytest.approx(np.radians(50.0))
    assert np.isinf(message.ranges[:2]).all() and np.isfinite(message.ranges[2:]).all()


def test_more_beams_than_wanted_in_other_layouts():
    points = PointsAdapter(FIVE)
    message = points.new_raw()
    across = np.linspace(-60.0, 60.0, 41)
    table = np.zeros(41, dtype=[("i", ">f4"), ("y", ">f8"), ("z", ">f8"), ("x", ">f8")])
    table["y"], table["z"] = across, -50.0
    message.fields = [
        PointField(name=name, offset=offset, datatype=kind, count=1)
        for name, offset, kind in (("i", 0, 7), ("y", 4, 8), ("z", 12, 8), ("x", 20, 8))
    ]
    message.is_bigendian, message.point_step = True, table.itemsize
    message.width, message.height, message.data = 41, 1, table.tobytes()
    found, _ = points.read_raw(message)
    assert found.shape == (5, 3)
    np.testing.assert_array_equal(found[:, 2], 50.0)
    np.testing.assert_allclose(np.sort(found[:, 1]), [-60, -30, 0, 30, 60])


def test_footprints_there_and_back():
    adapter = PointsAdapter(FIVE)
    message = adapter.new_reduced()
    value = np.arange(20.0).reshape(5, 4)
    value[2] = np.nan
    adapter.fill_reduced(message, 5, value, 0.5, None)
    found, variance = adapter.read_reduced(message)
    np.testing.assert_array_equal(found, value)
    assert variance == 0.5
    adapter.fill_reduced(message, 5, np.full((5, 3), np.nan), 0.5, None)  # no navigator
    assert np.isnan(adapter.read_reduced(message)[0]).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"fields": []}, "fields x, y and z"),
        ({"data": b""}, "beyond the end of the data"),
        ({"point_step": 8}, "field z lies beyond"),
    ],
)
def test_bad_points_are_refused(change, said):
    adapter = PointsAdapter(FIVE)
    message = adapter.new_raw()
    adapter.fill_raw(message, 0, FELT, 0.25)
    for name, value in change.items():
        setattr(message, name, value)
    with pytest.raises(BadMessageError, match=said):
        adapter.read_raw(message)


def test_bad_scans_and_footprints_are_refused():
    scan = ScanAdapter(FIVE)
    message = scan.new_raw()
    message.ranges = [float("nan")] * 5
    with pytest.raises(BadMessageError, match="not a number"):
        scan.read_raw(message)
    other = PointsAdapter(Altimeter(beams=4))
    message = other.new_reduced()
    other.fill_reduced(message, 0, np.zeros((4, 4)), 1.0, None)
    with pytest.raises(BadMessageError, match="20 x float64"):
        scan.read_reduced(message)
