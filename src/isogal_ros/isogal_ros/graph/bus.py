"""Nodes of a graph whose messages do not go over the middleware: what one publishes is handed to
the callbacks of the others, serialised, in the order in which it was published.

They are nodes of rclpy in a domain of their own, whom nobody spins. So there are no threads and no
waiting: a graph takes as long as its callbacks, and the same messages give the same answers.
Replays, the fault campaign, the policy and tests of single nodes are made of it."""

from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache, partial
from types import SimpleNamespace
from typing import Any

from pydantic import JsonValue
from rclpy.context import Context
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.lifecycle import LifecycleNode
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
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
    """The context of some nodes, which carries their messages; their warnings and errors are
    printed unless it is quiet. It has to be closed."""

    def __init__(self, quiet: bool = True) -> None:
        super().__init__()
        self.quiet, self.now = quiet, 0.0
        """s, what its nodes take for the wall clock."""
        self.change: Change | None = None
        """What becomes of messages on their way."""
        self.errors: list[str] = []
        """What the nodes have logged as errors, where it is quiet."""
        self.nodes: list[GraphNode] = []
        self._taps: defaultdict[str, list[Callable[[bytes], None]]] = defaultdict(list)
        self.listeners: dict[str, list[tuple[GraphNode, Subscription]]] = {}
        """By topic, as far as they have been looked for since somebody came or left."""
        self._queue: deque[tuple[str, bytes]] = deque()
        self._held: dict[GraphNode, list[tuple[Subscription, bytes]]] = {}
        """What nodes that are stopped have yet to take."""
        self._stack = ExitStack()
        domain = next(free_domains(self._stack), None)
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

    def monotonic(self) -> float:
        """Return what its nodes take for the wall clock, s."""
        return self.now

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
            node.destroy_node()

    def stop(self, node: GraphNode) -> None:
        """Let a node take nothing until `go`; what comes meanwhile waits."""
        self._held[node] = []

    def go(self, node: GraphNode) -> None:
        """Let a node take what has waited, and go on."""
        for subscription, data in self._held.pop(node):
            _take(subscription, data)
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
        name = name.lstrip("/")
        taps = self._taps.get(name, ())
        if taps or self._listening(name):
            data = serialised(message)
            for take in taps:
                take(data)
            arriving = [data] if self.change is None else self.change(name, data)
            self._queue.extend((name, item) for item in arriving)

    def _listening(self, name: str) -> list[tuple[GraphNode, Subscription]]:
        """Return who listens to a topic."""
        if name not in self.listeners:
            self.listeners[name] = [
                (node, one)
                for node in self.nodes
                for one in node.subscriptions
                if one.topic_name.lstrip("/") == name
            ]
        return self.listeners[name]

    def count(self, name: str) -> int:
        """Count those who listen to a topic."""
        name = name.lstrip("/")
        return len(self._taps.get(name, ())) + len(self._listening(name))

    def run(self) -> None:
        """Deliver all that was published, and what is published because of it."""
        while self._queue:
            name, data = self._queue.popleft()
            for node, subscription in self._listening(name):
                if node in self._held:
                    self._held[node].append((subscription, data))
                else:
                    _take(subscription, data)

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

    def call(self, node: GraphNode, name: str, request: Any) -> Any:
        """Return what a service of a node answers."""
        service = self.services(node)[name]
        return service.callback(request, service.srv_type.Response())


def _take(subscription: Subscription, data: bytes) -> None:
    """Call back with a serialised message."""
    raw = subscription.raw
    subscription.callback(data if raw else deserialize_message(data, subscription.msg_type))


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
    """What is otherwise in a node on a bus: it publishes there, logs there and has its time."""

    context: Bus

    def create_publisher(
        self, kind: type[Message], name: str, qos: QoSProfile, **options: Any
    ) -> Publisher:
        made = super().create_publisher(kind, name, qos, **options)  # type: ignore[misc]
        made.publish = partial(self.context.send, made.topic_name)
        made.get_subscription_count = partial(self.context.count, made.topic_name)
        return made

    def create_subscription(self, *arguments: Any, **options: Any) -> Subscription:
        self.context.listeners.clear()
        return super().create_subscription(*arguments, **options)  # type: ignore[misc]

    def destroy_subscription(self, subscription: Subscription) -> bool:
        self.context.listeners.clear()
        return super().destroy_subscription(subscription)  # type: ignore[misc]

    def get_logger(self) -> _ErrorLog | RcutilsLogger:
        logger = super().get_logger()  # type: ignore[misc]
        return _ErrorLog(logger.name, self.context.errors) if self.context.quiet else logger

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: Time(seconds=self.context.now))


class _Outside(_OnBus, Node):
    """A node that is none of the graph's."""


class _NodeOnBus(_OnBus, LifecycleNode):
    """Comes after all classes of Isogal's and before rclpy's."""


@cache
def _class_of(kind: str) -> type[GraphNode]:
    """Return a class of node of the graph as it is on a bus."""
    base = node_class(kind)
    return type(base.__name__, (base, _NodeOnBus), {})
