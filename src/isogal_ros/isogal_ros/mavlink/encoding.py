"""Odometry as messages of MAVLink (https://mavlink.io/en/messages/common.html): fields and units
as documented there."""

import math
from typing import Any

import numpy as np
from nav_msgs.msg import Odometry

from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import matrix, to_angles
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    unit_quaternion,
)
from isogal_ros.messages.frames import FRD_FLU, MAP, NED_ENU
from isogal_ros.messages.odometry import motion_of, read_velocity
from isogal_ros.messages.position import read_pose
from isogal_ros.messages.stamps import to_ns

GPS_INPUT, VISION = "GPS_INPUT", "VISION_POSITION_ESTIMATE"
SENSOR = "GLOBAL_POSITION_SENSOR"
SENT = (GPS_INPUT, VISION, SENSOR)
_SOURCES = {"terrain": "TERRAIN", "ground": "TERRAIN", "magnetic": "MAGNETIC"}
"""Of GLOBAL_POSITION_SRC, by field; what is sent of the others is an estimate."""
FIX_3D = 3
"""GPS_FIX_TYPE_3D_FIX."""
IGNORED = 1 | 2 | 4 | 16 | 128
"""Of GPS_INPUT_IGNORE_FLAGS: altitude (ours is above the ellipsoid, not the sea, and no
measurement), HDOP, VDOP, vertical velocity, vertical accuracy."""
_UPPER = np.triu_indices(6)


def require_usable(odometry: Odometry) -> None:
    """Raise BadMessageError unless an Odometry has a pose that an autopilot may have: of the frame
    ``map``, finite, with a covariance."""
    require_frame(odometry, MAP)
    place = odometry.pose.pose.position
    if not np.isfinite([place.x, place.y, place.z]).all():
        raise BadMessageError("position is not finite")
    unit_quaternion(odometry.pose.pose.orientation)
    require_covariance(np.reshape(odometry.pose.covariance, (6, 6)))


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
    (latitude, longitude, height), covariance, to_ned = read_pose(odometry, frame)
    of_position = to_ned @ covariance[:3, :3] @ to_ned.T
    velocity, of_velocity, _ = read_velocity(motion_of(odometry), frame, latitude, longitude)
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


def global_position_sensor(dialect: Any, odometry: Odometry, frame: LocalFrame, field: str) -> Any:
    """Return GLOBAL_POSITION_SENSOR of an Odometry in the frame ``map``, to all systems, with the
    1-sigma along the worst horizontal direction and that of the height.

    Parameters
    ----------
    dialect : module
        Of pymavlink.
    field : str
        That is matched, which says the source.
    """
    (latitude, longitude, height), of_pose, to_ned = read_pose(odometry, frame)
    covariance = to_ned @ of_pose[:3, :3] @ to_ned.T
    source = getattr(dialect, f"GLOBAL_POSITION_SRC_{_SOURCES.get(field, 'ESTIMATOR')}")
    return dialect.MAVLink_global_position_sensor_message(
        0,  # target_system
        0,  # target_component
        0,  # id
        to_ns(odometry.header.stamp) // 1000,
        0,  # processing_time: the stamp is that of the state
        source,
        0,  # flags
        round(1e7 * math.degrees(latitude)),
        round(1e7 * math.degrees(longitude)),
        height,
        math.nan,  # above the sea
        _worst(covariance[:2, :2]),
        math.sqrt(max(0.0, covariance[2, 2])),
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
