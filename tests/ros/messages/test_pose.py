"""Fixes as poses in the frame map."""

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped

from isogal.earth.frames import LocalFrame, geodetic_to_ecef
from isogal_ros.messages.pose import HEIGHT_VARIANCE, fill_pose


def filled(north_deg: float) -> tuple[PoseWithCovarianceStamped, LocalFrame]:
    frame = LocalFrame(np.radians(-38.0), np.radians(144.5), 100.0)
    message = PoseWithCovarianceStamped()
    place = np.radians(-38.0 + north_deg), np.radians(144.5), 100.0
    fill_pose(message, 10**9, frame, place, np.array([[400.0, 60.0], [60.0, 100.0]]))
    return message, frame


def test_at_the_origin_it_is_east_north_up() -> None:
    message, _ = filled(0.0)
    point = message.pose.pose.position
    assert (point.x, point.y, point.z) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    covariance = np.reshape(message.pose.covariance, (6, 6))
    np.testing.assert_allclose(covariance[:2, :2], [[100.0, 60.0], [60.0, 400.0]], atol=1e-6)
    assert covariance[2, 2] == pytest.approx(HEIGHT_VARIANCE)
    assert message.header.stamp.sec == 1


def test_far_away_the_plane_of_the_fix_is_tilted() -> None:
    message, frame = filled(2.7)  # 300 km
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
