"""Nodes of a graph in one process, whose messages do not go over the middleware: what one
publishes is handed to the callbacks of the others, serialised, in the order it was published.

They are nodes of rclpy. In a domain of their own nobody spins them, and their time is that of the
data: a graph takes as long as its callbacks, and the same messages give the same answers. Replays,
the fault campaign, the policy and tests of single nodes are made of it. In a domain that is given
(`isogal run --in-process`) others hear what they publish and call their services as ever, by an
executor."""

import math
from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

from pydantic import JsonValue
from rclpy.clock import Clock
from rclpy.context import Context
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.service import Service
from rclpy.subscription import Subscription
from rclpy.time import Time

from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.graph.domain import free_domains, local_context
from isogal_ros.graph.plan import node_class
from isogal_ros.messages.prepared import serialised
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import LOSSLESS, Message, Topic

Change = Callable[[str, bytes], list[bytes]]
"""Turns a serialised message on a topic, by its name, into those that come instead."""


class Bus(Context):
    """The context of some nodes, which carries their messages. It has to be closed.

    Parameters
    ----------
    quiet : bool
        Whether their warnings and errors are not printed.
    domain : int, optional
        Where others may hear them, by the wall clock; None = nobody does, by that of the data.
    """

    def __init__(self, quiet: bool = True, domain: int | None = None) -> None:
        super().__init__()
        self.quiet, self.now, self.alone = quiet, 0.0, domain is None
        """`now`, s, is what nodes that are alone take for the wall clock."""
        self.monotonic = (lambda: self.now) if self.alone else None
        self.change: Change | None = None
        """What becomes of messages on their way."""
        self.errors: list[str] = []
        """What the nodes have logged as errors, where it is quiet."""
        self.nodes: list[GraphNode] = []
        self._taps: defaultdict[str, list[Callable[[bytes], None]]] = defaultdict(list)
        self.listeners: dict[str, list[tuple[GraphNode, Listener]]] = {}
        """By topic, as far as they have been looked for since somebody came or left."""
        self._queue: deque[tuple[str, bytes]] = deque()
        self._held: dict[GraphNode, list[tuple[Listener, bytes]]] = {}
        """What nodes that are stopped have yet to take."""
        self.outside: set[Publisher] = set()
        """To whom others listen, as far as `look` has seen."""
        self._is_open = False
        self._stack = ExitStack()
        domain = next(free_domains(self._stack), None) if domain is None else domain
        if domain is None:
            raise InputError("no free ROS domain for the nodes of this process")
        self._stack.enter_context(local_context(domain, self))
        self._outside: Node | None = None

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Destroy the nodes, and end."""
        for node in tuple(self.nodes):
            self.remove(node)
        if self._outside is not None:
            self._outside.destroy_node()
        self._stack.close()

    def add(self, name: str, values: Mapping[str, JsonValue]) -> GraphNode:
        """Return a node of the graph on the bus, active; raises InputError where a parameter is
        bad."""
        node = _class_of(topics.kind_of(name))(name, values=values, context=self)
        self.nodes.append(node)
        self.listeners.clear()
        return node

    def remove(self, node: GraphNode) -> None:
        """Take a node off: it hears and says nothing any more."""
        if node in self.nodes:
            self.nodes.remove(node)
            self.listeners.clear()
            node.destroy_node()

    def finish(self, node: GraphNode) -> None:
        """Take a node off, and let the others have its last words."""
        self.nodes.remove(node)
        self.listeners.clear()
        node.close()
        self.run()

    def open(self) -> None:
        """Let nodes hear others where no node on the bus publishes."""
        self._is_open = True
        for node in self.nodes:
            for one in node.listeners:
                self.admit(one)

    def admit(self, listener: "Listener") -> None:
        """Let a listener of a topic that no node on the bus publishes hear others."""
        if self._is_open and not self.publishers(listener.topic_name):
            listener.open()

    def look(self) -> None:
        """See to whom others listen."""
        every = (publisher for node in self.nodes for publisher in node.publishers)
        self.outside = {one for one in every if Publisher.get_subscription_count(one)}

    def stop(self, node: GraphNode) -> None:
        """Let a node take nothing until `go`; what comes meanwhile waits."""
        self._held[node] = []

    def go(self, node: GraphNode) -> None:
        """Let a node take what has waited, and go on."""
        for listener, data in self._held.pop(node):
            listener.take(data)
        self.run()

    def publisher(self, topic: Topic) -> Publisher:
        """Return a publisher that belongs to no node of the graph."""
        if self._outside is None:
            self._outside = _Outside("outside", context=self, use_global_arguments=False)
        return self._outside.create_publisher(topic.type, topic.name, LOSSLESS)

    def hear(self, topic: Topic, take: Callable[[bytes], None]) -> None:
        """Call `take` with every serialised message of a topic, as it was published."""
        self._taps[topic.name.lstrip("/")].append(take)

    def send(self, name: str, message: Message) -> None:
        """Publish a message, serialised or not, on a topic; `run` delivers it."""
        taps = self._taps.get(name, ())
        if taps or self._listening(name):
            data = serialised(message)
            for take in taps:
                take(data)
            if self.change is None:
                self._queue.append((name, data))
            else:
                self._queue.extend((name, item) for item in self.change(name, data))

    def _listening(self, name: str) -> list[tuple[GraphNode, "Listener"]]:
        """Return who listens to a topic."""
        if name not in self.listeners:
            self.listeners[name] = [
                (node, one)
                for node in self.nodes
                for one in node.listeners
                if one.topic_name.lstrip("/") == name
            ]
        return self.listeners[name]

    def count(self, name: str) -> int:
        """Count those on the bus who listen to a topic."""
        return len(self._taps.get(name, ())) + len(self._listening(name))

    def publishers(self, name: str) -> int:
        """Count those on the bus who publish on a topic, by its resolved name."""
        nodes = [*self.nodes, *([self._outside] if self._outside else ())]
        return sum(one.topic_name == name for node in nodes for one in node.publishers)

    def run(self, most: float = math.inf) -> bool:
        """Deliver what was published, and what is published because of it, so many messages at
        most; return whether there was any."""
        delivered = 0
        while self._queue and delivered < most:
            delivered += 1
            name, data = self._queue.popleft()
            for node, listener in self._listening(name):
                if node in self._held:
                    self._held[node].append((listener, data))
                else:
                    listener.take(data)
        return delivered > 0

    def tick(self) -> None:
        """Let the timers of all nodes come, and deliver what they publish."""
        for node in tuple(self.nodes):
            for timer in tuple(node.timers):
                if not timer.is_canceled():
                    timer.callback()
        self.run()

    def services(self, node: GraphNode) -> dict[str, Service]:
        """Return the services of a node by their names in it."""
        space = f"{node.get_fully_qualified_name()}/"
        names = {one: one.service_name.removeprefix(space) for one in node.services}
        return {name.lstrip("/"): one for one, name in names.items()}


@dataclass(eq=False)
class Listener:
    """What a node on a bus has in place of a subscription."""

    node: "_OnBus"
    topic_name: str
    """The resolved name."""
    msg_type: type[Message]
    callback: Callable[[Message], None]
    raw: bool
    subscribe: Callable[[], Subscription]
    """Makes a subscription by which others are heard, too."""
    subscription: Subscription | None = None

    def take(self, data: bytes) -> None:
        """Call back with a serialised message."""
        self.callback(data if self.raw else deserialize_message(data, self.msg_type))

    def get_publisher_count(self) -> int:
        """Return how many publishers it hears."""
        others = 0 if self.subscription is None else self.subscription.get_publisher_count()
        return self.node.context.publishers(self.topic_name) + others

    def open(self) -> None:
        """Hear others, too."""
        if self.subscription is None:
            self.subscription = self.subscribe()


@dataclass
class _ErrorLog:
    """A node's log on a quiet bus: only errors are kept."""

    name: str
    errors: list[str]

    def info(self, _text: str, **_: float) -> None:
        pass

    warning = info

    def error(self, text: str, **_: float) -> None:
        self.errors.append(f"{self.name}: {text}")


