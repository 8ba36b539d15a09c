"""Map matching: batches of reduced readings in, position fixes out."""

import math
import time
from collections.abc import Sequence
from typing import Any, ClassVar

from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import map_for_scenario
from isogal.matching.batching import BatchBuilder
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.matching.registry import build_matcher
from isogal.matching.scans import Collected
from isogal_ros import topics
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamps import to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.nav_sample import NavSample
from isogal_ros.nodes.spin import main_of
from isogal_ros.parameters.values import scenario_from
from pmht_mm_node.outputs import Outputs
from pmht_mm_node.report import Report
from pmht_mm_node.scans import Scans
from pmht_mm_node.survival import Survival
from pmht_mm_node.warm_up import warm_up


class PmhtMmNode(GraphNode):
    """Collects scans with the navigator's state at their stamps; at the end of a batch publishes a
    fix, or says why there is none."""

    sections: ClassVar[Sequence[str]] = (
        "field", "route", "imu", "gravimeter", "magnetometer", "altimeter", "gradiometer",
        "height", "map", "matcher", "fusion",
    )  # fmt: skip
    mutable: ClassVar[Sequence[str]] = (
        "matcher.map_sigma",
        "matcher.map_correlation_length",
        "matcher.bias_sigma",
        "matcher.options",
    )

    def setup(self) -> None:
        """Load the map and make publishers and subscriptions."""
        self.taken = 0
        """Readings received, whatever became of them."""
        self._report = Report(self)
        field = measured_field(self.scenario)
        self._channels = field.channels is not None
        self._matcher, self._memory = build_matcher(self.scenario.matcher, self._channels), None
        self._map = map_for_scenario(self.scenario)
        self._builder = BatchBuilder.of(self.scenario, self._matcher.context)
        warm_up(self._matcher, self._map, self.scenario, self._builder.reduction)
        self.outputs = Outputs(self)
        self.scans = Scans(self, self.scenario, self._first, self._scan)
        self._survival = Survival(self, self._map, self._matcher)
        self.offer_reset(self._reset)
        self._adapter = adapter_of(self.scenario)
        self.listen(self._adapter.reduced, self._take)

    def changed(self, values: dict[str, Any]) -> None:
        """Take new matcher settings from the next batch on; raises InputError where they cannot be
        used."""
        document = self.scenario.model_dump()
        for name, value in values.items():
            section, _, key = name.partition(".")
            document[section][key] = value
        scenario = scenario_from(document, self.get_name())
        if scenario.matcher != self.scenario.matcher:
            self._matcher, self._memory = build_matcher(scenario.matcher, self._channels), None
            self.scenario = scenario

    def _take(self, message: Any) -> None:
        self.taken += 1
        ns = to_ns(message.header.stamp)
        self.scans.begin(ns)
        try:
            reading, _ = self._adapter.read_reduced(message)
        except BadMessageError as error:
            self.health.drop(self._adapter.reduced.name, str(error))
            reading = math.nan  # the batch is to know of the scan
        self.scans.add(ns, reading)

    def _first(self, nav: NavSample) -> None:
        """Go on from what an earlier process has left, or begin."""
        kept = self._survival.take(nav.ns)
        if kept is None:
            self._builder.begin(self.scans.before(nav.ns))
        else:
            collected, self._memory, self.scans.last = kept
            self._builder.restore(collected)

    def _reset(self) -> str:
        self._survival.forget()
        self._builder.restore(Collected((), 0, 0))
        self._memory, self.scans.last = None, -1
        return "begins with the next scan"

    def _scan(self, nav: NavSample, reading: Any) -> None:
        self.scans.correct(self._builder, nav.ns)
        latitude, longitude, height = nav.position
        velocity, sigma = nav.velocity[:2], self.scenario.gravimeter.sigma
        self._builder.add_scan(
            to_seconds(nav.ns), latitude, longitude, velocity, reading, sigma, height=height
        )
        if self._builder.ready:
            self._match(nav)
        self._survival.keep(nav.ns, self._builder.collected, self._memory)

    def _match(self, nav: NavSample) -> None:
        collected = self._builder.collected
        batch = self._builder.build(nav.covariance)
        begun = time.perf_counter()
        if self.scans.guessed:
            fix = declined(batch, "the navigator said nothing of the batch's end")
            self._builder.restore(collected)  # the next batch is to use its readings
        else:
            fix = self._fix_of(batch)
        seconds = time.perf_counter() - begun
        self._report.say(nav.ns, fix, seconds)
        self.outputs.publish(nav.ns, batch, fix, nav)

    def _fix_of(self, batch: Batch) -> Fix:
        if not self._builder.whole:
            return declined(batch, f"the first batch is not whole: it has {len(batch)} scans")
        try:
            near = self._map.near(batch.latitude, batch.longitude)
            fix, self._memory = self._matcher.match(batch, near, self._memory)
        except Exception as error:
            reason = f"the matcher failed: {type(error).__name__}: {error}"
            self.get_logger().error(reason)
            fix, self._memory = declined(batch, reason), None
        return fix


main = main_of(PmhtMmNode, topics.PMHT_MM)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
