"""Messages of a gravimeter: AccelWithCovarianceStamped, z up, on a level platform."""

from functools import partial

from geometry_msgs.msg import AccelWithCovarianceStamped

from isogal.scenario import Assumed
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, Place, Reading
from isogal_ros.messages.checks import BadMessageError, require_frame, require_reading
from isogal_ros.messages.frames import framed
from isogal_ros.messages.position import NOT_MEASURED
from isogal_ros.topics import Topic

PLATFORM = "gravimeter_link"
"""Frame of the level platform, z up."""

LARGEST_GRAVITY, LARGEST_DISTURBANCE = 20.0, 1.0
"""m/s²; beyond, the unit is another."""
SMALLEST_GRAVITY = 5.0
"""m/s²; below, the instrument gives nothing, or its axis points down."""
_AXES, _UP = 6, 14
"""Rows of a message's covariance; where in a message's covariance the variance along z is."""


def gravity(assumed: Assumed) -> Adapter:
    """Return the adapter of the field gravity."""
    return accelerations(topics.GRAVITY, SMALLEST_GRAVITY, LARGEST_GRAVITY)


def disturbance(assumed: Assumed) -> Adapter:
    """Return the adapter of the field disturbance."""
    return accelerations(topics.DISTURBANCE)


def accelerations(
    reduced: Topic, smallest: float = -LARGEST_DISTURBANCE, largest: float = LARGEST_DISTURBANCE
) -> Adapter:
    """Return an adapter of gravity as the instrument feels it, and of a reduction of it between
    limits, m/s²: the same type of message."""
    return Adapter(
        topics.GRAVIMETRY,
        partial(_write, topics.GRAVIMETRY),
        lambda message: _read(message, SMALLEST_GRAVITY, LARGEST_GRAVITY),
        reduced,
        partial(_write, reduced),
        lambda message: _read(message, smallest, largest),
    )


def _write(
    topic: Topic, ns: int, value: Reading, variance: Reading, place: Place
) -> AccelWithCovarianceStamped:
    """Return a message; the horizontal components are not measured."""
    message = framed(topic, PLATFORM, ns)
    message.accel.accel.linear.z = float(value)
    message.accel.covariance[:: _AXES + 1] = NOT_MEASURED
    message.accel.covariance[_UP] = variance
    return message


def _read(
    message: AccelWithCovarianceStamped, smallest: float, largest: float
) -> tuple[float, float]:
    """Return a value and its variance."""
    require_frame(message, PLATFORM)
    value, variance = message.accel.accel.linear.z, float(message.accel.covariance[_UP])
    require_reading(value, variance)
    if not smallest <= value <= largest:
        raise BadMessageError(
            f"{value:.6g} is not between {smallest:g} and {largest:g}: z is up, the unit is m/s²"
            " unless the parameter drivers names another"
        )
    return value, variance
