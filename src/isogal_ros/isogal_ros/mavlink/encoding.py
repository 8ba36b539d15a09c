"""Odometry as messages of MAVLink (https://mavlink.io/en/messages/common.html): fields and units
as documented there."""

import math
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry

from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import matrix, to_angles
from isogal_ros.messages.frames import FRD_FLU, NED_ENU
from isogal_ros.messages.odometry import read_velocity
from isogal_ros.messages.stamps import to_ns

GPS_INPUT, VISION = "GPS_INPUT", "VISION_POSITION_ESTIMATE"
FIX_3D = 3
"""GPS_FIX_TYPE_3D_FIX."""
IGNORED = 1 | 2 | 4 | 16 | 128
"""Of GPS_INPUT_IGNORE_FLAGS: altitude (ours is above the ellipsoid, not the sea, and no
measurement), HDOP, VDOP, vertical velocity, vertical accuracy."""
_UPPER = np.triu_indices(6)


def gps_input(dialect: Any, odometry: Odometry, frame: LocalFrame, satellites: int) -> Any:
    """Return GPS_INPUT of an Odometry in the frame ``map``.

    The horizontal accuracy is the 1-sigma along the worst direction, the accuracy of the speed
    likewise. Raises BadMessageError where the message cannot be used.

    Parameters
    ----------
    dialect : module
        Of pymavlink.
    satellites : int
        As many as the flight controller wants to see.
    """
    point = odometry.pose.pose.position
    latitude, longitude, height = (
        float(part) for part in frame.to_geodetic(np.array([point.x, point.y, point.z]))
    )
    velocity, of_velocity, _ = read_velocity(odometry, frame, latitude, longitude)
    axes = frame.rotation_from(latitude, longitude)
    of_position = axes.T @ np.reshape(odometry.pose.covariance, (6, 6))[:3, :3] @ axes
    return dialect.MAVLink_gps_input_message(
        to_ns(odometry.header.stamp) // 1000,
        0,  # gps_id
        IGNORED,
        0,  # time_week_ms
        0,  # time_week
        FIX_3D,
        round(1e7 * math.degrees(latitude)),
        round(1e7 * math.degrees(longitude)),
        height,
        0.0,  # hdop
        0.0,  # vdop
        *velocity.tolist(),
        _worst(of_velocity[:2, :2]),
        _worst(of_position[:2, :2]),
        0.0,  # vert_accuracy
        satellites,
    )


def vision_position_estimate(dialect: Any, odometry: Odometry, resets: int) -> Any:
    """Return VISION_POSITION_ESTIMATE of an Odometry in the frame ``map``: north, east, down from
    the first route point; the covariance of the attitude is about these axes.

    Parameters
    ----------
    dialect : module
        Of pymavlink.
    resets : int
        How often the position has jumped.
    """
    pose = odometry.pose.pose
    q = np.array([pose.orientation.w, pose.orientation.x, pose.orientation.y, pose.orientation.z])
    ned = NED_ENU @ np.array([pose.position.x, pose.position.y, pose.position.z])
    angles = to_angles(NED_ENU @ matrix(q) * FRD_FLU)
    axes = np.kron(np.eye(2), NED_ENU)
    covariance = axes @ np.reshape(odometry.pose.covariance, (6, 6)) @ axes.T
    return dialect.MAVLink_vision_position_estimate_message(
        to_ns(odometry.header.stamp) // 1000,
        *ned.tolist(),
        *angles,
        covariance[_UPPER].tolist(),
        resets % 256,
    )


def _worst(covariance: np.ndarray) -> float:
    """Return the 1-sigma along the worst direction of a covariance (2, 2)."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
