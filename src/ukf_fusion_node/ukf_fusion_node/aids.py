"""Readings of sensors beside the IMU: when they are due, and what the filter does with them."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from sensor_msgs.msg import FluidPressure, Imu, NavSatFix
from std_srvs.srv import SetBool

from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import (
    HeadingReading,
    HeightReading,
    Innovation,
    Measurement,
    VelocityReading,
    position_fix,
    satellite_velocity,
)
from isogal.scenario import HeadingAid, Height, PositionAid, Velocity
from isogal.sensors.barometer import height_of
from isogal_ros.messages.aids import (
    Aid,
    each_aid,
    read_ground_velocity,
    read_position_fix,
    read_pressure,
    read_velocity,
)
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.pose_aids import read_heading, read_pose_position
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Topic
from ukf_fusion_node.aid_report import AidReport
from ukf_fusion_node.measuring import Measured

_KNOTS = 1.94384
_PRESSURE_UNITS = {"hPa": 1e2, "kPa": 1e3, "dbar": 1e4, "bar": 1e5}
Message: TypeAlias = (
    FluidPressure | NavSatFix | TwistWithCovarianceStamped | PoseWithCovarianceStamped | Imu
)
_Reading = Callable[[InertialNavigator, float], Measurement | None]
"""Returns the measurement of a navigator at its time (s); None = there is no number."""
_Read = tuple[_Reading, Callable[[Innovation], str]]
"""A reading, and what to say of one that cannot be right."""
NO_FIX = "the receiver has no fix"
SWITCHED_OFF = "switched off by the service toggle"


@dataclass
class _Source:
    """Readings of one topic that wait for the navigator to reach their stamps."""

    topic: Topic
    interval: int
    """ns between readings."""
    delay: int
    """ns by which they come later than their stamps."""
    publishers: Callable[[], int]
    measured: Measured
    newest: int = -1
    """Stamp of the newest reading; -1 = none yet."""
    waiting: dict[int, _Read] = field(default_factory=dict)

    def is_due(self, ns: int, now: int, begin: int) -> bool:
        """Whether a reading of a stamp up to `ns` is still to come; it is waited for as long as
        another one would take, by the newest stamp `now` that has come."""
        due = (begin if self.newest < 0 else self.newest) + self.interval + self.delay
        return due <= ns and now < due + self.interval and self.publishers() > 0


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
        self._report = AidReport(node)
        self._map = map_frame(node.scenario)
        self._off: set[str] = set()
        """Topics of aids that somebody has switched off."""
        self._sources: list[_Source] = []
        self._first = sys.maxsize
        """Stamp of the first IMU sample."""
        for aid in each_aid(node.scenario):
            for topic in (aid.topic, *aid.instead):
                self._add(node, topic, aid)

    def _reader(self, topic: Topic, aid: Aid) -> Callable[[Message], _Read]:
        """Return what reads the messages of an aid on a topic."""
        match aid.settings:
            case Height():
                return self._pressures(aid.settings)
            case Velocity():
                return self._velocities(aid.settings)
            case HeadingAid():
                return self._headings(aid.settings)
            case PositionAid():
                of_pose = topic.type is PoseWithCovarianceStamped
                return (self._poses if of_pose else self._positions)(aid.settings)
        return self._satellite_velocity

    def _add(self, node: GraphNode, topic: Topic, aid: Aid) -> None:
        read, interval = self._reader(topic, aid), aid.settings.interval

        def take(message: Message) -> None:
            reading = read(message)
            ns = to_ns(message.header.stamp)
            source.newest = max(source.newest, ns)
            source.waiting[ns] = reading
            self._advance()

        subscription = node.listen(topic, take)
        times = from_seconds(interval), from_seconds(aid.delay)
        measured = self._report.add(topic.name, interval)
        source = _Source(topic, *times, subscription.get_publisher_count, measured)
        self._sources.append(source)
        self._offer_toggle(node, topic.name)

    def _offer_toggle(self, node: GraphNode, name: str) -> None:
        """Offer the service toggle/<topic>, which says whether an aid is used."""

        def toggle(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            (self._off.discard if request.data else self._off.add)(name)
            response.success = True
            response.message = f"{name} is {'used' if request.data else 'not used'}"
            return response

        node.create_service(SetBool, f"toggle/{name}", toggle)

    def are_due(self, ns: int, now: int) -> bool:
        """Whether readings of stamps up to `ns`, that of the first of the IMU samples that wait,
        are still to come; `now` is the stamp of the last."""
        self._first = min(ns, self._first)
        begin = self._first - from_seconds(1.0 / self._scenario.imu.rate)
        return any(source.is_due(ns, now, begin) for source in self._sources)

    def apply(self, navigator: InertialNavigator | None, ns: int) -> None:
        """Apply the readings up to a stamp, which the navigator has reached."""
        if navigator is not None:
            self._report.tick(ns, navigator)
        for source in self._sources:
            for stamp in sorted(stamp for stamp in source.waiting if stamp <= ns):
                reading, describe = source.waiting.pop(stamp)
                if navigator is None:
                    continue
                time = to_seconds(stamp)
                if source.topic.name in self._off:
                    source.measured.absent(SWITCHED_OFF)
                elif (measurement := reading(navigator, time)) is None:
                    source.measured.absent(NO_FIX)
                else:
                    result = navigator.measure(time, measurement)
                    source.measured.take(stamp, result, describe)

    def _pressures(self, sensor: Height) -> Callable[[Message], _Read]:
        """Return what reads the pressures of a sensor."""

        def read(message: FluidPressure) -> _Read:
            pressure, height, variance = read_pressure(message, sensor)
            reading = HeightReading(height, variance or sensor.sigma**2, sensor.prefix)
            return lambda *_: reading, lambda seen: _unlikely_pressure(pressure, seen, sensor)

        return read

    def _velocities(self, sensor: Velocity) -> Callable[[Message], _Read]:
        """Return what reads the velocities of a sensor."""

        def read(message: TwistWithCovarianceStamped) -> _Read:
            velocity, covariance = read_velocity(message, self._frame)
            velocity[[axis for axis in range(3) if axis not in sensor.axes]] = np.nan

            def of(navigator: InertialNavigator, time: float) -> Measurement | None:
                rate = navigator.sample_at(time)[1]
                return VelocityReading.of(sensor, velocity, covariance, rate)

            return of, _unlikely_velocity

        return read

    def _positions(self, aid: PositionAid) -> Callable[[Message], _Read]:
        """Return what reads the fixes of an aid."""

        def read(message: NavSatFix) -> _Read:
            found = read_position_fix(message)
            if found is None:
                return lambda *_: None, _far
            fix = position_fix(aid, found[0], self._scenario.height.measured, found[1])
            return lambda *_: fix, _far

        return read

    def _poses(self, aid: PositionAid) -> Callable[[Message], _Read]:
        """Return what reads the poses of an aid."""

        def read(message: PoseWithCovarianceStamped) -> _Read:
            place, covariance = read_pose_position(message, self._map)
            fix = position_fix(aid, place, self._scenario.height.measured, covariance)
            return lambda *_: fix, _far

        return read

    def _headings(self, aid: HeadingAid) -> Callable[[Message], _Read]:
        """Return what reads the headings of an aid."""

        def read(message: Imu) -> _Read:
            heading, variance = read_heading(message)
            epoch = self._scenario.magnetometer.epoch
            reading = HeadingReading.of(aid, heading, epoch, variance)
            return lambda *_: reading, _turned

        return read

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


def _turned(seen: Innovation) -> str:
    """Say how far off a heading is that cannot be right."""
    return f"heading {math.degrees(seen.innovation[0]):.1f} deg from the estimate"


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
