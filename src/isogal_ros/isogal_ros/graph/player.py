"""Fresh nodes that the sensor messages of a recording are played to, past the middleware, step by
step: every sample and reading is dealt with before the next."""

import math
from collections import deque
from collections.abc import Collection, Iterator, Mapping
from functools import partial

from pydantic import JsonValue

from isogal.fusion.inertial_navigator import InertialNavigator
from isogal_ros import topics
from isogal_ros.bags.collect import Collector
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.recorded import Recorded
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import Topic

TICK = 5.0
"""s between looks at the nodes' timers."""


class Player:
    """Nodes on a bus, what is still to be played to them, and what they have said. Its bus has to
    be closed.

    Parameters
    ----------
    recorded : Recorded
        What is played.
    own : mapping
        Own parameters of every node beside those of a replay.
    of_filter : mapping
        Own parameters of the filter's node.
    quiet : bool
        Whether the nodes' warnings and errors are not printed.

    Raises
    ------
    InputError
        A parameter, or the scenario, cannot be used.
    """

    def __init__(
        self,
        recorded: Recorded,
        own: Mapping[str, JsonValue],
        of_filter: Mapping[str, JsonValue],
        quiet: bool = True,
    ) -> None:
        self.recorded, self.bus = recorded, Bus(quiet)
        self.collector = Collector(recorded.scenario)
        self.collector.truth = recorded.collector.truth
        self.collector.unaided = recorded.collector.unaided
        self.reports: list[tuple[float, str]] = []
        """When (s) something was reported at WARN or ERROR, and what."""
        for topic in self.collector.topics():
            if topic not in (topics.TRUTH_FIX, topics.INS_FIX):
                self.bus.hear(topic, partial(self._take, topic))
        self._plan = Plan(recorded.scenario, None, run=recorded.run, real=True)
        names = [
            name
            for name in self._plan.names
            if recorded.reduces or topics.kind_of(name) != topics.GRAVIMETER
        ]
        self._own: dict[str, JsonValue] = {"peers": [*names], **own}
        self._of_filter = of_filter
        self.nodes: dict[str, GraphNode] = {}
        """By name."""
        self._due = deque(recorded.in_order())
        fed = [topic for topic, messages in recorded.sensors.items() if messages]
        self._publish = {topic: self.bus.source(topic) for topic in fed}
        self._ticked = 0.0
        try:
            for name in names:
                self.start(name)
            self.bus.tick()
        except BaseException:
            self.bus.close()
            raise

    def _take(self, topic: Topic, data: bytes) -> None:
        """Keep a serialised message that a node has published."""
        known = len(self.collector.said)
        self.collector.take(topic, data)
        new = self.collector.said[known:]
        self.reports += [(self.bus.now, f"{one.name}: {one.text}") for one in new]

    def start(self, name: str, without: Collection[str] = ()) -> None:
        """Make a node and let it begin, without some of its own parameters."""
        own = {key: value for key, value in self._own.items() if key not in without}
        if name == topics.UKF_FUSION:
            # one that begins later must not take the start for the state of its first sample
            own |= {"start_time": math.nan if self.bus.now == 0.0 else 0.0, **self._of_filter}
        self.nodes[name] = self.bus.add(name, self._plan.values(name) | own)

    @property
    def filter(self) -> InertialNavigator | None:
        """The filter, with its history; None = it has not begun."""
        navigator: InertialNavigator | None = self.nodes[topics.UKF_FUSION].navigator
        return navigator

    def kill(self, name: str) -> None:
        """Take a node off, as if its process had been killed."""
        self.nodes.pop(name).destroy_node()

    def steps(self, until: float = math.inf) -> Iterator[int]:
        """Yield the stamp (ns) of each IMU sample up to a time (s), and then play what the sensors
        say up to it, and let the nodes deal with it."""
        for ns in [ns for ns, topic, _ in self._due if topic is self.recorded.inertial]:
            if to_seconds(ns) > until:
                break
            yield ns
            self.bus.now = to_seconds(ns)
            while self._due and self._due[0][0] <= ns:
                _, topic, data = self._due.popleft()
                self._publish[topic](data)
                self.bus.run()
            if self.bus.now >= self._ticked + TICK:
                self._ticked = self.bus.now
                self.bus.tick()

    def play(self, until: float = math.inf) -> "Player":
        """Play what is still to be played up to a time (s); return itself."""
        for _ in self.steps(until):
            pass
        return self
