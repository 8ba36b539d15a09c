"""Navigation states as Odometry messages of the frame ``map`` and the child ``base_link``."""

import math
from typing import NamedTuple

import numpy as np
from nav_msgs.msg import Odometry

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import E2, A
from isogal.earth.frames import LocalFrame
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import from_matrix, matrix, rotate
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    require_unit,
)
from isogal_ros.messages.frames import BASE, FRD_FLU, MAP, NED_ENU, framed
from isogal_ros.messages.prepared import Prepared, Reader, write
from isogal_ros.topics import Topic

FASTEST = 1e6
"""m/s: nothing that this navigates moves faster."""
_NO_COVARIANCE = np.zeros((0, 0))
_NUMBERS, _POSE, _TWIST = 85, 7, 49
"""Of a message; where the covariance of the pose begins among them, and that of the twist."""
POSE = slice(0, 7)
"""Position (x, y, z) and orientation (x, y, z, w) among the numbers of a message."""


def empty_odometry(topic: Topic) -> Prepared:
    """Return a message of a topic."""
    message = framed(topic, MAP)
    message.child_frame_id = BASE
    return Prepared(message)


def fill_odom(
    message: Odometry | Prepared,
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
        Position, velocity, attitude errors, NED; (0, 0) = zeros are written. The twist's
        covariance is that of the NED velocity turned into body axes, so that turning it back with
        the message's orientation gives it unchanged.
    """
    numbers = np.zeros(_NUMBERS)
    _write_state(numbers, frame.axes, frame.origin, state, angular_rate, covariance)
    write(message, ns, numbers)


def fill_state(
    message: Prepared, ns: int, frame: LocalFrame, state: FilterState, angular_rate: Array
) -> None:
    """Write a state of the filter into an Odometry message.

    Parameters
    ----------
    frame : LocalFrame
        The frame ``map``.
    state : FilterState
    angular_rate : (3,) array
        Of the gyroscopes, FRD, rad/s.
    """
    nav, turn_rate = np.concatenate(state.estimate), state.turn_rate(angular_rate)
    fill_odom(message, ns, frame, nav, turn_rate, state.covariance)


@kernel
def _turn(
    numbers: Array, first: int, rotation: Array, covariance: Array, row: int, column: int
) -> None:
    """Write the block (3, 3) that begins at a row and a column of a covariance, turned, into one
    of (6, 6)."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                for m in range(3):
                    of_error = covariance[row + k, column + m]
                    total += rotation[i, k] * of_error * rotation[j, m]
            numbers[first + 6 * i + j] = total


@kernel
def _write_state(
    numbers: Array,
    axes: Array,
    origin: Array,
    state: Array,
    angular_rate: Array,
    covariance: Array,
) -> None:
    """Write an Odometry's numbers (85,) of a state in a frame (its axes (3, 3) in ECEF, and its
    origin (3,) there, m)."""
    sl, cl = math.sin(state[0]), math.cos(state[0])
    so, co = math.sin(state[1]), math.cos(state[1])
    n = A / math.sqrt(1.0 - E2 * (sl * sl))
    p = (n + state[2]) * cl
    x, y = p * co - origin[0], p * so - origin[1]
    z = (n * (1.0 - E2) + state[2]) * sl - origin[2]
    w, qx, qy, qz = state[6], state[7], state[8], state[9]
    to_map, to_body, turned = np.empty((3, 3)), np.empty((3, 3)), np.zeros((3, 3))
    for i in range(3):
        a, b, c = axes[i, 0], axes[i, 1], axes[i, 2]
        numbers[i] = a * x + b * y + c * z
        outward = a * co + b * so
        to_map[i, 0] = c * cl - outward * sl
        to_map[i, 1] = b * co - a * so
        to_map[i, 2] = -c * sl - outward * cl
        sign = 1.0 if i == 0 else -1.0  # forward, left, up
        axis = rotate(w, qx, qy, qz, sign * (i == 0), sign * (i == 1), sign * (i == 2))
        to_body[i, 0], to_body[i, 1], to_body[i, 2] = axis
        numbers[_TWIST - 6 + i] = axis[0] * state[3] + axis[1] * state[4] + axis[2] * state[5]
        numbers[_TWIST - 3 + i] = sign * angular_rate[i]
    for i in range(3):
        for j in range(3):
            for k in range(3):
                turned[i, j] += to_map[i, k] * to_body[j, k]
    attitude = from_matrix(turned)
    for i in range(4):
        numbers[3 + i] = attitude[(i + 1) % 4]
    if covariance.shape[0] > 0:
        _turn(numbers, _TWIST, to_body, covariance, 3, 3)
        for i in range(2):
            for j in range(2):
                _turn(numbers, _POSE + 18 * i + 3 * j, to_map, covariance, 6 * i, 6 * j)


class Received(NamedTuple):
    """What an Odometry says of the child in the frame; nothing of it has been looked at."""

    ns: int
    """Stamp."""
    frame: str
    child: str
    place: Array
    """(3,) m."""
    orientation: Array
    """(4,) w, x, y, z."""
    of_pose: Array
    """(6, 6) covariance of the pose."""
    velocity: Array
    """(3,) in the child, m/s; so is its covariance (3, 3)."""
    turn_rate: Array
    """(3,) in the child, rad/s."""
    of_velocity: Array


def read_odometry(data: bytes) -> Received:
    """Return what a serialised Odometry says, of which rclpy takes ten times as long to make the
    objects; raises BadMessageError where it is cut off."""
    content = Reader(data)
    names = content.stamp(), content.text(), content.text()
    numbers = np.array(content.take(f"{_NUMBERS}d"))
    pose, velocity, turn_rate, twist = np.split(numbers[_POSE:], (36, 39, 42))
    of_pose, of_velocity = pose.reshape(6, 6), twist.reshape(6, 6)[:3, :3]
    turn = numbers[[6, 3, 4, 5]]
    return Received(*names, numbers[:3], turn, of_pose, velocity, turn_rate, of_velocity)


def read_velocity(
    motion: Received, frame: LocalFrame, latitude: float, longitude: float
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
    require_frame(motion.frame, MAP)
    if motion.child != BASE:
        raise BadMessageError(f"child_frame_id must be '{BASE}', is '{motion.child}'")
    require_unit(motion.orientation, "orientation")
    velocity, covariance = motion.velocity, motion.of_velocity
    if not np.isfinite(velocity).all() or np.abs(velocity).max() > FASTEST:
        raise BadMessageError(f"velocity is not finite, or above {FASTEST:g} m/s")
    require_covariance(covariance)
    to_ned = (frame.rotation_from(latitude, longitude) @ NED_ENU).T @ matrix(motion.orientation)
    return to_ned @ velocity, to_ned @ covariance @ to_ned.T, to_ned * FRD_FLU
