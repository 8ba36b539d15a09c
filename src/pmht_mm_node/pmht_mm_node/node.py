"""Map matching: batches of reduced readings in, position fixes out."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any, ClassVar

import numpy as np

from isogal.arrays import Array
from isogal.fields.measured import measured_field, reading_sigma
from isogal.fields.scenario_map import maps_for_scenario
from isogal.maps.channels import ChannelMap, RouteMap
from isogal.maps.field_map import FieldMap
from isogal.maps.several import each_map
from isogal.maps.tiled_map import TiledMap
from isogal.matching.interfaces import Matcher
from isogal.matching.map_matching import MapMatching
from isogal.matching.registry import build_run_matcher
from isogal.scenario import Scenario, validate_scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, adapter_of
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamps import to_ns, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.checkpoint import Checkpoint
from isogal_ros.nodes.nav_queue import NavSample
from isogal_ros.nodes.spin import main_of
from isogal_ros.parameters.values import Values
from pmht_mm_node.outputs import Outputs
from pmht_mm_node.scans import Scans
from pmht_mm_node.verdict import Report


def checkpoint_of(node: GraphNode, field_map: RouteMap, matcher: Matcher) -> Checkpoint:
    """Return the checkpoint of a node with a map; the matcher's package may have dataclasses in
    its memory."""

    def map_of(known: Any) -> Any:
        batch = known["batch"]
        return field_map.near(batch.latitude, batch.longitude)

    packages = {"isogal", type(matcher).__module__.partition(".")[0]}
    maps = FieldMap | ChannelMap | TiledMap
    return Checkpoint(node, lambda value: isinstance(value, maps), map_of, packages)


def warm_up(scenarios: Sequence[Scenario], maps: Sequence[RouteMap]) -> None:
    """Match a made-up batch of each field at the start of the route; the results are thrown
    away."""
    for scenario, field_map in zip(scenarios, maps, strict=True):
        matching, trajectory = MapMatching(scenario, [field_map]), build_trajectory(scenario)
        (builder,) = matching.builders
        reading = np.zeros((1, 1) if builder.expansion is None else builder.expansion.shape)
        for scan in range(1, scenario.matcher.batch_length + 1):
            k = min(scan * scenario.steps_per_scan, len(trajectory))
            place = trajectory.latitude[k], trajectory.longitude[k], trajectory.height[k]
            noise = reading_sigma(scenario) * (-1.0) ** scan
            reading[:, 0] = field_map.value(*place[:2]) + noise
            time = scan * scenario.gravimeter.interval
            matching.add(0, time, np.array(place), trajectory.velocity[k], reading)
        sigma = np.array([100.0, 100.0, 0.1, 0.1, 1e-5, 1e-5, 1e-4])
        matching.match(np.diag(sigma**2))


SAME = 1e-6
"""s, within which two stamps are the same: seconds since 1970 in double precision are good to
2.4e-7."""


class PmhtMmNode(GraphNode):
    """Collects scans with the navigator's state at their stamps; at the end of a batch publishes a
    fix, or says why there is none."""

    sections: ClassVar[Sequence[str]] = (
        "field", "fields", "route", "imu", "gravimeter", "magnetometer", "altimeter",
        "gradiometer", "readings", "gravity", "height", "heights", "gnss", "map", "matcher",
        "fusion",
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
        self._aligned = True
        """Whether the navigator was, at the newest scan."""
        self._report = Report(self)
        each = self.scenario.each_field
        maps = each_map(maps_for_scenario(self.scenario))
        self._matching = MapMatching(self.scenario, maps)
        self._reductions = [measured_field(one).reduction(one) for one in each]
        warm_up(each, maps)
        self.outputs = Outputs(self)
        self.scans = Scans(self, self._first, self._scan)
        its_map = maps[self._matching.lead]
        self._checkpoint = checkpoint_of(self, its_map, self._matching.matcher)
        self.offer_reset(self._reset)
        for field, one in enumerate(each):
            adapter = adapter_of(one)
            self.listen(adapter.reduced, partial(self._take, field, adapter))

    def changed(self, values: Values) -> None:
        """Take new matcher settings from the next batch on; raises InputError where they cannot be
        used."""
        document = self.scenario.model_dump()
        for name, value in values.items():
            section, _, key = name.partition(".")
            document[section][key] = value
        scenario = validate_scenario(document, self.get_name())
        if scenario.matcher != self.scenario.matcher:
            self._matching.use(build_run_matcher(scenario))
            self.scenario = scenario

    def _take(self, field: int, adapter: Adapter, message: topics.Message) -> None:
        self.taken += 1
        ns = to_ns(message.header.stamp)
        self.scans.begin(ns, field)
        try:
            reading, variance = adapter.read_reduced(message)
        except BadMessageError as error:
            self.health.drop(adapter.reduced.name, str(error))
            reading, variance = math.nan, 0.0  # the batch is to know of the scan
        self.scans.add(ns, (reading, variance), field)

    def _first(self, nav: NavSample) -> None:
        """Go on from what an earlier process has left, or begin."""
        saved = self._checkpoint.take(nav.ns)
        if saved is not None:
            collected, self._matching.memory, last = saved.content
            self._matching.restore(collected)
            self.scans.go_on(last)

    def _reset(self) -> str:
        self._checkpoint.forget()
        self._matching.begin_anew()
        self.scans.begin_anew()
        return "begins with the next scan"

    def _scan(
        self, field: int, nav: NavSample, reading: Array | float, variance: Array | float
    ) -> None:
        matching = self._matching
        self.scans.correct(matching, nav.ns)
        matching.builders[field].begin(self.scans.before(nav.ns, field))
        if nav.aligned and not self._aligned:
            matching.forget_scans()
        self._aligned = nav.aligned
        white = self._white(field, nav, variance)
        matching.add(field, to_seconds(nav.ns), nav.position, nav.velocity, reading, white)
        if field == matching.lead and matching.ready:
            self._match(nav)
        if self._checkpoint.is_kept:
            collected = matching.collected
            self._checkpoint.save(nav.ns, (collected, matching.memory, self.scans.last))

    def _white(self, field: int, nav: NavSample, variance: Array | float) -> float:
        """Return the variance of a reading's own noise: that of its message less what the
        navigator's error adds by the reduction, which the batch has of its own; 0 = not known."""
        if isinstance(variance, np.ndarray):
            return 0.0  # of several channels the scenario says it
        own = variance - nav.variance_by(self._reductions[field].dated(to_seconds(nav.ns)))
        return own if own > 0.0 else float(variance)

    def _match(self, nav: NavSample) -> None:
        # of another fix than the last it does not follow on its batch
        passage, ended = nav.passage, self.scans.ended
        if passage is not None and self._matching.memory is not None:
            follows = ended >= 0 and abs(passage.begin - to_seconds(ended)) < SAME
            passage = passage if follows else None
        self.scans.ended = nav.ns
        # the next batch is to use the readings of one whose end is not known
        why = "the navigator said nothing of the batch's end" if self.scans.guessed else None
        if not nav.aligned:
            why = "the navigator is not aligned"
        batch, fix, seconds = self._matching.match(nav.covariance, why, passage)
        self._report.say(nav.ns, fix, seconds)
        self.outputs.publish(nav.ns, batch, fix, nav)


main = main_of(PmhtMmNode, topics.PMHT_MM)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
