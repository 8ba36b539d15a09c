"""The sensor: raw readings, simulated or of an instrument, and their reductions with the
navigator's estimate.

A gravimeter, unless the parameter `field` names a field of another instrument."""

import math
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from gravimeter_node.outputs import Outputs
from gravimeter_node.simulated import simulated_readings
from gravimeter_node.vehicle import Vehicle
from isogal.fields.measured import measured_field
from isogal.sensors.scans import Thinning
from isogal_ros import topics
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.checks import require_later
from isogal_ros.messages.magnetometer import MagnetometerAdapter
from isogal_ros.messages.stamps import from_seconds, peek_ns, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode, NodeSettings
from isogal_ros.nodes.health import OK
from isogal_ros.nodes.nav_queue import NavQueue
from isogal_ros.nodes.nav_sample import NavSample
from isogal_ros.nodes.spin import main_of

STUCK = 6
"""Readings of exactly the same value, one after the other, after which the instrument counts as
stuck."""


class GravimeterSettings(NodeSettings):
    """Own parameters of gravimeter_node."""

    simulate: bool = Field(
        True,
        description=(
            "true: readings of the map at the true position; false: reduce the readings on the"
            " instrument's topic"
        ),
    )


class GravimeterNode(GraphNode):
    """Publishes the raw reading of each scan, then its reductions once the navigator's state of
    that stamp is there."""

    sections: ClassVar[Sequence[str]] = (
        "seed", "field", "route", "imu", "gravimeter", "magnetometer", "altimeter", "gradiometer",
        "map", "map_error", "fusion", "truth",
    )  # fmt: skip
    settings_model: ClassVar[type[NodeSettings]] = GravimeterSettings
    settings: GravimeterSettings

    def setup(self) -> None:
        """Draw the readings and make publishers and subscriptions."""
        self._reduced = self._out_of_range = self._left_out = 0
        """Readings so far."""
        covariance = measured_field(self.scenario).covariance(self.scenario)
        self._variance = self.scenario.gravimeter.sigma**2 if covariance is None else covariance
        self._newest, self._same = -1, 0
        self._felt_last: Any = math.nan
        self._adapter = adapter_of(self.scenario)
        self._message = self._adapter.new_raw()
        is_magnetic = self._adapter.raw is topics.MAGNETIC_FIELD
        self._vehicle = Vehicle(self, self._enqueue) if is_magnetic else None
        raw_topic = self._adapter.raw
        if self.settings.simulate:
            self._felt, vector = simulated_readings(self.scenario, self.settings.run)
            if self._vehicle is not None and vector is not None:
                self._vehicle.simulate(vector)
                raw_topic = topics.SCALAR_FIELD
            self._raw = self.advertise(raw_topic)
            self.listen(topics.TRUTH_FIX, self._feel, raw=True)
        else:
            self._thinning = Thinning(from_seconds(self.scenario.gravimeter.interval))
            self.listen(self._adapter.raw, self._take)
            if self._vehicle is not None:
                self.listen(topics.SCALAR_FIELD, self._take_scalar)
        self._outputs = Outputs(self)
        self._queue = NavQueue(self, self.scenario, self._reduce)

    def _feel(self, data: bytes) -> None:
        ns = peek_ns(data)
        require_later(ns, self._newest - 1)  # a step may come again
        self._newest = ns
        if self._vehicle is not None:
            self._vehicle.step(ns)
        if (felt := self._felt.get(ns)) is None:
            return
        self._adapter.fill_raw(self._message, ns, felt, self._variance)
        self._raw.publish(self._message)
        self._use(ns, felt, self._variance)

    def _take(self, message: Any) -> None:
        if self._vehicle is not None:
            self._vehicle.take_vector(message)
            if self._vehicle.has_scalar:
                return
        self._read(to_ns(message.header.stamp), *self._adapter.read_raw(message))

    def _take_scalar(self, message: Any) -> None:
        self._read(to_ns(message.header.stamp), *MagnetometerAdapter().read_scalar(message))

    def _read(self, ns: int, felt: Any, variance: Any) -> None:
        require_later(ns, self._newest)
        self._newest = ns
        if self._thinning.takes(ns):
            self._use(ns, felt, self._variance if variance is None else variance)
        else:
            self._left_out += 1
            self.health.figures["readings between scans"] = self._left_out

    def _use(self, ns: int, felt: Any, variance: Any) -> None:
        if self._vehicle is None:
            self._enqueue(ns, felt, variance)
        else:
            self._vehicle.put(ns, felt, variance)

    def _enqueue(self, ns: int, felt: Any, variance: Any) -> None:
        if np.isnan(felt).all():
            self._out_of_range += 1
            self.health.figures["readings out of range"] = self._out_of_range
        self._same = self._same + 1 if np.array_equal(felt, self._felt_last) else 0
        self._felt_last = felt
        self._queue.put(ns, (felt, variance))

    def _reduce(self, ns: int, reading: tuple[Any, Any], nav: NavSample | None) -> None:
        """Reduce and publish a reading, the value and its variance."""
        self._outputs.publish(ns, *reading, nav)
        self._reduced += 1
        self.health.figures |= {"readings": self._reduced, "last reading": to_seconds(ns)}
        text = f"stuck: {self._same + 1} readings of the same value"
        self.health.concern("stuck", text if self._same >= STUCK else None)
        self.health.state(OK, "reducing")


main = main_of(GravimeterNode, topics.GRAVIMETER)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
