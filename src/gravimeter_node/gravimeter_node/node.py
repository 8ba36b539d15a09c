"""The sensor: raw readings, simulated or of an instrument, and their reductions with the
navigator's estimate.

A gravimeter, unless the parameter `field` names a field of another instrument."""

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

from gravimeter_node.vehicle import Vehicle
from isogal.arrays import Array
from isogal.fields.magnetic_vehicle import assumed_compensation
from isogal.fields.measured import measured_field, of_instrument
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulator import ReadingSimulator
from isogal.scenario import Scenario
from isogal.sensors.scans import Thinning
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.adapter import Reading, adapter_of
from isogal_ros.messages.checks import require_later
from isogal_ros.messages.magnetometer import read_scalar
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import OK
from isogal_ros.nodes.nav_queue import NavQueue, NavSample
from isogal_ros.nodes.settings import NodeSettings
from isogal_ros.nodes.spin import main_of
from isogal_ros.nodes.stuck import Repetitions, TimeJumps

STUCK = 6
"""Readings of exactly the same value, one after the other, after which the instrument of a vehicle
that moves counts as stuck, at least (`Repetitions`): where steps are coarse, or the land is flat,
the same value comes again and again."""
GAP = 10
"""Scans by which the stamp of a reading may be ahead of the one before: of a single one that is
further the stamp is wrong, or the instrument was off, and that is for the next to say."""
MOVES = 0.5
"""m/s: what a slower vehicle reads may well be the same once more."""


class GravimeterSettings(NodeSettings):
    """Own parameters of gravimeter_node."""

    simulate: bool = Field(
        True,
        description=(
            "true: readings of the map at the true position; false: reduce the readings on the"
            " instrument's topic"
        ),
    )


