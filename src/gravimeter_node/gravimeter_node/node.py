"""The sensor: raw readings, simulated or of an instrument, and their reductions with the
navigator's estimate.

A gravimeter, unless the parameter `field` names a field of another instrument."""

import math
import sys
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from gravimeter_node.outputs import Outputs
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulator import ReadingSimulator
from isogal.sensors.scans import Thinning
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.checks import require_later
from isogal_ros.messages.stamps import from_seconds, peek_ns, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode, NodeSettings
from isogal_ros.nodes.health import OK
from isogal_ros.nodes.nav_queue import NavQueue
from isogal_ros.nodes.nav_sample import NavSample
from isogal_ros.nodes.spin import run_node

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
        self._reduced = 0
        """Readings reduced so far."""
        self._out_of_range = self._left_out = 0
        covariance = measured_field(self.scenario).covariance(self.scenario)
        self._variance = self.scenario.gravimeter.sigma**2 if covariance is None else covariance
        self._newest = -1
        self._same = 0
        self._felt_last: Any = math.nan
        self._adapter = adapter_of(self.scenario)
        self._message = self._adapter.new_raw()
        if self.settings.simulate:
            self._felt = self._readings()
            self._raw = self.advertise(self._adapter.raw)
            self.listen(topics.TRUTH_FIX, self._feel, raw=True)
        else:
            self._thinning = Thinning(from_seconds(self.scenario.gravimeter.interval))
            self.listen(self._adapter.raw, self._take)
        self._outputs = Outputs(self)
        self._queue = NavQueue(self, self.scenario, self._reduce)

    def _readings(self) -> dict[int, Any]:
        """Return the raw reading of each scan, a number or one for each channel, by stamp; the map
        is not kept."""
        trajectory = build_trajectory(self.scenario)
        simulator = ReadingSimulator(
            self.scenario.world,
            trajectory,
            map_for_scenario(self.scenario.world, trajectory),
            [self.settings.run],
        )
        stamps = [from_seconds(time) for time in trajectory.time[simulator.index]]
        return dict(zip(stamps, simulator.felt[0], strict=True))

    def _feel(self, data: bytes) -> None:
        felt = self._felt.get(ns := peek_ns(data))
        if felt is None:
            return
        self._adapter.fill_raw(self._message, ns, felt, self._variance)
        self._raw.publish(self._message)
        self._enqueue(ns, felt, self._variance)

    def _take(self, message: Any) -> None:
        ns = to_ns(message.header.stamp)
        felt, variance = self._adapter.read_raw(message)
        require_later(ns, self._newest)
        self._newest = ns
        if self._thinning.takes(ns):
            self._enqueue(ns, felt, self._variance if variance is None else variance)
        else:
            self._left_out += 1
            self.health.figures["readings between scans"] = self._left_out

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


def main(args: Sequence[str] | None = None) -> None:
    """Entry point of the console script."""
    sys.exit(run_node(topics.GRAVIMETER, lambda: GravimeterNode(topics.GRAVIMETER), args))


if __name__ == "__main__":
    main()
