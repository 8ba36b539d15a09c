"""What the simulated vehicle's sensors of height and velocity publish."""

import math

import numpy as np

from isogal.fields.simulated_vehicle import SimulatedVehicle
from isogal_ros import topics
from isogal_ros.messages.aids import fill_pressure, fill_velocity
from isogal_ros.messages.frames import BASE
from isogal_ros.nodes.base import GraphNode


class AidOutputs:
    """Publishers of the sensors that the vehicle has."""

    def __init__(self, node: GraphNode, vehicle: SimulatedVehicle) -> None:
        self._vehicle, self._settings = vehicle, node.scenario.true.height
        self._m_pressure, self._m_velocity = topics.BAROMETER.type(), topics.VELOCITY.type()
        for message in (self._m_pressure, self._m_velocity):
            message.header.frame_id = BASE
        if vehicle.height is not None:
            self._pressure = node.advertise(topics.BAROMETER)
        if vehicle.velocity is not None:
            self._velocity = node.advertise(topics.VELOCITY)

    def publish(self, k: int, ns: int) -> None:
        """Publish what is read at the end of step k > 0, if anything is."""
        height, velocity = self._vehicle.height, self._vehicle.velocity
        if height is not None and not math.isnan(height[k - 1]):
            fill_pressure(self._m_pressure, ns, float(height[k - 1]), self._settings)
            self._pressure.publish(self._m_pressure)
        if velocity is not None and np.isfinite(velocity[k - 1]).any():
            fill_velocity(self._m_velocity, ns, velocity[k - 1])
            self._velocity.publish(self._m_velocity)
