"""Feeding recorded sensor messages to a fresh matcher and filter, step by step."""

import math
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from rclpy.context import Context
from rosgraph_msgs.msg import Clock

from isogal.errors import InputError
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader
from isogal_ros.graph.comparison import Comparison, compare
from isogal_ros.graph.domain import graph_domain, local_context, names_of
from isogal_ros.graph.plan import GraphError, instruments_of, node_class
from isogal_ros.graph.progress import Progress, Report, ReportTimer
from isogal_ros.graph.recorded import AIDS, LATE, Recorded, load
from isogal_ros.graph.usage import Fed, shortcomings
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.stamps import set_stamp, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.nodes.spin import drain, make_executor
from isogal_ros.parameters.values import node_values

FEEDER = "isogal_replay"
NODES = (topics.PMHT_MM, topics.UKF_FUSION)
ANSWERS = (
    topics.NAV_FIX,
    topics.NAV_ODOM,
    topics.NAV_COVARIANCE,
    topics.NAV_PATH,
    topics.PROTECTION_LEVEL,
    topics.FIX,
    topics.INFORMATION,
    topics.POSE,
    *topics.TRANSFORMS,
    topics.CANDIDATES,
    topics.DIAGNOSTICS,
)
PATIENCE = 120.0
"""s of wall time that a step may take."""


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
    failures: list[str]
    """Why the replay shows nothing: sensors of which no message was used, and that there was no
    fix; empty where it was interrupted."""
    interrupted: bool


def replay(
    reader: BagReader,
    interrupt: Interrupt,
    report: Report,
    scenario: Scenario | None = None,
    parameters: Mapping[str, Any] | None = None,
    domain: int | None = None,
) -> Replay:
    """Replay a bag as fast as the nodes can, in lock-step.

    Parameters
    ----------
    scenario : Scenario, optional
        None = the bag's own. With another one the instrument's own readings are reduced anew
        where the bag has them.
    parameters : mapping, optional
        Own parameters of the filter's node by name (`isogal_ros.graph.filter_parameters`).
    domain : int, optional
        ROS domain that must be used; see `graph_domain`.

    Raises
    ------
    InputError
        The bag lacks a topic that is needed, or a scenario, or its scenario cannot be used; or
        the domain cannot.
    GraphError
        A node did not answer.
    """
    scenario = scenario or reader.scenario()
    if scenario is None:
        raise InputError(
            f"{reader.path}: the bag has no scenario (another tool has written it?); say with"
            " --scenario which one was run"
        )
    recorded = load(reader, scenario, changed=bool(parameters))
    notes = _notes(reader, recorded)
    begun = time.monotonic()
    with (
        graph_domain(names_of(scenario), domain) as number,
        local_context(number) as context,
    ):
        outputs, fed = _run(recorded, context, interrupt, report, parameters or {})
    answered = fed.answered
    outputs.truth, outputs.unaided = recorded.collector.truth, recorded.collector.unaided
    outputs.readings, outputs.others = recorded.collector.readings, recorded.collector.others
    return Replay(
        scenario,
        outputs,
        compare(recorded.collector, outputs, answered),
        to_seconds(answered - min(recorded.imu)) if answered else 0.0,
        time.monotonic() - begun,
        notes,
        [] if interrupt else shortcomings(recorded, fed, outputs),
        bool(interrupt),
    )


def _notes(reader: BagReader, recorded: Recorded) -> list[str]:
    """Say what is missing, and what the replay does about it."""
    notes = []
    if reader.cut is not None:
        last = max(recorded.imu, default=0)
        notes.append(
            f"the bag is not read to its end: {reader.cut}; read up to {to_seconds(last):.0f} s"
        )
    if recorded.first > LATE:
        how = (
            "as the scenario says for its start, which is true only where the vehicle did not move"
            " before"
            if recorded.start is None
            else "where the recorded navigator was"
        )
        notes.append(f"the bag begins at {recorded.first:.0f} s: the filter starts there {how}")
    if recorded.of_another:
        notes.append(
            "the gravimeter's own readings are not all in the bag: those that are fed were reduced"
            " with the recorded navigator's velocity, and are wrong by the Eötvös effect of what"
            " the replayed one differs from it"
        )
    return notes


def _run(
    recorded: Recorded,
    context: Context,
    interrupt: Interrupt,
    report: Report,
    parameters: Mapping[str, Any],
) -> tuple[Collector, Fed]:
    """Return the fresh nodes' messages, and what they were fed and dropped."""
    executor = make_executor(context)
    nodes: dict[str, Any] = {}
    sensors = instruments_of(recorded.scenario) if recorded.reduces else {}
    # the feeder hears everything, as a recorder does
    own = {"run": recorded.run, "recorders": 1, "peers": [*NODES, *sensors]}
    start = {"start_time": math.nan, **_start(recorded), **parameters}
    told = dict.fromkeys(NODES, (recorded.scenario, own))
    told[topics.UKF_FUSION] = recorded.scenario, own | start
    for name, scenario in sensors.items():
        told[name] = scenario, own | {"simulate": False, "recorders": 0}
    try:
        for name, (scenario, of_node) in told.items():
            kind = node_class(name)
            values = node_values(scenario, of_node, kind.sections)
            nodes[name] = kind(name, values=values, context=context)
        # an instrument's own readings have one listener, however many instruments there are
        heard = own | {"recorders": 0, "peers": [*NODES, *list(sensors)[:1]]}
        values = node_values(recorded.scenario, heard, _Feeder.sections)
        feeder = nodes[FEEDER] = _Feeder(FEEDER, values=values, context=context)
        feeder.advertise_sensors(
            [topic for topic in AIDS if recorded.aids[topic]], recorded.reduces
        )
        for node in nodes.values():
            executor.add_node(node)
        steps = _LockStep(recorded, nodes, tuple(sensors), executor)
        answered = steps.run(interrupt, report)
        drain(feeder, executor)
        return feeder.collector, Fed.to(nodes, answered, steps.played)
    finally:
        executor.shutdown()  # or it would keep the nodes' publishers
        for node in nodes.values():
            node.destroy_node()


