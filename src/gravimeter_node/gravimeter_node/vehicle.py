"""Magnetometers on a magnetic vehicle: a scalar and a vector one, and what is taken off."""

from collections.abc import Callable, Mapping

import numpy as np
from sensor_msgs.msg import MagneticField

from isogal.arrays import Array
from isogal.fields.magnetic_vehicle import assumed_compensation
from isogal.magnetics.stream import CompensatedStream
from isogal_ros import topics
from isogal_ros.messages.adapter import Reading
from isogal_ros.messages.magnetometer import read_vector, write_vector
from isogal_ros.messages.stamps import to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode


class Vehicle:
    """Stands between raw readings and their reduction, for a node whose field is magnetic.

    Parameters
    ----------
    node : GraphNode
    use : callable
        Called with stamp (ns), total field without the vehicle (nT, NaN = none; with the terms of
        what is left, where the matcher estimates it) and its variance.
    """

    def __init__(self, node: GraphNode, use: Callable[[int, Reading, Reading], None]) -> None:
        self._node, self._use = node, use
        self._heard = False
        self._assumed = assumed = assumed_compensation(node.scenario)
        self._stream: CompensatedStream[tuple[int, Reading, Reading]] | None = None
        self.begin_anew()
        self._vectors: Mapping[int, Array] = {}
        if assumed is not None and assumed.currents:
            node.health.concern(
                "currents", f"not measured, taken as zero: {', '.join(assumed.currents)}"
            )

    def begin_anew(self) -> None:
        """Forget all that has come, and what has been learnt of the vehicle."""
        if self._assumed is not None:
            online = self._node.scenario.magnetometer.online
            self._stream = CompensatedStream(self._assumed, online)

    @property
    def has_scalar(self) -> bool:
        """Whether there is a scalar instrument as well as the vector one."""
        if not self._heard:
            scalar = self._node.listening[topics.SCALAR_FIELD.name]
            self._heard = scalar.get_publisher_count() > 0
        return self._heard

    def simulate(self, vectors: Mapping[int, Array]) -> None:
        """Prepare the simulated vector instrument: (3,) nT by stamp."""
        self._vectors = vectors
        self._publisher = self._node.advertise(topics.MAGNETIC_FIELD)

    def step(self, ns: int) -> None:
        """Publish what the simulated vector instrument senses, and take it."""
        if (vector := self._vectors.get(ns)) is not None:
            sigma = self._node.scenario.true.magnetometer.vector_sigma
            message = write_vector(ns, vector, sigma**2)
            self._publisher.publish(message)
            self.take_vector(message)

    def take_vector(self, message: MagneticField) -> None:
        """Take a message of the vector instrument."""
        if self._stream is not None:
            self._stream.vector(to_seconds(to_ns(message.header.stamp)), read_vector(message))
            self._pass_on(self._stream)

    def put(self, ns: int, total: Reading, variance: Reading) -> None:
        """Take a total field; it is used once the vehicle's own field is known."""
        if self._stream is None:
            self._use(ns, total, variance)
            return
        self._stream.scalar(to_seconds(ns), float(total), (ns, total, variance))
        self._pass_on(self._stream)

    def _pass_on(self, stream: CompensatedStream[tuple[int, Reading, Reading]]) -> None:
        for clean, (ns, total, variance) in stream.ready():
            silent = np.isnan(clean).all() and not np.isnan(total)
            text = "no readings of the vector magnetometer" if silent else None
            self._node.health.concern("vector", text)
            self._use(ns, clean, variance)
