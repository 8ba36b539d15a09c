"""Magnetometers on a magnetic vehicle: a scalar and a vector one, and what is taken off."""

from collections.abc import Callable
from typing import Any

import numpy as np

from isogal.fields.magnetic_vehicle import assumed_compensation
from isogal.magnetics.stream import CompensatedStream
from isogal_ros import topics
from isogal_ros.messages.magnetometer import MagnetometerAdapter
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

    def __init__(self, node: GraphNode, use: Callable[[int, Any, Any], None]) -> None:
        self._node, self._use = node, use
        self._heard = False
        told, online = assumed_compensation(node.scenario), node.scenario.magnetometer.online
        self._stream: CompensatedStream[tuple[int, Any, Any]] | None = (
            None if told is None else CompensatedStream(told, online)
        )
        self._vectors: dict[int, Any] = {}
        self._adapter = MagnetometerAdapter()
        if told is not None and told.currents:
            node.health.concern(
                "currents", f"not measured, taken as zero: {', '.join(told.currents)}"
            )

    @property
    def has_scalar(self) -> bool:
        """Whether there is a scalar instrument beside the vector one."""
        if not self._heard:
            self._heard = self._node.count_publishers(topics.SCALAR_FIELD.name) > 0
        return self._heard

    def simulate(self, vectors: dict[int, Any]) -> None:
        """Prepare the simulated vector instrument: (3,) nT by stamp."""
        self._vectors = vectors
        self._message = self._adapter.new_raw()
        self._publisher = self._node.advertise(topics.MAGNETIC_FIELD)

    def step(self, ns: int) -> None:
        """Publish what the simulated vector instrument feels, and take it."""
        vector = self._vectors.get(ns)
        if vector is None:
            return
        sigma = self._node.scenario.true.magnetometer.vector_sigma
        self._adapter.fill_vector(self._message, ns, vector, sigma**2)
        self._publisher.publish(self._message)
        self.vector(ns, vector)

    def take_vector(self, message: Any) -> None:
        """Take a message of the vector instrument."""
        if self._stream is not None:
            self.vector(to_ns(message.header.stamp), self._adapter.read_vector(message))

    def vector(self, ns: int, vector: Any) -> None:
        """Take a reading of the vector instrument, nT."""
        if self._stream is not None:
            self._stream.vector(to_seconds(ns), vector)
            self._pass_on()

    def put(self, ns: int, total: Any, variance: Any) -> None:
        """Take a total field; it is used once the vehicle's own field is known."""
        if self._stream is None:
            self._use(ns, total, variance)
            return
        self._stream.scalar(to_seconds(ns), float(total), (ns, total, variance))
        self._pass_on()

    def _pass_on(self) -> None:
        for clean, (ns, total, variance) in self._stream.ready() if self._stream else ():
            silent = np.isnan(clean).all() and not np.isnan(total)
            text = "no readings of the vector magnetometer" if silent else None
            self._node.health.concern("vector", text)
            self._use(ns, clean, variance)
