"""Feeding recorded sensor messages to a fresh matcher and filter, step by step."""

import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from rclpy.context import Context
from rosgraph_msgs.msg import Clock

from isogal.earth.frames import horizontal_difference
from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader, topic_of
from isogal_ros.graph.domain import claim_domain
from isogal_ros.graph.plan import GraphError, node_class
from isogal_ros.messages.stamps import peek_ns, set_stamp, to_seconds
from isogal_ros.nodes.base import GraphNode, graph_values
from isogal_ros.nodes.spin import Interrupt, drain, local_context, make_executor

FEEDER = "isogal_replay"
NODES = (topics.PMHT_MM, topics.UKF_FUSION)
ANSWERS = (
    topics.NAV_FIX, topics.NAV_ODOM, topics.NAV_COVARIANCE, topics.NAV_PATH, topics.FIX, topics.INFORMATION, topics.CANDIDATES,
    topics.DIAGNOSTICS,
)  # fmt: skip
PATIENCE = 120.0
"""s of wall time that a step may take."""


@dataclass(frozen=True)
class Comparison:
    """How a replay's fixes differ from the recorded ones."""

    recorded: int
    """Fixes recorded, without those that say there is none."""
    replayed: int
    common: int
    """Stamps at which both gave a fix."""
    disagreements: int
    """Stamps at which one gave a fix and the other said there is none, or one said nothing."""
    largest_difference: float
    """m, between fixes of the same stamp; 0 where there is none in common."""


@dataclass(frozen=True)
class Replay:
    """What a replay leaves behind."""

    scenario: Scenario
    outputs: Collector
    """Messages of the fresh nodes, with the recorded truth."""
    comparison: Comparison
    simulated: float
    """s replayed."""
    wall_seconds: float
    notes: list[str]
    """What was missing, or cut off."""
    interrupted: bool


class _Feeder(GraphNode):
    """Publishes the recorded messages and hears all that the nodes answer."""

    sections: ClassVar[Collection[str]] = ("field", "gravimeter", "gradiometer")

    def setup(self) -> None:
        self.collector = Collector(self.scenario)
        self.heard = 0
        self._clock_out, self._imu = self.advertise(topics.CLOCK), self.advertise(topics.IMU)
        self._readings = self.advertise(
            topics.readings(self.scenario.measured_field), consumers=(topics.PMHT_MM,)
        )
        for topic in ANSWERS:
            self.listen(topic, self._keep(topic), raw=True)

    def _keep(self, topic: topics.Topic) -> Callable[[bytes], None]:
        def keep(data: bytes) -> None:
            self.heard += 1
            self.collector.take(topic, data)

        return keep

    def received(self) -> int:
        """Count the answers."""
        return self.heard

    def imu(self, ns: int, data: bytes) -> None:
        """Publish the clock and an IMU sample."""
        clock = Clock()
        set_stamp(clock.clock, ns)
        self._clock_out.publish(clock)
        self._imu.publish(data)

    def reading(self, data: bytes) -> None:
        """Publish a reduced reading."""
        self._readings.publish(data)


@dataclass
class _Recorded:
    imu: dict[int, bytes]
    readings: dict[int, bytes]
    collector: Collector


def replay(
    reader: BagReader, interrupt: Interrupt, report: Callable[[float, float], None]
) -> Replay:
    """Replay a bag as fast as the nodes can, in lock-step.

    Parameters
    ----------
    report : callable
        Called now and then with the simulated time and the duration, s.

    Raises
    ------
    InputError
        The bag lacks a topic that is needed, or its scenario cannot be used.
    GraphError
        A node did not answer.
    """
    notes = []
    scenario = reader.scenario()
    if scenario is None:
        scenario = Scenario()
        notes.append("the bag has no scenario; the default one is assumed")
    recorded = _load(reader, scenario)
    if reader.cut is not None:
        last = max(recorded.imu, default=0)
        notes.append(f"the bag is cut off: {reader.cut}; read up to {to_seconds(last):.0f} s")
    begun = time.monotonic()
    with claim_domain() as domain, local_context(domain) as context:
        feeder, answered = _run(
            recorded, scenario, int(reader.texts.get("run", 0)), context, interrupt, report
        )
    outputs = feeder.collector
    outputs.truth, outputs.unaided, outputs.readings = (
        recorded.collector.truth,
        recorded.collector.unaided,
        recorded.readings,
    )
    return Replay(
        scenario,
        outputs,
        compare(recorded.collector, outputs, answered),
        to_seconds(answered - min(recorded.imu)) if answered else 0.0,
        time.monotonic() - begun,
        notes,
        bool(interrupt),
    )


