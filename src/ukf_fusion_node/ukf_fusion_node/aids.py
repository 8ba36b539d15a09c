"""Readings of height and velocity sensors: when they are due, and what the filter does with
them."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.fusion.aiding import Innovation, update_height, update_velocity
from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.gate import beyond
from isogal.fusion.state import FilterState
from isogal.scenario import Height
from isogal.sensors.barometer import height_of
from isogal_ros import topics
from isogal_ros.messages.aids import read_pressure, read_velocity
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Topic
from ukf_fusion_node.rejections import Rejections

_KNOTS = 1.94384
_PRESSURE_UNITS = {"hPa": 1e2, "kPa": 1e3, "dbar": 1e4, "bar": 1e5}
Apply = Callable[[FilterState], Innovation | None]


@dataclass
class _Source:
    """Readings of one topic that wait for the navigator to reach their stamps."""

    topic: Topic
    interval: int
    """ns between readings."""
    publishers: Callable[[], int]
    newest: int = -1
    """Stamp of the newest reading; -1 = none yet."""
    waiting: dict[int, tuple[Apply, Callable[[Innovation], str]]] = field(default_factory=dict)

    def is_due(self, ns: int, begin: int) -> bool:
        """Whether a reading of a stamp up to `ns` is still to come; it is waited for as long as
        another one would take."""
        due = (begin if self.newest < 0 else self.newest) + self.interval
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
        self._scenario, self._health, self._advance = node.scenario, node.health, advance
        self._frame = node.settings.velocity_frame
        self._rejections = Rejections(node.health)
        self._counts: dict[str, int] = {}
        self._sources: list[_Source] = []
        self._first = sys.maxsize
        """Stamp of the first IMU sample."""
        height, velocity = node.scenario.height, node.scenario.velocity
        if height.measured:
            self._add(node, topics.BAROMETER, height.interval, self._pressure)
        if velocity.kind != "none":
            self._add(node, topics.VELOCITY, velocity.interval, self._velocity)

    def _add(
        self, node: GraphNode, topic: Topic, interval: float, read: Callable[[Any], Any]
    ) -> None:
        def take(message: Any) -> None:
            apply, describe = read(message)
            ns = to_ns(message.header.stamp)
            source.newest = max(source.newest, ns)
            source.waiting[ns] = apply, describe
            self._advance()

        subscription = node.listen(topic, take)
        source = _Source(topic, from_seconds(interval), subscription.get_publisher_count)
        self._sources.append(source)

    def are_due(self, ns: int) -> bool:
        """Whether readings of stamps up to that of an IMU sample (ns) are still to come."""
        self._first = min(ns, self._first)
        begin = self._first - from_seconds(1.0 / self._scenario.imu.rate)
        return any(source.is_due(ns, begin) for source in self._sources)

    def apply(self, navigator: BufferedNavigator | None, ns: int) -> None:
        """Apply the readings up to a stamp, which the navigator has reached."""
        for source in self._sources:
            for stamp in sorted(stamp for stamp in source.waiting if stamp <= ns):
                apply, describe = source.waiting.pop(stamp)
                if navigator is not None:
                    self._apply(navigator, source.topic.name, stamp, apply, describe)

    def _apply(
        self,
        navigator: BufferedNavigator,
        name: str,
        stamp: int,
        apply: Apply,
        describe: Callable[[Innovation], str],
    ) -> None:
        seen: list[Innovation] = []

        def update(state: FilterState) -> tuple[Array, float]:
            found = apply(state)
            if found is None:
                return np.zeros(2), 0.0
            seen[:] = [found]
            return np.zeros(2), found.nis

        result = navigator.update(to_seconds(stamp), update)
        if not result.accepted:
            self._health.drop(name, result.reason or "refused")
            return
        rejected = bool(seen) and not (seen[0].accepted or seen[0].contradicted)
        self._rejections.note(name, rejected)
        if rejected:
            gate = beyond(seen[0].nis, seen[0].allowed)
            self._health.drop(name, f"{describe(seen[0])} ({gate})")
        elif seen and seen[0].contradicted:
            self._health.drop(name, describe(seen[0]))
        else:
            self._counts[name] = self._counts.get(name, 0) + 1
            self._health.figures[f"{name} used"] = self._counts[name]

    def _pressure(self, message: Any) -> tuple[Apply, Callable[[Innovation], str]]:
        settings = self._scenario.height
        pressure, height, variance = read_pressure(message, settings)

        def apply(state: FilterState) -> Innovation:
            return update_height(state, self._model, 0, height, variance)

        return apply, lambda seen: _unlikely_pressure(pressure, seen, settings)

    def _velocity(self, message: Any) -> tuple[Apply, Callable[[Innovation], str]]:
        settings = self._scenario.velocity
        velocity, covariance = read_velocity(message, self._frame)
        velocity[[axis for axis in range(3) if axis not in settings.axes]] = np.nan

        def apply(state: FilterState) -> Innovation | None:
            return update_velocity(state, self._model, 0, settings, velocity, covariance)

        return apply, _unlikely_velocity

    def use(self, model: Any) -> None:
        """Take the model of the filter."""
        self._model = model


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
    """Say what is wrong with a velocity that cannot be right, or is not used."""
    if seen.contradicted:
        return "fixes contradicted the navigator: the velocity aid is not used any more"
    size, expected = (float(np.linalg.norm(one)) for one in (seen.measured, seen.expected))
    text = f"speed of {size:.2f} m/s where {expected:.2f} m/s was expected"
    if abs(size / max(expected, 1e-3) / _KNOTS - 1.0) < 0.05:
        return f"{text}: is it knots instead of m/s?"
    return text
