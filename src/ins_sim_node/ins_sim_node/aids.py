"""Sensors beside the IMU, whose messages may come late, each with its own stamp."""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.fields.simulated_vehicle import SimulatedVehicle
from isogal.scenario import HeadingAid, Height
from isogal_ros import topics
from isogal_ros.messages.aids import (
    fill_ground_velocity,
    fill_heading,
    fill_position,
    fill_pressure,
    fill_velocity,
)
from isogal_ros.messages.frames import ANTENNA, BASE, framed
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Message, Topic


class _Aid(NamedTuple):
    """What is published of one aid."""

    topic: Topic
    frame: str
    delay: float
    """s by which it comes late, at least."""
    ends: Integers
    """(K,) steps at whose ends it measures."""
    values: Array
    """(K, ...) what it measures."""
    fill: Callable[[Message, int, Array], None]
    """Writes a value of a stamp (ns) into a message."""


def _aids(node: GraphNode, vehicle: SimulatedVehicle) -> Iterator[_Aid]:
    """Yield the aids of a vehicle, with the delays that they really have."""
    scenario, true, found = node.scenario, node.scenario.true, vehicle.aids
    steps = np.arange(1, len(vehicle) + 1)
    if found.height is not None:
        yield _of_height(topics.BAROMETER, true.height, steps, found.height[0])
    for sensor, heights in zip(true.heights or (), found.heights, strict=True):
        (topic,) = topics.aid_topics("barometer", sensor.name)
        yield _of_height(topic, sensor, steps, heights[0])
    for one, speeds in zip(scenario.velocity_aids, found.velocities, strict=True):
        measures = np.isfinite(speeds[0]).any(axis=-1)
        (topic,) = topics.aid_topics("velocity", getattr(one, "name", None))
        yield _Aid(topic, BASE, 0.0, steps[measures], speeds[0][measures], fill_velocity)
    if (fixes := found.satellites) is not None:
        gnss, late = scenario.gnss, (true.gnss.delay, fixes.ends)
        fill = partial(fill_position, aid=gnss.positions)
        yield _Aid(topics.GNSS_FIX, ANTENNA, *late, fixes.position[0], fill)
        if gnss.velocity_sigma is not None:
            speed = partial(fill_ground_velocity, sigma=gnss.velocity_sigma)
            yield _Aid(topics.GNSS_VELOCITY, ANTENNA, *late, fixes.velocity[0], speed)
    of_positions = scenario.positions or (), true.positions or (), found.positions
    for aid, really, places in zip(*of_positions, strict=True):
        topic, _ = topics.aid_topics("position", aid.name)
        fill = partial(fill_position, aid=aid)
        yield _Aid(topic, BASE, really.delay, places.ends, places.position[0], fill)
    of_headings = scenario.headings or (), true.headings or (), found.headings
    for bow, really_bow, seen in zip(*of_headings, strict=True):
        (topic,), known = topics.aid_topics("heading", bow.name), ~np.isnan(seen.heading[0])
        turn = partial(_fill_heading, aid=bow)
        yield _Aid(topic, BASE, really_bow.delay, seen.ends[known], seen.heading[0][known], turn)


def _of_height(topic: Topic, settings: Height, steps: Integers, heights: Array) -> _Aid:
    """Return a sensor that reads heights (K,), m, NaN = none, at the ends of steps (K,)."""
    known, fill = ~np.isnan(heights), partial(_fill_height, settings=settings)
    return _Aid(topic, BASE, 0.0, steps[known], heights[known], fill)


def _fill_height(message: Message, ns: int, height: Array, settings: Height) -> None:
    fill_pressure(message, ns, float(height), settings)


def _fill_heading(message: Message, ns: int, heading: Array, aid: HeadingAid) -> None:
    fill_heading(message, ns, float(heading), aid)


class Aids:
    """Publishes what the vehicle's sensors beside the IMU give.

    Parameters
    ----------
    node : GraphNode
    vehicle : SimulatedVehicle
        Of one run.
    """

    def __init__(self, node: GraphNode, vehicle: SimulatedVehicle) -> None:
        self._aids = []
        for aid in _aids(node, vehicle):
            late = math.ceil(aid.delay / vehicle.trajectory.dt - 1e-9)
            rows = {k: row for row, k in enumerate(aid.ends.tolist())}
            sent = node.advertise(aid.topic), framed(aid.topic, aid.frame)
            self._aids.append((aid, late, rows, *sent))
        self._step_ns = from_seconds(vehicle.trajectory.dt)

    def publish(self, k: int, ns: int) -> None:
        """Publish what comes at the end of step k, which has a stamp (ns)."""
        for aid, late, rows, publisher, message in self._aids:
            if (row := rows.get(k - late)) is not None:
                aid.fill(message, ns - late * self._step_ns, aid.values[row])
                publisher.publish(message)