def _load(reader: BagReader, scenario: Scenario) -> _Recorded:
    topic = topics.readings(scenario.measured_field)
    collector = Collector(scenario)
    imu: dict[int, bytes] = {}
    wanted = (topics.IMU, *collector.topics())
    known: dict[str, Any] = {}
    for message in reader.messages():
        if message.topic not in known:
            known[message.topic] = next(
                (item for item in wanted if topic_of(message.topic, item.name)), None
            )
        found = known[message.topic]
        if found is topics.IMU:
            imu[peek_ns(message.data)] = message.data
        elif found is not None:
            collector.take(found, message.data)
    missing = [
        name
        for name, store in ((topics.IMU.name, imu), (topic.name, collector.readings))
        if not store
    ]
    if missing:
        there = ", ".join(sorted(reader.types)) or "nothing"
        cut = f"; {reader.cut}" if reader.cut else ""
        raise InputError(
            f"{reader.path}: no messages on {' and '.join(missing)}, which a replay needs; the bag"
            f" has {there}{cut}"
        )
    return _Recorded(imu, collector.readings, collector)


def _run(
    recorded: _Recorded,
    scenario: Scenario,
    run: int,
    context: Context,
    interrupt: Interrupt,
    report: Callable[[float, float], None],
) -> tuple[_Feeder, int]:
    executor = make_executor(context)
    nodes: dict[str, Any] = {}
    # the feeder hears everything, as a recorder does
    own = {"run": run, "recorders": 1, "peers": list(NODES)}
    try:
        for name in NODES:
            nodes[name] = node_class(name)(
                name,
                values=graph_values(scenario, own, node_class(name).sections),
                context=context,
            )
        values = graph_values(scenario, own | {"recorders": 0}, _Feeder.sections)
        feeder = nodes[FEEDER] = _Feeder(FEEDER, values=values, context=context)
        for node in nodes.values():
            executor.add_node(node)
        answered = _Steps(recorded, nodes, executor).run(interrupt, report)
        drain(feeder, executor)
        return feeder, answered
    finally:
        for node in nodes.values():
            executor.remove_node(node)
            node.destroy_node()


class _Steps:
    """The lock-step: every IMU sample is answered before the next, every reading before what
    follows it."""

    def __init__(self, recorded: _Recorded, nodes: dict[str, Any], executor: Any) -> None:
        self.recorded, self.executor = recorded, executor
        self.matcher, self.filter, self.feeder = (
            nodes[topics.PMHT_MM],
            nodes[topics.UKF_FUSION],
            nodes[FEEDER],
        )

    def run(self, interrupt: Interrupt, report: Callable[[float, float], None]) -> int:
        """Play all; return the last stamp (ns) that was answered, 0 = none."""
        stamps, readings = sorted(self.recorded.imu), sorted(self.recorded.readings)
        self._wait(
            lambda: self.matcher.ready and self.filter.ready and self.feeder.ready,
            "the nodes to find each other",
        )
        played = answered = 0
        told = time.monotonic()
        for samples, ns in enumerate(stamps, start=1):
            if interrupt:
                break
            self.feeder.imu(ns, self.recorded.imu[ns])
            self._wait(
                lambda: self.filter.samples >= samples,
                f"the filter's answer at {to_seconds(ns):.3f} s",
            )  # noqa: B023
            while played < len(readings) and readings[played] <= ns:
                self.feeder.reading(self.recorded.readings[readings[played]])
                played += 1
                self._wait(
                    lambda: self._settled(played),
                    f"the matcher's answer at {to_seconds(ns):.3f} s",
                )  # noqa: B023
            answered = ns
            if (now := time.monotonic()) - told > 0.2:
                told = now
                report(to_seconds(ns - stamps[0]), to_seconds(stamps[-1] - stamps[0]))
        return answered

    def _settled(self, readings: int) -> bool:
        """Whether all readings are dealt with, and all fixes that came of them."""
        done = self.matcher.taken >= readings and not self.matcher.scans.waiting
        return bool(done and self.filter.answered >= self.matcher.outputs.fixes)

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            self.executor.spin_once(timeout_sec=0.05)
            if time.monotonic() > deadline:
                raise GraphError(f"replay: waited {PATIENCE:g} s for {what}")


def compare(recorded: Collector, replayed: Collector, last_ns: int) -> Comparison:
    """Compare the fixes up to a stamp."""
    old = {ns: fix for ns, fix in recorded.fix_positions().items() if ns <= last_ns}
    new = replayed.fix_positions()
    both = [(old[ns], new[ns]) for ns in old if old[ns] is not None and new.get(ns) is not None]
    differences = [
        float(np.hypot(*horizontal_difference(*b, *a)))
        for a, b in both
        if a is not None and b is not None
    ]
    fixes_old = sum(fix is not None for fix in old.values())
    fixes_new = sum(fix is not None for fix in new.values())
    return Comparison(
        recorded=fixes_old,
        replayed=fixes_new,
        common=len(both),
        disagreements=sum((old.get(ns) is None) != (new.get(ns) is None) for ns in {*old, *new}),
        largest_difference=max(differences, default=0.0),
    )
