"""Aids that say where the vehicle is, or where its bow points, as messages with an orientation:
PoseWithCovarianceStamped of the frame ``map``, and Imu."""

import math

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, Quaternion
from sensor_msgs.msg import Imu

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import matrix
from isogal.scenario import HeadingAid
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    unit_quaternion,
)
from isogal_ros.messages.frames import MAP, NED_ENU
from isogal_ros.messages.position import read_point
from isogal_ros.messages.stamps import set_stamp

_YAW = 8
"""Place of the yaw's variance in the covariance of an orientation."""
_STEEPEST = 0.1
"""Horizontal part of the bow below which it has no heading."""


def read_pose_position(
    message: PoseWithCovarianceStamped, frame: LocalFrame
) -> tuple[Array, Array | None]:
    """Return latitude, longitude (rad), height (m) as (3,), and their covariance (3, 3) NED, m²,
    None where it is not known (zeros), of a pose, whose orientation is not used.

    Parameters
    ----------
    frame : LocalFrame
        The frame ``map``.

    Raises
    ------
    BadMessageError
        Of another frame, not finite, too far away, or of a covariance that is none.
    """
    require_frame(message, MAP)
    covariance = np.asarray(message.pose.covariance).reshape(6, 6)[:3, :3]
    require_covariance(covariance)
    place = read_point(message.pose.pose.position, frame)
    to_ned = (frame.rotation_from(place[0], place[1]) @ NED_ENU).T
    return place, to_ned @ covariance @ to_ned.T if covariance.any() else None


def fill_heading(message: Imu, ns: int, heading: float, aid: HeadingAid) -> None:
    """Write a heading (rad) into an Imu message that has an orientation only: level, east-north-up
    to forward-left-up; the aid's variance, mounting not included."""
    set_stamp(message.header.stamp, ns)
    half = 0.5 * (0.5 * math.pi - heading)
    message.orientation = Quaternion(w=math.cos(half), z=math.sin(half))
    variance = aid.number("sigma") ** 2 + aid.number("correlated_sigma") ** 2
    message.orientation_covariance[_YAW] = variance
    message.angular_velocity_covariance[0] = message.linear_acceleration_covariance[0] = -1.0


def read_heading(message: Imu) -> tuple[float, float | None]:
    """Return the heading (rad from north, east positive) and its variance (rad², None = unknown)
    of an orientation, of which all else is not used. The frame may have any name.

    Raises
    ------
    BadMessageError
        It is marked as without orientation, no unit quaternion, of a negative variance, or the bow
        points up or down.
    """
    variance = float(message.orientation_covariance[_YAW])
    if message.orientation_covariance[0] == -1.0:
        raise BadMessageError("marked as without orientation (covariance -1)")
    turn = unit_quaternion(message.orientation)
    if not (math.isfinite(variance) and variance >= 0.0):
        raise BadMessageError("variance of the yaw is negative or not finite")
    east, north = matrix(turn)[:2, 0].tolist()
    if math.hypot(east, north) < _STEEPEST:
        raise BadMessageError("the bow points up or down: no heading")
    return math.atan2(east, north), variance or None
