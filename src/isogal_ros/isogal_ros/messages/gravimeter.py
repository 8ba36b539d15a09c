"""Messages of a gravimeter: AccelWithCovarianceStamped, z up, on a level platform."""

from typing import Any

import numpy as np

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.adapter import Framed, Place
from isogal_ros.messages.checks import BadMessageError, require_frame, require_reading
from isogal_ros.messages.position import NOT_MEASURED
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.topics import Topic

PLATFORM = "gravimeter_link"
"""Frame of the level platform, z up."""

LARGEST_GRAVITY, LARGEST_DISTURBANCE = 20.0, 1.0
"""m/s²; beyond, the unit is another."""
SMALLEST_GRAVITY = 5.0
"""m/s²; below, the instrument gives nothing, or its axis points down."""


def gravity(scenario: Scenario) -> "GravimeterAdapter":
    """Return the adapter of the field gravity."""
    return GravimeterAdapter(topics.GRAVITY)


def disturbance(scenario: Scenario) -> "GravimeterAdapter":
    """Return the adapter of the field disturbance."""
    return GravimeterAdapter(topics.DISTURBANCE)


class GravimeterAdapter(Framed):
    """Felt gravity, and gravity or its disturbance, m/s²: the same type of message."""

    raw, frames = topics.FELT, (PLATFORM, PLATFORM)

    def __init__(self, reduced: Topic) -> None:
        self.reduced = reduced

    def fill_raw(self, message: Any, ns: int, value: float, variance: float) -> None:
        """Write a value and its variance; the horizontal components are not measured."""
        set_stamp(message.header.stamp, ns)
        message.accel.accel.linear.z = float(value)
        covariance = np.diag([NOT_MEASURED] * 6)
        covariance[2, 2] = variance
        message.accel.covariance = covariance.ravel()

    def read_raw(self, message: Any) -> tuple[float, float | None]:
        """Return a value and its variance."""
        return self._read(message, SMALLEST_GRAVITY, LARGEST_GRAVITY)

    def fill_reduced(
        self, message: Any, ns: int, value: float, variance: float, place: Place
    ) -> None:
        """Write a value and its variance."""
        self.fill_raw(message, ns, value, variance)

    def read_reduced(self, message: Any) -> tuple[float, float]:
        """Return a value and its variance."""
        if self.reduced is topics.GRAVITY:
            return self._read(message, SMALLEST_GRAVITY, LARGEST_GRAVITY)
        return self._read(message, -LARGEST_DISTURBANCE, LARGEST_DISTURBANCE)

    def _read(self, message: Any, smallest: float, largest: float) -> tuple[float, float]:
        require_frame(message, PLATFORM)
        value, variance = message.accel.accel.linear.z, float(message.accel.covariance[14])
        require_reading(value, variance)
        if not smallest <= value <= largest:
            raise BadMessageError(f"{value:.3g} is not the Earth's; the unit is m/s², z is up")
        return value, variance
