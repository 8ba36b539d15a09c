"""What a trial is played on: what the sensors of a run measured, and the nodes that use it."""

import math
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.plan import GraphError, Plan, node_class
from isogal_ros.graph.recorded import AIDS
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.stamps import peek_ns, to_seconds
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.parameters.values import node_values

NODES = (topics.GRAVIMETER, topics.PMHT_MM, topics.UKF_FUSION)
"""Those that are played to."""
IDLE = 1000
"""Rounds of timers without a step after which a run does not come to its end."""
TICK = 5.0
"""s between looks at the wall clock; of diagnostics without news half as many are needed."""


@dataclass(frozen=True)
class Feed:
    """What the sensors of a run measured, serialised, by stamp (ns)."""

    scenario: Scenario
    run: int
    sensors: dict[str, dict[int, bytes]]
    """By topic, in the order in which those of one stamp are played."""
    truth: dict[int, bytes]

    @classmethod
    def of(cls, scenario: Scenario, run: int, interrupt: Interrupt | None = None) -> "Feed":
        """Simulate a run of a scenario, by the nodes themselves, to its end or an interrupt.

        Raises
        ------
        InputError
            The scenario cannot be used.
        GraphError
            The run does not come to its end.
        """
        bus, plan = Bus(), Plan(scenario, None, run=run)
        kept: dict[str, dict[int, bytes]] = {}
        for topic in (*AIDS, topics.IMU, *raw_topics(scenario), topics.TRUTH_FIX):
            bus.hear(topic, _keeper(kept.setdefault(topic.name, {})))
        nodes = {name: bus.add(name, plan.values(name)) for name in plan.names}
        simulator, step, idle = nodes[topics.INS_SIM], -1, 0
        while not (interrupt or simulator.finished):
            bus.tick()
            idle = idle + 1 if simulator.step == step else 0
            step = simulator.step
            if idle > IDLE:
                raise GraphError(f"run {run} does not go on after step {step}")
        if simulator.exit_code:
            raise GraphError(f"{topics.INS_SIM}: {simulator.failure}")
        truth = kept.pop(topics.TRUTH_FIX.name)
        return cls(scenario, run, {name: store for name, store in kept.items() if store}, truth)


def raw_topics(scenario: Scenario) -> tuple[topics.Topic, ...]:
    """Return the topics of an instrument's own readings."""
    raw = adapter_of(scenario).raw
    return (topics.SCALAR_FIELD, raw) if raw is topics.MAGNETIC_FIELD else (raw,)


def _keeper(store: dict[int, bytes]) -> Any:
    def keep(data: bytes) -> None:
        store[peek_ns(data)] = data

    return keep


class Stage:
    """Fresh nodes on a bus, and what they say.

    Parameters
    ----------
    feed : Feed
        What is played to them.
    checkpoints : path, optional
        Folder of their checkpoints; None = they write none.
    """

    def __init__(self, feed: Feed, checkpoints: Path | None = None) -> None:
        self.feed, self.checkpoints = feed, checkpoints
        self.bus = Bus()
        self.collector = Collector(feed.scenario)
        self.collector.truth = feed.truth
        self.heard: list[tuple[float, str]] = []
        """When (s) something was said at WARN or ERROR, and what."""
        for topic in self.collector.topics():
            if topic not in (topics.TRUTH_FIX, topics.INS_FIX):
                self.bus.hear(topic, self._taker(topic))
        self.nodes: dict[str, Any] = {}
        for name in NODES:
            self.start(name)
        self._due = {name: deque(sorted(store.items())) for name, store in feed.sensors.items()}
        self._ticked = 0.0
        self.bus.tick()

    def _taker(self, topic: topics.Topic) -> Any:
        def take(data: bytes) -> None:
            known = len(self.collector.warnings)
            self.collector.take(topic, data)
            new = self.collector.warnings[known:]
            self.heard.extend((self.bus.now, text) for _, text in new)

        return take

    def start(self, name: str, checkpoint: bool = True) -> None:
        """Make a node and let it begin, with or without what one before it has left."""
        own: dict[str, Any] = {"run": self.feed.run, "peers": list(NODES)}
        own["diagnostics_period"] = 2.0 * TICK
        if self.checkpoints is not None and checkpoint:
            own["checkpoint"] = str(self.checkpoints)
        if name == topics.UKF_FUSION:
            own["start_time"] = math.nan if self.bus.now == 0.0 else 0.0
        if name == topics.GRAVIMETER:
            own["simulate"] = False
        values = node_values(self.feed.scenario, own, node_class(name).sections)
        self.nodes[name] = self.bus.add(name, values)

    def kill(self, name: str) -> None:
        """Take a node off, as if its process had been killed."""
        self.bus.remove(self.nodes.pop(name))

    def play(self, ns: int) -> None:
        """Play what the sensors say up to a stamp (ns), and let the nodes deal with it."""
        self.bus.now = to_seconds(ns)
        for name, messages in self._due.items():
            while messages and messages[0][0] <= ns:
                self.bus.send(name, messages.popleft()[1])
                self.bus.run()
        if self.bus.now >= self._ticked + TICK:
            self._ticked = self.bus.now
            self.bus.tick()

    @property
    def duration(self) -> float:
        """s of the run."""
        return to_seconds(max(self.feed.truth))

    @property
    def two_batches(self) -> float:
        """s that two batches take, at most."""
        scenario = self.feed.scenario
        return 2.0 * scenario.matcher.batch_length * scenario.gravimeter.interval

    def stamps(self) -> list[int]:
        """Return the stamps (ns) of what is still to be played."""
        return [ns for ns, _ in self._due[topics.IMU.name]]
