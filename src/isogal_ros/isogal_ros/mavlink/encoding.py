"""Odometry as messages of MAVLink (https://mavlink.io/en/messages/common.html): fields and units
as documented there."""

import math
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import matrix, to_angles
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    require_unit,
)
from isogal_ros.messages.frames import FRD_FLU, MAP, NED_ENU
from isogal_ros.messages.odometry import Received, read_velocity
from isogal_ros.messages.position import read_point, to_ned

GPS_INPUT, VISION = "GPS_INPUT", "VISION_POSITION_ESTIMATE"
SENSOR = "GLOBAL_POSITION_SENSOR"
_SOURCES = {"terrain": "TERRAIN", "ground": "TERRAIN", "magnetic": "MAGNETIC"}
"""Of GLOBAL_POSITION_SRC, by field; what is sent of the others is an estimate."""
FIX_3D = 3
"""GPS_FIX_TYPE_3D_FIX."""
IGNORED = 1 | 2 | 4 | 16 | 128
"""Of GPS_INPUT_IGNORE_FLAGS: altitude (ours is above the ellipsoid, not the sea, and no
measurement), HDOP, VDOP, vertical velocity, vertical accuracy."""
_UPPER = np.triu_indices(6)


def require_usable(odometry: Received) -> None:
    """Raise BadMessageError unless an Odometry has a pose that an autopilot may have: of the frame
    ``map``, finite, with a covariance."""
    require_frame(odometry.frame, MAP)
    if not np.isfinite(odometry.place).all():
        raise BadMessageError("position is not finite")
    require_unit(odometry.orientation, "orientation")
    require_covariance(odometry.of_pose)


def _position(odometry: Received, frame: LocalFrame) -> tuple[Array, Array]:
    """Return latitude, longitude (rad) and height (m) as (3,), and its covariance (3, 3) NED."""
    place = read_point(odometry.place, frame)
    turn = to_ned(place, frame)
    return place, turn @ odometry.of_pose[:3, :3] @ turn.T


def gps_input(dialect: Any, odometry: Received, frame: LocalFrame, satellites: int) -> Any:
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
    (latitude, longitude, height), of_position = _position(odometry, frame)
    velocity, of_velocity, _ = read_velocity(odometry, frame, latitude, longitude)
    return dialect.MAVLink_gps_input_message(
        odometry.ns // 1000,
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


def global_position_sensor(dialect: Any, odometry: Received, frame: LocalFrame, field: str) -> Any:
    """Return GLOBAL_POSITION_SENSOR of an Odometry in the frame ``map``, to all systems, with the
    1-sigma along the worst horizontal direction and that of the height.

    Parameters
    ----------
    dialect : module
        Of pymavlink.
    field : str
        That is matched, which says the source.
    """
    (latitude, longitude, height), covariance = _position(odometry, frame)
    source = getattr(dialect, f"GLOBAL_POSITION_SRC_{_SOURCES.get(field, 'ESTIMATOR')}")
    return dialect.MAVLink_global_position_sensor_message(
        0,  # target_system
        0,  # target_component
        0,  # id
        odometry.ns // 1000,
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


def vision_position_estimate(dialect: Any, odometry: Received, resets: int) -> Any:
    """Return VISION_POSITION_ESTIMATE of an Odometry in the frame ``map``: north, east, down from
    the first route point; the covariance of the attitude is about these axes.

    Parameters
    ----------
    dialect : module
        Of pymavlink.
    resets : int
        How often the position has jumped.
    """
    angles = to_angles(NED_ENU @ matrix(odometry.orientation) * FRD_FLU)
    axes = np.kron(np.eye(2), NED_ENU)
    covariance = axes @ odometry.of_pose @ axes.T
    return dialect.MAVLink_vision_position_estimate_message(
        odometry.ns // 1000,
        *(NED_ENU @ odometry.place).tolist(),
        *angles,
        covariance[_UPPER].tolist(),
        resets % 256,
    )


def _worst(covariance: Array) -> float:
    """Return the 1-sigma along the worst direction of a covariance (2, 2)."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
