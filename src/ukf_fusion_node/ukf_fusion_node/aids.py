"""Readings of sensors beside the IMU: when they are due, and what the filter does with them."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from sensor_msgs.msg import FluidPressure, NavSatFix

from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import (
    HeightReading,
    Innovation,
    Measurement,
    VelocityReading,
    satellite_fix,
    satellite_velocity,
)
from isogal.scenario import Height
from isogal.sensors.barometer import height_of
from isogal_ros import topics
from isogal_ros.messages.aids import (
    aids_of,
    read_ground_velocity,
    read_pressure,
    read_satellite_fix,
    read_velocity,
)
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Topic
from ukf_fusion_node.aid_report import AidReport
from ukf_fusion_node.measuring import Measuring

_KNOTS = 1.94384
_PRESSURE_UNITS = {"hPa": 1e2, "kPa": 1e3, "dbar": 1e4, "bar": 1e5}
Message: TypeAlias = FluidPressure | NavSatFix | TwistWithCovarianceStamped
_Reading = Callable[[InertialNavigator, float], Measurement | None]
"""Returns the measurement of a navigator at its time (s); None = there is no number."""
_Read = tuple[_Reading, Callable[[Innovation], str]]
"""A reading, and what to say of one that cannot be right."""
NO_FIX = "the receiver has no fix"


@dataclass
class _Source:
    """Readings of one topic that wait for the navigator to reach their stamps."""

    topic: Topic
    interval: int
    """ns between readings."""
    delay: int
    """ns by which they come later than their stamps."""
    publishers: Callable[[], int]
    newest: int = -1
    """Stamp of the newest reading; -1 = none yet."""
    waiting: dict[int, _Read] = field(default_factory=dict)

    def is_due(self, ns: int, begin: int) -> bool:
        """Whether a reading of a stamp up to `ns` is still to come; it is waited for as long as
        another one would take."""
        due = (begin if self.newest < 0 else self.newest) + self.interval + self.delay
        return due <= ns < due + self.interval and self.publishers() > 0


class Aids:
    """Subscribes to the sensors that the scenario has.

    A sample of the IMU waits for the readings that are due at its stamp, so that what the filter
    publishes does not depend on which message arrives first.

    Parameters
    ----------
    node : GraphNode
        Its scenario says which sensors there are; its health is told.
    advance : callable
        Called when a reading has come.
    """

    def __init__(self, node: GraphNode, advance: Callable[[], None]) -> None:
        self._scenario, self._advance = node.scenario, advance
        self._frame = node.settings.velocity_frame
        self._measuring, self._report = Measuring(node.health), AidReport(node)
        self._sources: list[_Source] = []
        self._first = sys.maxsize
        """Stamp of the first IMU sample."""
        height, velocity, gnss = (
            node.scenario.height, node.scenario.velocity, node.scenario.gnss,
        )  # fmt: skip
        every: dict[Topic, tuple[float, float, Callable[[Message], _Read]]] = {
            topics.BAROMETER: (height.interval, 0.0, self._pressure),
            topics.VELOCITY: (velocity.interval, 0.0, self._velocity),
            topics.GNSS_FIX: (gnss.interval, gnss.delay, self._satellite_fix),
            topics.GNSS_VELOCITY: (gnss.interval, gnss.delay, self._satellite_velocity),
        }
        for topic in aids_of(node.scenario):
            self._add(node, topic, *every[topic])

    def _add(
        self,
        node: GraphNode,
        topic: Topic,
        interval: float,
        delay: float,
        read: Callable[[Message], _Read],
    ) -> None:
        def take(message: Message) -> None:
            reading = read(message)
            ns = to_ns(message.header.stamp)
            source.newest = max(source.newest, ns)
            source.waiting[ns] = reading
            self._advance()

        subscription = node.listen(topic, take)
        times = from_seconds(interval), from_seconds(delay)
        source = _Source(topic, *times, subscription.get_publisher_count)
        self._sources.append(source)
        self._report.add(topic.name, interval)

    def are_due(self, ns: int) -> bool:
        """Whether readings of stamps up to that of an IMU sample (ns) are still to come."""
        self._first = min(ns, self._first)
        begin = self._first - from_seconds(1.0 / self._scenario.imu.rate)
        return any(source.is_due(ns, begin) for source in self._sources)

    def apply(self, navigator: InertialNavigator | None, ns: int) -> None:
        """Apply the readings up to a stamp, which the navigator has reached."""
        if navigator is not None:
            self._report.tick(ns)
        for source in self._sources:
            for stamp in sorted(stamp for stamp in source.waiting if stamp <= ns):
                reading, describe = source.waiting.pop(stamp)
                if navigator is None:
                    continue
                time = to_seconds(stamp)
                if (measurement := reading(navigator, time)) is None:
                    self._report.absent(source.topic.name, NO_FIX)
                    continue
                result = navigator.measure(time, measurement)
                self._measuring.reading(source.topic.name, result, describe)
                self._report.note(source.topic.name, stamp, result)

    def _pressure(self, message: FluidPressure) -> _Read:
        settings = self._scenario.height
        pressure, height, variance = read_pressure(message, settings)
        reading = HeightReading(height, variance or settings.sigma**2)
        return lambda *_: reading, lambda seen: _unlikely_pressure(pressure, seen, settings)

    def _velocity(self, message: TwistWithCovarianceStamped) -> _Read:
        settings = self._scenario.velocity
        velocity, covariance = read_velocity(message, self._frame)
        velocity[[axis for axis in range(3) if axis not in settings.axes]] = np.nan
        reading = VelocityReading.of(settings, velocity, covariance)
        return lambda *_: reading, _unlikely_velocity

    def _satellite_fix(self, message: NavSatFix) -> _Read:
        scenario, found = self._scenario, read_satellite_fix(message)
        if found is None:
            return lambda *_: None, _far
        place, covariance = found
        fix = satellite_fix(scenario.gnss, place, scenario.height.measured, covariance)
        return lambda *_: fix, _far

    def _satellite_velocity(self, message: TwistWithCovarianceStamped) -> _Read:
        velocity, covariance = read_ground_velocity(message)
        gnss = self._scenario.gnss

        def of(navigator: InertialNavigator, time: float) -> Measurement | None:
            rate = navigator.sample_at(time)[1]
            return satellite_velocity(gnss, velocity, rate, covariance)

        return of, _unlikely_velocity


def _far(seen: Innovation) -> str:
    """Say how far a position is that cannot be right."""
    return f"position {float(np.linalg.norm(seen.innovation[:2])):.0f} m from the estimate"


def _unlikely_pressure(pressure: float, seen: Innovation, settings: Height) -> str:
    """Say what is wrong with a pressure (Pa) that cannot be right."""
    text = (
        f"{pressure:g} Pa is a height of {seen.measured[0]:.0f} m, where"
        f" {seen.expected[0]:.0f} m was expected"
    )
    for unit, factor in _PRESSURE_UNITS.items():
        if abs(float(height_of(factor * pressure, settings)) - seen.expected[0]) < 2000.0:
            return f"{text}: is it {unit} instead of Pa?"
    return text


def _unlikely_velocity(seen: Innovation) -> str:
    """Say what is wrong with a velocity that cannot be right."""
    size, expected = (float(np.linalg.norm(one)) for one in (seen.measured, seen.expected))
    text = f"speed of {size:.2f} m/s where {expected:.2f} m/s was expected"
    if abs(size / max(expected, 1e-3) / _KNOTS - 1.0) < 0.05:
        return f"{text}: is it knots instead of m/s?"
    return text
