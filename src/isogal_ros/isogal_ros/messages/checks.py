"""What readers of messages check alike; a message that fails raises `BadMessageError`."""

import math

import numpy as np
from geometry_msgs.msg import Quaternion

from isogal.arrays import Array
from isogal_ros.messages.stamps import SECOND, to_seconds
from isogal_ros.topics import Message

ABSENT = -1.0
"""Variance of what a sensor does not measure, as sensor_msgs has it."""
LARGEST = 1e30
"""Of a number in a covariance, in its unit: of a larger one products overflow."""


FAR_BACK = 10 * SECOND
"""ns by which a stamp is older than one late message has a reason to be."""


class BadMessageError(Exception):
    """A message that cannot be used; the text says why."""


def require_later(ns: int, last: int) -> None:
    """Raise BadMessageError unless a stamp (ns) is later than the last one."""
    if ns <= last:
        anew = "; where time begins anew, call ~/reset" if last - ns > FAR_BACK else ""
        raise BadMessageError(
            f"stamp {to_seconds(ns):.3f} s is not later than {to_seconds(last):.3f} s{anew}"
        )


def require_frame(message: Message | str, frame: str, parameter: str = "") -> None:
    """Raise BadMessageError, which names the parameter that sets the frame if there is one, unless
    a message (or its frame) is in the frame; an empty frame takes any."""
    own = message if isinstance(message, str) else message.header.frame_id
    if frame and own != frame:
        key = f" (parameter {parameter})" if parameter else " (parameter drivers)"
        raise BadMessageError(f"frame_id must be '{frame}', is '{own}'{key}")


def require_covariance(covariance: Array) -> None:
    """Raise BadMessageError unless a covariance (N, N) is finite, can be computed with, and has
    variances >= 0."""
    numbers = np.ravel(covariance).tolist()  # of so few Python's functions are quicker
    if not all(map(math.isfinite, numbers)):
        raise BadMessageError("covariance is not finite")
    if max(map(abs, numbers), default=0.0) > LARGEST:
        raise BadMessageError(f"covariance has numbers above {LARGEST:g}")
    if min(covariance.diagonal().tolist(), default=0.0) < 0.0:
        raise BadMessageError("negative variance")


def unit_quaternion(orientation: Quaternion) -> Array:
    """Return an orientation as (4,) w, x, y, z; raises BadMessageError where it is no unit
    quaternion."""
    turn = np.array([orientation.w, orientation.x, orientation.y, orientation.z])
    require_unit(turn, "orientation")
    return turn


def require_unit(quaternion: Array, what: str) -> None:
    """Raise BadMessageError unless a quaternion (4,) is of length 1."""
    if not abs(math.hypot(*quaternion.tolist()) - 1.0) <= 5e-4:  # as NaN is not
        raise BadMessageError(f"{what} is not a unit quaternion")


def require_reading(value: float, variance: float) -> None:
    """Raise BadMessageError unless a reading and its variance are finite, and the variance >=
    0."""
    if not (math.isfinite(value) and math.isfinite(variance)):
        raise BadMessageError("reading is not finite")
    if variance < 0.0:
        raise BadMessageError("negative variance")