def _start(recorded: Recorded) -> dict[str, Any]:
    """Return parameters of the filter's start: a simulated run that is recorded from its start on
    has the scenario's."""
    simulated = bool(recorded.collector.truth)
    if simulated and recorded.first <= LATE:
        return {}
    return dict(recorded.start or {})


class _Feeder(GraphNode):
    """Publishes the recorded messages and hears all that the nodes answer."""

    sections: ClassVar[Collection[str]] = (
        "field", "fields", "imu", "gravimeter", "magnetometer", "altimeter", "gradiometer",
    )  # fmt: skip

    def setup(self) -> None:
        self.collector = Collector(self.scenario)
        self.heard = 0
        self._clock_out, self._imu = self.advertise(topics.CLOCK), self.advertise(topics.IMU)
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

    def advertise_sensors(self, aids: Collection[topics.Topic], raw: bool) -> None:
        """Make publishers of the aids that were recorded and of raw or reduced readings."""
        self._aids = {topic: self.advertise(topic) for topic in aids}
        each = [adapter_of(one) for one in self.scenario.each_field]
        fed = [one.raw if raw else one.reduced for one in each]
        consumer = topics.GRAVIMETER if raw else topics.PMHT_MM
        self._readings = {topic: self.advertise(topic, (consumer,)) for topic in fed}

    def aid(self, topic: topics.Topic, data: bytes) -> None:
        """Publish a reading of a height or velocity sensor."""
        self._aids[topic].publish(data)

    def imu(self, ns: int, data: bytes) -> None:
        """Publish the clock and an IMU sample."""
        clock = Clock()
        set_stamp(clock.clock, ns)
        self._clock_out.publish(clock)
        self._imu.publish(data)

    def reading(self, topic: topics.Topic, data: bytes) -> None:
        """Publish a reading."""
        self._readings[topic].publish(data)


class _LockStep:
    """Every IMU sample is answered before the next, every reading before what follows it."""

    def __init__(
        self,
        recorded: Recorded,
        nodes: dict[str, Any],
        sensors: tuple[str, ...],
        executor: Any,
    ) -> None:
        self._sensors = [nodes[name] for name in sensors]
        self._imu = recorded.imu
        self._readings = recorded.readings()
        self._aids = [
            (topic, deque(sorted(readings.items()))) for topic, readings in recorded.aids.items()
        ]
        self._executor = executor
        self._nodes = nodes.values()
        self._matcher, self._filter = nodes[topics.PMHT_MM], nodes[topics.UKF_FUSION]
        self._feeder = nodes[FEEDER]
        self._samples = self.played = 0
        """IMU samples and readings published so far."""

    def run(self, interrupt: Interrupt, report: Report) -> int:
        """Play all; return the last stamp (ns) that was answered, 0 = none."""
        stamps, readings = sorted(self._imu), self._readings
        self._wait(self._ready, "the nodes to find each other")
        answered, begun, timer = 0, time.monotonic(), ReportTimer()
        duration = to_seconds(stamps[-1] - stamps[0])
        for ns in stamps:
            if interrupt:
                break
            self._play_sample(ns)
            while self.played < len(readings) and readings[self.played][0] <= ns:
                self._play_reading(*readings[self.played], ns)
            answered = ns
            if timer.due():
                simulated = to_seconds(ns - stamps[0])
                speed = simulated / (time.monotonic() - begun)
                report(Progress(simulated, duration, speed, float("nan")))
        return answered

    def _play_sample(self, ns: int) -> None:
        for topic, readings in self._aids:
            while readings and readings[0][0] <= ns:
                self._feeder.aid(topic, readings.popleft()[1])
        self._feeder.imu(ns, self._imu[ns])
        self._samples += 1
        self._wait(self._advanced, f"the filter's answer at {to_seconds(ns):.3f} s")

    def _play_reading(self, ns: int, topic: topics.Topic, reading: bytes, now: int) -> None:
        self._feeder.reading(topic, reading)
        self.played += 1
        if ns > self._filter.outputs.reached:
            return  # the filter has dropped its samples, so that nobody can answer this one now
        self._wait(self._settled, f"the matcher's answer at {to_seconds(now):.3f} s")

    def _ready(self) -> bool:
        return all(node.ready for node in self._nodes)

    def _advanced(self) -> bool:
        """Whether the filter has answered all samples."""
        return bool(self._filter.samples >= self._samples)

    def _settled(self) -> bool:
        """Whether all readings are dealt with, and all fixes that came of them."""
        given = self.played - sum(sensor.unused for sensor in self._sensors)
        done = self._matcher.taken >= given and not self._matcher.scans.waiting
        return bool(done and self._filter.answered >= self._matcher.outputs.fixes)

    def _wait(self, condition: Callable[[], bool], what: str) -> None:
        deadline = time.monotonic() + PATIENCE
        while not condition():
            self._executor.spin_once(timeout_sec=0.05)
            if time.monotonic() > deadline:
                raise GraphError(f"replay: waited {PATIENCE:g} s for {what}")