class GravimeterNode(GraphNode[GravimeterSettings]):
    """Publishes the raw reading of each scan, then its reductions once the navigator's state of
    that stamp is there. The graph waits for the reduction that is matched only."""

    sections: ClassVar[Sequence[str]] = (
        "seed", "field", "route", "imu", "gravimeter", "magnetometer", "altimeter", "gradiometer",
        "readings", "height", "map", "map_error", "fusion", "truth",
    )  # fmt: skip
    settings_model: ClassVar[type[NodeSettings]] = GravimeterSettings

    def setup(self) -> None:
        """Draw the readings and make publishers and subscriptions."""
        matched = measured_field(self.scenario)
        covariance = matched.covariance(self.scenario)
        self._variance: Reading = (
            self.scenario.gravimeter.sigma**2 if covariance is None else covariance
        )
        self._newest, self._resting = -1, Repetitions(STUCK)
        self._adapter = adapter_of(self.scenario)
        is_magnetic = self._adapter.raw is topics.MAGNETIC_FIELD
        self._vehicle = Vehicle(self, self._enqueue) if is_magnetic else None
        self._use = self._enqueue if self._vehicle is None else self._vehicle.put
        raw_topic = self._adapter.raw
        if self.settings.simulate:
            self._sensed, vectors = simulated_readings(self.scenario, self.settings.run)
            if self._vehicle is not None and vectors is not None:
                self._vehicle.simulate(vectors)
                raw_topic = topics.SCALAR_FIELD
            self._raw = self.advertise(raw_topic)
            self.listen(topics.TRUTH_FIX, self._simulate, raw=True)
        else:
            interval = from_seconds(self.scenario.gravimeter.interval)
            self._thinning, self._time_jumps = Thinning(interval), TimeJumps(GAP * interval)
            self.listen(self._adapter.raw, self._take)
            if self._vehicle is not None:
                self.listen(
                    topics.SCALAR_FIELD,
                    lambda one: self._read(to_ns(one.header.stamp), *read_scalar(one)),
                )
        self._outputs = []
        reduced = self.scenario.readings.reduced
        for field in [matched] if reduced else of_instrument(matched.instrument):
            adapter = adapter_of(self.scenario, field.name)
            is_matched = field.name == matched.name
            consumers = (topics.PMHT_MM, topics.INS_SIM) if is_matched else ()
            publisher = self.advertise(adapter.reduced, consumers)
            self._outputs.append((field.reduction(self.scenario), adapter, publisher))
        self._queue = NavQueue(self, self._reduce)
        self.offer_reset(self._reset)

    def _reset(self) -> str:
        """Forget all that has come: time may begin anew."""
        self._newest, self._resting = -1, Repetitions(STUCK)
        self._queue.begin_anew()
        if self._vehicle is not None:
            self._vehicle.begin_anew()
        return "begins with the next reading"

    def _simulate(self, data: bytes) -> None:
        """Publish the reading of a step, if it is one with a scan, and take it."""
        ns = peek_ns(data)
        require_later(ns, self._newest - 1)  # a step may come again
        self._newest = ns
        if self._vehicle is not None:
            self._vehicle.step(ns)
        if (reading := self._sensed.get(ns)) is not None:
            own, sensed = reading
            self._raw.publish(self._adapter.write_raw(own, sensed, self._variance, None))
            self._use(own, sensed, self._variance)

    def _take(self, message: topics.Message) -> None:
        if self._vehicle is not None:
            self._vehicle.take_vector(message)
            if self._vehicle.has_scalar:
                return
        self._read(to_ns(message.header.stamp), *self._adapter.read_raw(message))

    def _read(self, ns: int, sensed: Reading, variance: Reading | None) -> None:
        require_later(ns, self._newest)
        if self._newest >= 0:
            self._time_jumps.check(ns, self._newest)
        self._newest = ns
        if self._thinning.takes(ns):
            self._use(ns, sensed, self._variance if variance is None else variance)
        else:
            self.health.count("readings between scans")

    def _enqueue(self, ns: int, sensed: Reading, variance: Reading) -> None:
        if np.isnan(sensed).all():
            self.health.count("readings out of range")
        self._queue.put(ns, (sensed, variance))

    def _reduce(self, ns: int, reading: tuple[Reading, Reading], nav: NavSample | None) -> None:
        """Publish all reductions of a reading, the value and its variance; NaN where the reading
        or the navigator's state is missing, or the instrument is stuck, so that the scan is known
        to be empty."""
        sensed, variance = reading
        moves = nav is None or np.linalg.norm(nav.velocity) > MOVES
        repeated = moves and self._is_repeated(sensed)
        for reduction, adapter, publisher in self._outputs:
            value, total, place = math.nan * sensed, variance, None
            if nav is not None and not repeated:
                dated = reduction.dated(to_seconds(ns))
                value = dated.reduce(sensed, nav.sensor)[()]
                total = variance + nav.variance_by(dated)
                place = nav.position[0], nav.position[1]
            publisher.publish(adapter.write_reduced(ns, value, total, place))
        self.health.count("readings")
        self.health.figures["last reading"] = to_seconds(ns)
        self.health.state(OK, "reducing")

    def _is_repeated(self, sensed: Reading) -> bool:
        """Whether a reading, of a vehicle that moves, is the one before it come again and not a
        new one; say so where the instrument is stuck."""
        self._resting.take(np.ravel(sensed).tolist())
        stuck = self._resting.beyond is not None
        text = f"stuck: {self._resting.count + 1} readings of the same value"
        self.health.concern("stuck", text if stuck else None)
        repeated = stuck or self._resting.unusual
        self.health.count("readings repeated", repeated)
        return repeated


def simulated_readings(
    scenario: Scenario, run: int
) -> tuple[dict[int, tuple[int, Reading]], dict[int, Array] | None]:
    """Return by stamp, at which it comes, the own stamp and the raw reading of each scan, and what
    the vector magnetometer of a magnetic vehicle, or of one that is assumed to be, senses at each
    step (None = there is none); the map is not kept.

    Raises
    ------
    InputError
        The map does not cover the route, or the file of coefficients cannot be read.
    """
    truth = scenario.true
    trajectory = build_trajectory(scenario)
    found = ReadingSimulator(truth, trajectory, map_for_scenario(truth, trajectory), [run])
    stamps = [from_seconds(time) for time in trajectory.time]
    own = [from_seconds(time) for time in found.time]
    comes = stamps[truth.steps_per_scan :: truth.steps_per_scan]
    sensed = dict(zip(comes, zip(own, found.raw[0], strict=True), strict=True))
    magnetic = truth.measured_field == "magnetic" and truth.magnetometer.aircraft.magnetic
    if not magnetic and assumed_compensation(scenario) is None:
        return sensed, None
    return sensed, dict(zip(stamps, found.vehicle.vector[0], strict=True))


main = main_of(GravimeterNode, topics.GRAVIMETER)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
