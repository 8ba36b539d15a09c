"""Aids whose messages may come late, each with its own stamp."""

import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

from isogal.fields.simulated_vehicle import SimulatedVehicle
from isogal.scenario import HeadingAid, PositionAid
from isogal.sensors.heading_aid import Headings
from isogal.sensors.position_aid import Positions
from isogal_ros import topics
from isogal_ros.messages.aids import aids_of, fill_ground_velocity, fill_position
from isogal_ros.messages.frames import ANTENNA, BASE
from isogal_ros.messages.pose_aids import fill_heading
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Topic


class _Aid(NamedTuple):
    """What is published of one aid."""

    late: int
    """Steps by which it comes late."""
    rows: dict[int, int]
    """Rows of what is simulated, by the end of the step that they are of."""
    publish: Callable[[int, int], None]
    """Publishes a row with a stamp (ns)."""


class LateAids:
    """Publishes what the vehicle's aids of position and heading give.

    Parameters
    ----------
    node : GraphNode
    vehicle : SimulatedVehicle
        Of one run.
    """

    def __init__(self, node: GraphNode, vehicle: SimulatedVehicle) -> None:
        self._node, self._vehicle = node, vehicle
        self._step_ns = from_seconds(vehicle.trajectory.dt)
        self._aids = [*self._satellites(), *self._positions(), *self._headings()]

    def publish(self, k: int, ns: int) -> None:
        """Publish what comes at the end of step k, which has a stamp (ns)."""
        for aid in self._aids:
            row = aid.rows.get(k - aid.late)
            if row is not None:
                aid.publish(row, ns - aid.late * self._step_ns)

    def _aid(self, delay: float, ends: list[int], publish: Callable[[int, int], None]) -> _Aid:
        late = math.ceil(delay / self._vehicle.trajectory.dt - 1e-9)
        return _Aid(late, {k: row for row, k in enumerate(ends)}, publish)

    def _sender(
        self, topic: Topic, frame: str, fill: Callable[[topics.Message, int, int], bool]
    ) -> Callable[[int, int], None]:
        """Return what publishes a row; `fill` writes it (message, stamp, row) and says whether
        there is anything to publish."""
        publisher, message = self._node.advertise(topic), topic.type()
        message.header.frame_id = frame

        def publish(row: int, ns: int) -> None:
            if fill(message, ns, row):
                publisher.publish(message)

        return publish

    def _satellites(self) -> Iterator[_Aid]:
        fixes, scenario = self._vehicle.aids.satellites, self._node.scenario
        if fixes is None:
            return
        gnss, ends, delay = scenario.gnss, fixes.ends.tolist(), scenario.true.gnss.delay

        def fix(message: topics.Message, ns: int, row: int) -> bool:
            fill_position(message, ns, fixes.position[0, row], gnss.positions)
            return True

        def velocity(message: topics.Message, ns: int, row: int) -> bool:
            fill_ground_velocity(message, ns, fixes.velocity[0, row], gnss.velocity_sigma or 0.0)
            return True

        yield self._aid(delay, ends, self._sender(topics.GNSS_FIX, ANTENNA, fix))
        if topics.GNSS_VELOCITY in aids_of(scenario):
            sender = self._sender(topics.GNSS_VELOCITY, ANTENNA, velocity)
            yield self._aid(delay, ends, sender)

    def _positions(self) -> Iterator[_Aid]:
        scenario, every = self._node.scenario, self._vehicle.aids.positions
        true = scenario.true.positions or ()
        for aid, really, places in zip(scenario.positions or (), true, every, strict=True):
            yield self._position(aid, places, really.delay)

    def _position(self, aid: PositionAid, places: Positions, delay: float) -> _Aid:
        def fill(message: topics.Message, ns: int, row: int) -> bool:
            fill_position(message, ns, places.position[0, row], aid)
            return True

        sender = self._sender(topics.position_topics(aid.name)[0], BASE, fill)
        return self._aid(delay, places.ends.tolist(), sender)

    def _headings(self) -> Iterator[_Aid]:
        scenario, every = self._node.scenario, self._vehicle.aids.headings
        true = scenario.true.headings or ()
        for aid, really, seen in zip(scenario.headings or (), true, every, strict=True):
            yield self._heading(aid, seen, really.delay)

    def _heading(self, aid: HeadingAid, seen: Headings, delay: float) -> _Aid:
        def fill(message: topics.Message, ns: int, row: int) -> bool:
            heading = float(seen.heading[0, row])
            if math.isnan(heading):
                return False
            fill_heading(message, ns, heading, aid)
            return True

        sender = self._sender(topics.heading_topic(aid.name), BASE, fill)
        return self._aid(delay, seen.ends.tolist(), sender)
