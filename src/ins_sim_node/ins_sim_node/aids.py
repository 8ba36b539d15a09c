"""Sensors beside the IMU, whose messages may come late, each with its own stamp."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.fields.simulated_vehicle import SimulatedVehicle
from isogal.scenario import AnyAid, Gnss, HeadingAid, Height, PositionAid
from isogal.scenario.aids import VERTICAL
from isogal_ros import topics
from isogal_ros.messages.aids import (
    aid_of,
    fill_heading,
    fill_position,
    fill_pressure,
    fill_twist,
)
from isogal_ros.messages.frames import ANTENNA, BASE, FRD_FLU, NED_ENU, framed
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Message


def _fill(message: Message, ns: int, value: Array, aid: AnyAid, really: AnyAid) -> None:
    """Write what an aid measures at a stamp (ns) into its message: what it believes of its errors,
    and a pressure as it really is."""
    match aid, really:
        case Height(), Height():
            fill_pressure(message, ns, float(value), really)
        case Gnss(), _:
            sigma = np.array([1.0, 1.0, VERTICAL]) * (aid.velocity_sigma or 0.0)
            fill_twist(message, ns, NED_ENU @ value, sigma**2)
        case PositionAid(), _:
            fill_position(message, ns, value, aid)
        case HeadingAid(), _:
            fill_heading(message, ns, float(value), aid)
        case _:
            fill_twist(message, ns, value * FRD_FLU)


class Aids:
    """Publishes what the vehicle's sensors beside the IMU give, as late as it really comes.

    Parameters
    ----------
    node : GraphNode
    vehicle : SimulatedVehicle
        Of one run.
    """

    def __init__(self, node: GraphNode, vehicle: SimulatedVehicle) -> None:
        self._aids, scenario, truth = [], node.scenario, node.scenario.true
        each = [*zip(scenario.aids, truth.aids, vehicle.aids, strict=True)]
        if scenario.height.measured and vehicle.heights is not None:
            each.insert(0, (scenario.height, truth.height, vehicle.heights))
        for aid, really, read in each:
            if (known := aid_of(aid)) is None:
                continue
            topic = known.topic
            late = math.ceil(really.delay / vehicle.trajectory.dt - 1e-9)
            rows = dict(zip(read.ends.tolist(), read.values[0], strict=True))
            of_satellites = topic in (topics.GNSS_FIX, topics.GNSS_VELOCITY)
            message = framed(topic, ANTENNA if of_satellites else BASE)
            self._aids.append((aid, really, late, rows, node.advertise(topic), message))
        self._step_ns = from_seconds(vehicle.trajectory.dt)

    def publish(self, k: int, ns: int) -> None:
        """Publish what comes at the end of step k, which has a stamp (ns)."""
        for aid, really, late, rows, publisher, message in self._aids:
            value = rows.get(k - late)
            # a receiver without satellites says so, a sensor without a heading says nothing
            if value is None or (isinstance(aid, HeadingAid) and np.isnan(value)):
                continue
            _fill(message, ns - late * self._step_ns, value, aid, really)
            publisher.publish(message)
