"""Readings of sensors beside the IMU: when they are due, and what the filter does with them."""

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistWithCovarianceStamped
from numpy.typing import ArrayLike
from sensor_msgs.msg import FluidPressure, Imu, NavSatFix
from std_srvs.srv import SetBool

from isogal.arrays import Array
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.measurements import (
    Innovation,
    Measurement,
    reading_of,
)
from isogal.scenario import Gnss, HeadingAid, Height, PositionAid, Velocity
from isogal.sensors.barometer import height_of
from isogal_ros.messages.aids import (
    Aid,
    each_aid,
    read_heading,
    read_pose_position,
    read_position_fix,
    read_pressure,
    read_velocity,
)
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import NED_ENU, map_frame
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Message, Topic
from ukf_fusion_node.measuring import AidReport, Describe, Measured
from ukf_fusion_node.settings import UkfFusionSettings
from ukf_fusion_node.stamp_queue import StampQueue

_KNOTS = 1.94384
_PRESSURE_UNITS = {"hPa": 1e2, "kPa": 1e3, "dbar": 1e4, "bar": 1e5}
_Read = tuple[Callable[[Array], Measurement | None], Describe | None]
"""What returns the measurement for the angular rate (3,) of its time (None = there is no number),
and what says of one that cannot be right what is wrong with it (None = its reason does)."""
NO_FIX = "the receiver has no fix"
NO_NAVIGATOR = "there was no navigator yet"
SWITCHED_OFF = "switched off by the service toggle"


@dataclass
class _Source:
    """Readings of one topic that wait for the navigator to reach their stamps."""

    interval: int
    """ns between readings."""
    delay: int
    """ns by which they come later than their stamps."""
    publishers: Callable[[], int]
    measured: Measured
    waiting: StampQueue[_Read]
    is_on: bool = True
    """Whether nobody has switched it off."""
    newest: int = -1
    """Stamp of the newest reading; -1 = none yet."""

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

    def __init__(self, node: GraphNode[UkfFusionSettings], advance: Callable[[], None]) -> None:
        self._scenario, self._advance = node.scenario, advance
        self._frame, self._map = node.settings.velocity_frame, map_frame(node.scenario)
        self._sources: dict[str, _Source] = {}
        self._first = sys.maxsize
        """Stamp of the first IMU sample."""
        each = []
        for aid in each_aid(node.scenario):
            either = aid.topic, *aid.instead
            for topic in either:
                self._add(node, topic, aid)
            each.append({topic.name: self._sources[topic.name].measured for topic in either})
        self._report = AidReport(node, each)

    def _add(self, node: GraphNode[UkfFusionSettings], topic: Topic, aid: Aid) -> None:
        """Listen to a topic of an aid, and offer the service toggle/<topic>, which says whether it
        is used."""

        def take(message: Message) -> None:
            ns = to_ns(message.header.stamp)
            try:
                source.waiting.add(ns, self._read(aid, message))
            except BadMessageError as error:
                source.measured.absent(str(error))
                raise
            source.newest = max(source.newest, ns)
            self._advance()

        def toggle(request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
            source.is_on, response.success = request.data, True
            response.message = f"{topic.name} is {'used' if request.data else 'not used'}"
            return response

        interval = aid.settings.interval
        publishers = node.listen(topic, take).get_publisher_count
        measured = Measured(topic.name, node.health, interval)
        times = from_seconds(interval), from_seconds(aid.settings.delay)
        waiting = StampQueue[_Read](from_seconds(node.settings.max_gap))
        source = self._sources[topic.name] = _Source(*times, publishers, measured, waiting)
        node.create_service(SetBool, f"toggle/{topic.name}", toggle)

    def are_due(self, ns: int, now: int) -> bool:
        """Whether readings of stamps up to `ns`, that of the first of the IMU samples that wait,
        are still to come; `now` is the stamp of the last."""
        if not self._sources:
            return False
        self._first = min(ns, self._first)
        begin = self._first - from_seconds(1.0 / self._scenario.imu.rate)
        return any(source.is_due(ns, now, begin) for source in self._sources.values())

    def apply(self, navigator: InertialNavigator | None, ns: int) -> None:
        """Apply the readings up to a stamp, which the navigator has reached. Those that are ahead
        of it by more than a gap in its samples may be are of another clock: it refuses them."""
        if navigator is None:
            return
        self._report.tick(ns, navigator)
        for source in self._sources.values():
            for stamp, (reading, describe) in source.waiting.due(ns):
                if stamp > ns:
                    source.newest = ns
                time = to_seconds(stamp)
                if not source.is_on:
                    source.measured.absent(SWITCHED_OFF)
                elif (measurement := reading(navigator.sample_at(time)[1])) is None:
                    source.measured.absent(NO_FIX)
                else:
                    result = navigator.measure(time, measurement)
                    source.measured.take(stamp, result, describe)

    def pass_by(self, ns: int) -> None:
        """Let the readings up to a stamp go, at which there is no navigator yet."""
        for source in self._sources.values():
            for _ in source.waiting.due(ns):
                source.measured.absent(NO_NAVIGATOR)

    def begin_anew(self) -> None:
        """Forget what has come: time may begin anew."""
        self._first = sys.maxsize
        for source in self._sources.values():
            source.waiting.forget()
            source.newest = source.measured.newest = -1

    def _read(self, aid: Aid, message: Message) -> _Read:
        """Return the reading that a message of an aid is; raises BadMessageError where it cannot
        be used."""
        found: tuple[ArrayLike, ArrayLike | None] | None
        describe: Describe | None
        match aid.settings, message:
            case Height() as sensor, FluidPressure():
                pressure, height, variance = read_pressure(message, sensor)
                found = height, variance
                describe = partial(_unlikely_pressure, pressure, sensor)
            case Velocity() as sensor, TwistWithCovarianceStamped():
                velocity, covariance = read_velocity(message, self._frame)
                velocity[[axis for axis in range(3) if axis not in sensor.axes]] = np.nan
                found, describe = (velocity, covariance), _unlikely_velocity
            case Gnss(), TwistWithCovarianceStamped():
                found, describe = read_velocity(message, "", NED_ENU), _unlikely_velocity
            case HeadingAid(), Imu():
                found, describe = read_heading(message), _turned
            case PositionAid(), NavSatFix():
                found, describe = read_position_fix(message), None
            case PositionAid(), PoseWithCovarianceStamped():
                found, describe = read_pose_position(message, self._map), None
            case _:
                raise TypeError(f"no reading of {type(aid.settings).__name__}")
        if found is None:
            return lambda _: None, describe
        value, stated = found
        return partial(reading_of, aid.settings, value, self._scenario, stated=stated), describe


def _turned(seen: Innovation) -> str:
    """Say how far off a heading is that cannot be right."""
    return f"heading {math.degrees(seen.innovation[0]):.1f} deg from the estimate"


def _unlikely_pressure(pressure: float, settings: Height, seen: Innovation) -> str:
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
