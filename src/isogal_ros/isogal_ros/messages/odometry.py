"""Navigation states as Odometry messages of the frame ``map`` and the child ``base_link``."""

import numpy as np
from nav_msgs.msg import Odometry

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import from_matrix, matrix
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    unit_quaternion,
)
from isogal_ros.messages.frames import BASE, FRD_FLU, MAP, NED_ENU
from isogal_ros.messages.stamps import set_stamp

FASTEST = 1e6
"""m/s: nothing that this navigates moves faster."""
_NO_COVARIANCE = np.zeros((0, 0))
_POSE = np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])
"""Position and attitude among the errors of a navigation state."""


def fill_odom(
    message: Odometry,
    ns: int,
    frame: LocalFrame,
    state: Array,
    angular_rate: Array,
    covariance: Array = _NO_COVARIANCE,
) -> None:
    """Write a navigation state into an Odometry message.

    Parameters
    ----------
    frame : LocalFrame
        The frame ``map``.
    state : (10,) array
        Latitude rad, longitude rad, height m; velocity NED, m/s; quaternion FRD to NED.
    angular_rate : (3,) array
        FRD, rad/s, relative to the Earth.
    covariance : (9+, 9+) array
        Position, velocity, attitude errors, NED; (0, 0) = the message's stays as it is. The
        twist's covariance is that of the NED velocity turned into body axes, so that turning it
        back with the message's orientation gives it unchanged.
    """
    set_stamp(message.header.stamp, ns)
    latitude, longitude, height = state[:3].tolist()
    to_map = frame.rotation_from(latitude, longitude) @ NED_ENU
    body = matrix(state[6:]) * FRD_FLU
    point, orientation = message.pose.pose.position, message.pose.pose.orientation
    point.x, point.y, point.z = frame.from_geodetic(latitude, longitude, height).tolist()
    q = from_matrix(to_map @ body).tolist()
    orientation.w, orientation.x, orientation.y, orientation.z = q
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    linear.x, linear.y, linear.z = (state[3:6] @ body).tolist()
    angular.x, angular.y, angular.z = (angular_rate * FRD_FLU).tolist()
    if covariance.shape[0]:
        axes, twist = np.zeros((6, 6)), np.zeros((6, 6))
        axes[:3, :3] = axes[3:, 3:] = to_map
        twist[:3, :3] = body.T @ covariance[3:6, 3:6] @ body
        pose = axes @ covariance[_POSE] @ axes.T
        message.pose.covariance, message.twist.covariance = pose.ravel(), twist.ravel()


def read_velocity(
    message: Odometry, frame: LocalFrame, latitude: float, longitude: float
) -> tuple[Array, Array, Array]:
    """Return (velocity (3,), its covariance (3, 3), attitude (3, 3) FRD to NED) of an Odometry,
    NED at a point.

    Parameters
    ----------
    frame : LocalFrame
        The frame ``map``.
    latitude, longitude : float
        Of the point, rad.

    Raises
    ------
    BadMessageError
        The message is of other frames or not finite, its orientation is not a unit quaternion, or
        a variance is negative.
    """
    require_frame(message, MAP)
    if message.child_frame_id != BASE:
        raise BadMessageError(f"child_frame_id must be '{BASE}', is '{message.child_frame_id}'")
    turn, linear = unit_quaternion(message.pose.pose.orientation), message.twist.twist.linear
    velocity = np.array([linear.x, linear.y, linear.z])
    covariance = np.asarray(message.twist.covariance).reshape(6, 6)[:3, :3]
    if not np.isfinite(velocity).all() or np.abs(velocity).max() > FASTEST:
        raise BadMessageError(f"velocity is not finite, or above {FASTEST:g} m/s")
    require_covariance(covariance)
    to_ned = (frame.rotation_from(latitude, longitude) @ NED_ENU).T @ matrix(turn)
    return to_ned @ velocity, to_ned @ covariance @ to_ned.T, to_ned * FRD_FLU
