"""Positions as messages, and what cannot be used."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import NavSatFix, NavSatStatus

from helpers.navigators import random_covariance
from isogal.earth.frames import LocalFrame, geodetic_to_ecef
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.position import (
    HEIGHT_VARIANCE,
    fill_fix,
    fill_pose,
    read_covariance,
    read_position,
)


@given(st.floats(-1.5, 1.5), st.floats(-3.14, 3.14), st.floats(-100.0, 1e4), st.integers(0, 99))
def test_both_ways(latitude, longitude, height, seed) -> None:
    message = NavSatFix()
    message.header.frame_id = "base_link"
    cov = random_covariance(np.ones(3), seed)
    fill_fix(message, 5, latitude, longitude, height, cov)
    back = read_position(message)
    np.testing.assert_allclose(back, [latitude, longitude, height], rtol=4e-16, atol=1e-15)
    np.testing.assert_array_equal(read_covariance(message), cov)
    assert message.position_covariance[0] == cov[1, 1]  # east first
    assert message.position_covariance[4] == cov[0, 0]


def test_longitude_beyond_the_date_line() -> None:
    message = NavSatFix()
    fill_fix(message, 0, 0.0, math.radians(190.0), 0.0)
    assert message.longitude == pytest.approx(-170.0)
    assert message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"latitude": math.nan}, "not finite"),
        ({"latitude": 91.0}, "no such place"),
        ({"longitude": 400.0}, "no such place"),
        ({"position_covariance": np.diag([1.0, -1.0, 1.0]).ravel()}, "negative variance"),
        ({"position_covariance": np.full(9, math.nan)}, "not finite"),
        ({"position_covariance_type": NavSatFix.COVARIANCE_TYPE_UNKNOWN}, "not known"),
        ({"header.frame_id": "antenna"}, "frame_id must be"),
    ],
)
def test_fixes_that_cannot_be_used(change, words) -> None:
    message = NavSatFix(status=NavSatStatus(status=NavSatStatus.STATUS_FIX))
    message.header.frame_id = "base_link"
    message.position_covariance = np.eye(3).ravel()
    message.position_covariance_type = NavSatFix.COVARIANCE_TYPE_KNOWN
    for name, value in change.items():
        target, _, last = name.rpartition(".")
        setattr(getattr(message, target) if target else message, last, value)
    with pytest.raises(BadMessageError, match=words):
        read_position(message)
        read_covariance(message)


def pose(north_deg: float) -> tuple[PoseWithCovarianceStamped, LocalFrame]:
    frame = LocalFrame(np.radians(-38.0), np.radians(144.5), 100.0)
    message = PoseWithCovarianceStamped()
    place = np.radians(-38.0 + north_deg), np.radians(144.5), 100.0
    fill_pose(message, 10**9, frame, place, np.array([[400.0, 60.0], [60.0, 100.0]]))
    return message, frame


def test_a_pose_at_the_origin_is_east_north_up() -> None:
    message, _ = pose(0.0)
    point = message.pose.pose.position
    assert (point.x, point.y, point.z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    covariance = np.reshape(message.pose.covariance, (6, 6))
    np.testing.assert_allclose(covariance[:2, :2], [[100.0, 60.0], [60.0, 400.0]], atol=1e-6)
    assert covariance[2, 2] == pytest.approx(HEIGHT_VARIANCE)
    assert message.header.stamp.sec == 1


def test_far_away_the_plane_of_the_fix_is_tilted() -> None:
    message, frame = pose(2.7)  # 300 km
    point = message.pose.pose.position
    ecef = frame.axes.T @ [point.x, point.y, point.z] + frame.origin
    np.testing.assert_allclose(
        ecef, geodetic_to_ecef(np.radians(-35.3), np.radians(144.5), 100.0), atol=1e-6
    )
    covariance = np.reshape(message.pose.covariance, (6, 6))
    np.testing.assert_allclose(
        np.linalg.eigvalsh(covariance[:3, :3])[2], HEIGHT_VARIANCE, rtol=1e-6
    )
    # the variance of the height hardly spills into the plane
    assert covariance[1, 1] == pytest.approx(400.0, rel=0.07)
