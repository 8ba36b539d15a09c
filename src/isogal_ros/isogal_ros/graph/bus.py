"""Nodes of a graph in one process, whose messages do not go over the middleware: what one
publishes is handed to the callbacks of the others, serialised, in the order it was published.

They are nodes of rclpy; what `Publishing` and `Listening` would hand to rclpy, they hand to the
bus. In a domain of their own nobody spins them, and their time is that of the data: a graph takes
as long as its callbacks, and the same messages give the same answers. Replays, the fault campaign,
the policy and tests of single nodes are made of it. In a domain that is given (`isogal run
--in-process`) others hear what they publish and call their services as ever, by an executor."""

import math
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack

from pydantic import JsonValue
from rclpy.context import Context
from rclpy.service import Service

from isogal.errors import InputError
from isogal_ros.graph.domain import free_domains, local_context
from isogal_ros.graph.plan import node_class
from isogal_ros.messages.prepared import serialised
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.listening import Listening
from isogal_ros.topics import Message, Topic

Change = Callable[[str, bytes], list[bytes]]
"""Turns a serialised message on a topic, by its name, into those that come instead."""


class Bus(Context):
    """The context of some nodes, which carries their messages. It has to be closed.

    Parameters
    ----------
    quiet : bool
        Whether what they log is not printed.
    domain : int, optional
        Where others may hear them, by the wall clock; None = nobody does, by that of the data.
    """

    def __init__(self, quiet: bool = True, domain: int | None = None) -> None:
        super().__init__()
        self.quiet, self.now, self.alone = quiet, 0.0, domain is None
        """`now`, s, is what nodes that are alone take for the wall clock."""
        self.change: Change | None = None
        """What becomes of messages on their way."""
        self.errors: list[str] = []
        """What the nodes have logged as errors."""
        self.nodes: list[GraphNode] = []
        self.is_open = False
        """Whether nodes hear others where no node on the bus publishes."""
        self._sources: Counter[str] = Counter()
        self._taps: defaultdict[str, list[Callable[[bytes], None]]] = defaultdict(list)
        self._listening: defaultdict[str, list[Listening]] = defaultdict(list)
        self._queue: deque[tuple[str, bytes]] = deque()
        self._held: dict[GraphNode, list[tuple[Listening, bytes]]] = {}
        """What nodes that are stopped have yet to take."""
        self._stack = ExitStack()
        domain = next(free_domains(self._stack), None) if domain is None else domain
        if domain is None:
            raise InputError("no free ROS domain for the nodes of this process")
        self._stack.enter_context(local_context(domain, self))

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Destroy the nodes, and end."""
        for node in tuple(self.nodes):
            node.destroy_node()
        self._stack.close()

    @property
    def bus(self) -> "Bus":
        """Itself, by which a node sees that its context is one."""
        return self

    def add(self, name: str, values: Mapping[str, JsonValue]) -> GraphNode:
        """Return a node of the graph on the bus, active; raises InputError where a parameter is
        bad."""
        node = node_class(name)(name, values=values, context=self)
        self.nodes.append(node)
        return node

    def open(self) -> None:
        """Let nodes hear others where no node on the bus publishes."""
        self.is_open = True
        for name, each in self._listening.items():
            if not self.publishers(name):
                for one in each:
                    one.open()

    def look(self) -> None:
        """See to whom others listen."""
        for node in self.nodes:
            for publishing in node.publishing:
                publishing.look()

    def stop(self, node: GraphNode) -> None:
        """Let a node take nothing until `go`; what comes meanwhile waits."""
        self._held[node] = []

    def go(self, node: GraphNode) -> None:
        """Let a node take what has waited, and go on."""
        for listening, data in self._held.pop(node):
            listening.deliver(data)
        self.run()

    def source(self, topic: Topic) -> Callable[[Message], None]:
        """Return what publishes on a topic, as a publisher that belongs to no node."""
        self._sources[topic.name] += 1
        return lambda message: self.send(topic.name, message)

    def join(self, listening: Listening) -> None:
        """Hand a node what is published on a topic."""
        self._listening[listening.topic.name].append(listening)

    def silence(self, node: GraphNode) -> None:
        """Hand a node nothing any more."""
        for each in self._listening.values():
            each[:] = [one for one in each if one.node is not node]

    def leave(self, node: GraphNode) -> None:
        """Let a node go that is being destroyed."""
        self.silence(node)
        if node in self.nodes:
            self.nodes.remove(node)

    def hear(self, topic: Topic, take: Callable[[bytes], None]) -> None:
        """Call `take` with every serialised message of a topic, as it was published."""
        self._taps[topic.name].append(take)

    def send(self, name: str, message: Message) -> None:
        """Publish a message, serialised or not, on a topic; `run` delivers it."""
        if self.count(name):
            data = serialised(message)
            for take in self._taps[name]:
                take(data)
            if self.change is None:
                self._queue.append((name, data))
            else:
                self._queue.extend((name, item) for item in self.change(name, data))

    def count(self, name: str) -> int:
        """Count those on the bus who listen to a topic."""
        return len(self._taps[name]) + len(self._listening[name])

    def publishers(self, name: str) -> int:
        """Count those on the bus who publish on a topic."""
        every = (one for node in self.nodes for one in node.publishing)
        return self._sources[name] + sum(one.topic.name == name for one in every)

    def run(self, most: float = math.inf) -> bool:
        """Deliver what was published, and what is published because of it, so many messages at
        most; return whether there was any."""
        delivered = 0
        while self._queue and delivered < most:
            delivered += 1
            name, data = self._queue.popleft()
            for listening in tuple(self._listening[name]):
                if self._held and listening.node in self._held:
                    self._held[listening.node].append((listening, data))
                else:
                    listening.deliver(data)
        return delivered > 0

    def tick(self) -> None:
        """Let the timers of all nodes come, and deliver what they publish."""
        for node in tuple(self.nodes):
            for timer in tuple(node.timers):
                if not timer.is_canceled():
                    timer.callback()
        self.run()


def services(node: GraphNode) -> dict[str, Service]:
    """Return the services of a node by their names in it."""
    space = f"{node.get_fully_qualified_name()}/"
    return {one.service_name.removeprefix(space).lstrip("/"): one for one in node.services}
