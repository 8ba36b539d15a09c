"""Navigation states as Odometry messages of the frame ``map`` and the child ``base_link``."""

import math
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import E2, A
from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import from_matrix, matrix
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_frame
from isogal_ros.messages.frames import BASE, FRD_FLU, MAP, NED_ENU
from isogal_ros.messages.stamps import set_stamp

FASTEST = 1e6
"""m/s: nothing that this navigates moves faster."""
_NO_COVARIANCE = np.zeros((0, 0))


def fill_odom(
    message: Any,
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
    pose, twist = np.empty((6, 6)), np.zeros((6, 6))
    values = _odometry(state, covariance, frame.axes, frame.origin, pose, twist).tolist()
    point, orientation = message.pose.pose.position, message.pose.pose.orientation
    point.x, point.y, point.z = values[:3]
    orientation.w, orientation.x, orientation.y, orientation.z = values[3:7]
    linear, angular = message.twist.twist.linear, message.twist.twist.angular
    linear.x, linear.y, linear.z = values[7:]
    angular.x, angular.y, angular.z = (angular_rate * FRD_FLU).tolist()
    if covariance.shape[0]:
        message.pose.covariance, message.twist.covariance = pose.ravel(), twist.ravel()


def read_velocity(
    message: Any, frame: LocalFrame, latitude: float, longitude: float
) -> tuple[Array, Array, Array]:
    """Return (velocity (3,), its covariance (3, 3), attitude (3, 3) FRD to NED) of an Odometry,
    NED at a point (rad).

    Raises
    ------
    BadMessageError
        The message is of other frames or not finite, its orientation is not a unit quaternion, or
        a variance is negative.
    """
    require_frame(message, MAP)
    if message.child_frame_id != BASE:
        raise BadMessageError(f"child_frame_id must be '{BASE}', is '{message.child_frame_id}'")
    q, linear = message.pose.pose.orientation, message.twist.twist.linear
    values = np.array([q.w, q.x, q.y, q.z, linear.x, linear.y, linear.z])
    covariance = np.asarray(message.twist.covariance).reshape(6, 6)[:3, :3]
    if not np.isfinite(values).all():
        raise BadMessageError("orientation or velocity is not finite")
    if np.abs(values[4:]).max() > FASTEST:
        raise BadMessageError(f"velocity above {FASTEST:g} m/s")
    if abs(values[:4] @ values[:4] - 1.0) > 1e-3:
        raise BadMessageError("orientation is not a unit quaternion")
    require_covariance(covariance)
    to_ned = (frame.rotation_from(latitude, longitude) @ NED_ENU).T @ matrix(values[:4])
    return to_ned @ values[4:], to_ned @ covariance @ to_ned.T, to_ned * FRD_FLU


@kernel
def _odometry(state, covariance, axes, origin, pose, twist):  # type: ignore[no-untyped-def]
    """Return position (3) and orientation quaternion (4; w first) in the frame ``map``, and
    velocity (3) FLU, as one array of 10. Compiled, as the graph needs it twice at every step.

    Parameters
    ----------
    state : (10,) array
        Latitude rad, longitude rad, height m, velocity NED m/s, quaternion FRD to NED.
    covariance : (9+, 9+) array
        Position, velocity, attitude errors, NED; (0, 0) = none.
    axes, origin : (3, 3), (3,) arrays
        Of the frame: rotation from ECEF to its axes, ECEF of its origin.
    pose, twist : (6, 6) arrays
        Written where there is a covariance.
    """
    lat, lon, height = state[0], state[1], state[2]
    sl, cl, so, co = math.sin(lat), math.cos(lat), math.sin(lon), math.cos(lon)
    n = A / math.sqrt(1.0 - E2 * sl * sl)
    ecef = np.array(
        [(n + height) * cl * co, (n + height) * cl * so, (n * (1.0 - E2) + height) * sl]
    )
    # columns: north, east, down in ECEF
    ned = np.array([[-sl * co, -so, -cl * co], [-sl * so, co, -cl * so], [cl, 0.0, -sl]])
    to_map = np.empty((3, 3))
    _multiply(axes, ned, to_map)
    w, x, y, z = state[6], state[7], state[8], state[9]
    # FLU to NED: the library's rotation with its second and third column turned round
    body = np.array(
        [
            [1 - 2 * (y * y + z * z), -2 * (x * y - w * z), -2 * (x * z + w * y)],
            [2 * (x * y + w * z), -(1 - 2 * (x * x + z * z)), -2 * (y * z - w * x)],
            [2 * (x * z - w * y), -2 * (y * z + w * x), -(1 - 2 * (x * x + y * y))],
        ]
    )
    result, attitude, to_body = np.zeros(10), np.empty((3, 3)), np.empty((3, 3))
    _multiply(to_map, body, attitude)
    quaternion = from_matrix(attitude)
    for i in range(4):
        result[3 + i] = quaternion[i]
    for i in range(3):
        for j in range(3):
            result[i] += axes[i, j] * (ecef[j] - origin[j])
            result[7 + i] += body[j, i] * state[3 + j]
            to_body[i, j] = body[j, i]
    if covariance.shape[0] > 0:
        _turn(to_map, covariance, (0, 0), pose, (0, 0))
        _turn(to_map, covariance, (0, 6), pose, (0, 3))
        _turn(to_map, covariance, (6, 6), pose, (3, 3))
        for i in range(3):
            for j in range(3):
                pose[3 + i, j] = pose[j, 3 + i]
        _turn(to_body, covariance, (3, 3), twist, (0, 0))
    return result


# Loops, not slices and `@`, which take numba three times as long to compile.
@kernel
def _multiply(a, b, out):  # type: ignore[no-untyped-def]
    """Write the product of two matrices (3, 3)."""
    for i in range(3):
        for j in range(3):
            out[i, j] = a[i, 0] * b[0, j] + a[i, 1] * b[1, j] + a[i, 2] * b[2, j]


@kernel
def _turn(axes, covariance, block, out, place):  # type: ignore[no-untyped-def]
    """Write a (3, 3) block of a covariance in other axes, A C A'."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for a in range(3):
                for b in range(3):
                    total += axes[i, a] * covariance[block[0] + a, block[1] + b] * axes[j, b]
            out[place[0] + i, place[1] + j] = total