class _OnBus:
    """What is otherwise in a node on a bus: it publishes and listens there, and where it is alone,
    logs there and has its time."""

    context: Bus

    @property
    def listeners(self) -> list[Listener]:
        """What it listens by."""
        listeners: list[Listener] = self.__dict__.setdefault("_listeners", [])
        return listeners

    def create_publisher(
        self, kind: type[Message], name: str, qos: QoSProfile, **options: Any
    ) -> Publisher:
        made = super().create_publisher(kind, name, qos, **options)  # type: ignore[misc]
        bus, on_bus, publish = self.context, made.topic_name.lstrip("/"), made.publish
        latched = getattr(qos, "durability", None) == DurabilityPolicy.TRANSIENT_LOCAL

        def send(message: Message) -> None:
            bus.send(on_bus, message)
            if latched or made in bus.outside:
                publish(serialised(message))

        made.publish = send
        made.get_subscription_count = lambda: bus.count(on_bus) + (made in bus.outside)
        return made

    def create_subscription(
        self,
        kind: type[Message],
        name: str,
        callback: Callable[[Message], None],
        qos: QoSProfile,
        *,
        raw: bool = False,
        **options: Any,
    ) -> Listener:
        subscribe = super().create_subscription  # type: ignore[misc]
        make = partial(subscribe, kind, name, callback, qos, raw=raw, **options)
        resolved = self.resolve_topic_name(name)  # type: ignore[attr-defined]
        made = Listener(self, resolved, kind, callback, raw, make)
        self.listeners.append(made)
        self.context.listeners.clear()
        self.context.admit(made)
        return made

    def destroy_listener(self, listener: Listener) -> None:
        """Listen no more."""
        if listener in self.listeners:
            self.listeners.remove(listener)
            self.context.listeners.clear()
            if listener.subscription is not None:
                self.destroy_subscription(listener.subscription)

    def destroy_subscription(self, subscription: Subscription | Listener) -> bool:
        if isinstance(subscription, Listener):
            self.destroy_listener(subscription)
            return True
        return super().destroy_subscription(subscription)  # type: ignore[misc]

    def get_logger(self) -> _ErrorLog | RcutilsLogger:
        logger = super().get_logger()  # type: ignore[misc]
        return _ErrorLog(logger.name, self.context.errors) if self.context.quiet else logger

    def get_clock(self) -> SimpleNamespace | Clock:
        if self.context.alone:
            return SimpleNamespace(now=lambda: Time(seconds=self.context.now))
        return super().get_clock()  # type: ignore[misc]


class _Outside(_OnBus, Node):
    """A node that is none of the graph's."""


class _NodeOnBus(_OnBus, LifecycleNode):
    """Comes after all classes of Isogal's and before rclpy's."""


@cache
def _class_of(kind: str) -> type[GraphNode]:
    """Return a class of node of the graph as it is on a bus."""
    base = node_class(kind)
    return type(base.__name__, (base, _NodeOnBus), {"entities": (*base.entities, "listeners")})
