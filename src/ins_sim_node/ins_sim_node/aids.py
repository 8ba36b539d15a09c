"""Sensors beside the IMU, whose messages may come late, each with its own stamp."""

import math
from collections.abc import Iterator

import numpy as np

from isogal.arrays import Array, Integers
from isogal.fields.simulated_vehicle import SimulatedVehicle
from isogal.scenario import Gnss, HeadingAid, Height, PositionAid
from isogal_ros import topics
from isogal_ros.messages.aids import (
    Aid,
    each_aid,
    fill_ground_velocity,
    fill_heading,
    fill_position,
    fill_pressure,
    fill_twist,
)
from isogal_ros.messages.frames import ANTENNA, BASE, FRD_FLU, framed
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Message


def _measured(vehicle: SimulatedVehicle) -> Iterator[tuple[Integers, Array]]:
    """Yield, in the order of `each_aid`, the steps (K,) at whose ends an aid measures, and what
    (K, ...)."""
    found, steps = vehicle.aids, np.arange(1, len(vehicle) + 1)
    heights = [one for one in (found.height, *found.heights) if one is not None]
    for each in (*heights, *found.velocities):
        yield _known(steps, each[0])
    if (fixes := found.satellites) is not None:
        yield fixes.ends, fixes.position[0]
        if fixes.velocity is not None:
            yield fixes.ends, fixes.velocity[0]
    for place in found.positions:
        yield place.ends, place.position[0]
    for bow in found.headings:
        yield _known(bow.ends, bow.heading[0])


def _known(steps: Integers, values: Array) -> tuple[Integers, Array]:
    """Leave out the steps (K,) of which there is no number (K, ...)."""
    known = np.isfinite(values.reshape(len(values), -1)).any(axis=-1)
    return steps[known], values[known]


def _fill(message: Message, ns: int, value: Array, aid: Aid, really: Aid) -> None:
    """Write what an aid measures at a stamp (ns) into its message: what it believes of its errors,
    and a pressure as it really is."""
    match aid.settings, really.settings:
        case Height(), Height() as sensor:
            fill_pressure(message, ns, float(value), sensor)
        case Gnss() as gnss, _:
            fill_ground_velocity(message, ns, value, float(gnss.velocity_sigma or 0.0))
        case PositionAid() as place, _:
            fill_position(message, ns, value, place)
        case HeadingAid() as bow, _:
            fill_heading(message, ns, float(value), bow)
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
        self._aids = []
        each = each_aid(node.scenario), each_aid(node.scenario.true), _measured(vehicle)
        for aid, really, (ends, values) in zip(*each, strict=True):
            late = math.ceil(really.delay / vehicle.trajectory.dt - 1e-9)
            rows = dict(zip(ends.tolist(), values, strict=True))
            of_satellites = aid.topic in (topics.GNSS_FIX, topics.GNSS_VELOCITY)
            message = framed(aid.topic, ANTENNA if of_satellites else BASE)
            self._aids.append((aid, really, late, rows, node.advertise(aid.topic), message))
        self._step_ns = from_seconds(vehicle.trajectory.dt)

    def publish(self, k: int, ns: int) -> None:
        """Publish what comes at the end of step k, which has a stamp (ns)."""
        for aid, really, late, rows, publisher, message in self._aids:
            if (value := rows.get(k - late)) is not None:
                _fill(message, ns - late * self._step_ns, value, aid, really)
                publisher.publish(message)
