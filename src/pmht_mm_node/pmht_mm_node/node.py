"""Map matching: batches of reduced readings in, position fixes out."""

import math
import time
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar

from isogal.errors import InputError
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.several import each_map
from isogal.matching.failures import match_or_decline
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.matching.joint_batches import JointBatches
from isogal.matching.registry import build_run_matcher
from isogal.matching.scans import Collected
from isogal.matching.several import Rhythm
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, adapter_of
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
        "field", "fields", "route", "imu", "gravimeter", "magnetometer", "altimeter",
        "gradiometer", "gravity", "height", "map", "matcher", "fusion",
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
        self._each = self.scenario.each_field
        self._lead = Rhythm.of(self._each).lead
        self._matcher, self._memory = build_run_matcher(self.scenario), None
        self._maps = each_map(maps_for_scenario(self.scenario))
        self._batches = JointBatches.of(self.scenario, self._matcher)
        warm_up(self._each, self._maps)
        self.outputs = Outputs(self)
        self.scans = Scans(self, self.scenario, self._first, self._scan)
        self._survival = Survival(self, self._maps[self._lead], self._matcher)
        self.offer_reset(self._reset)
        for field, one in enumerate(self._each):
            adapter = adapter_of(one)
            self.listen(adapter.reduced, partial(self._take, field, adapter))

    def changed(self, values: dict[str, Any]) -> None:
        """Take new matcher settings from the next batch on; raises InputError where they cannot be
        used."""
        document = self.scenario.model_dump()
        for name, value in values.items():
            section, _, key = name.partition(".")
            document[section][key] = value
        scenario = scenario_from(document, self.get_name())
        if scenario.matcher != self.scenario.matcher:
            self._matcher, self._memory = build_run_matcher(scenario), None
            self.scenario = scenario

    def _take(self, field: int, adapter: Adapter, message: Any) -> None:
        self.taken += 1
        ns = to_ns(message.header.stamp)
        self.scans.begin(ns, field)
        try:
            reading, _ = adapter.read_reduced(message)
        except BadMessageError as error:
            self.health.drop(adapter.reduced.name, str(error))
            reading = math.nan  # the batch is to know of the scan
        self.scans.add(ns, reading, field)

    def _first(self, nav: NavSample) -> None:
        """Go on from what an earlier process has left, or begin."""
        kept = self._survival.take(nav.ns)
        if kept is not None:
            collected, self._memory, last = kept
            self._batches.restore(collected)
            self.scans.go_on(last)

    def _reset(self) -> str:
        self._survival.forget()
        self._batches.restore([Collected((), 0, 0)] * len(self._each))
        self._memory = None
        self.scans.go_on([-1] * len(self._each))
        return "begins with the next scan"

    def _scan(self, field: int, nav: NavSample, reading: Any) -> None:
        self.scans.correct(self._batches, nav.ns)
        latitude, longitude, height = nav.position
        velocity, sigma = nav.velocity[:2], self._each[field].gravimeter.sigma
        place = to_seconds(nav.ns), latitude, longitude, velocity
        builder = self._batches.builders[field]
        builder.begin(self.scans.before(nav.ns, field))
        builder.add_scan(*place, reading, sigma, height=height)
        if field == self._lead and self._batches.ready:
            self._match(nav)
        self._survival.keep(nav.ns, self._batches.collected, self._memory, self.scans.last)

    def _near(self, field: int, batch: Batch) -> Any:
        return self._maps[field].near(batch.latitude, batch.longitude)

    def _match(self, nav: NavSample) -> None:
        self.scans.ended = nav.ns
        collected = self._batches.collected
        batch = self._batches.build(nav.covariance, self._near)
        begun = time.perf_counter()
        if self.scans.guessed:
            fix = declined(batch, "the navigator said nothing of the batch's end")
            self._batches.restore(collected)  # the next batch is to use its readings
        else:
            fix = self._fix_of(batch)
        self._report.say(nav.ns, fix, time.perf_counter() - begun)
        self.outputs.publish(nav.ns, batch, fix, nav)

    def _fix_of(self, batch: Batch) -> Fix:
        if not self._batches.whole:
            return declined(batch, f"the first batch is not whole: it has {len(batch)} scans")
        try:
            near = self._near(self._lead, batch)
        except InputError as error:
            return declined(batch, f"no map around the batch: {error}")
        fix, self._memory = match_or_decline(self._matcher, batch, near, self._memory)
        self._batches.learn(fix)
        return fix


main = main_of(PmhtMmNode, topics.PMHT_MM)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
