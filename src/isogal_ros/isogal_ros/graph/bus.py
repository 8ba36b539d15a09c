"""Nodes of a graph without middleware: what one publishes is handed to the callbacks of the
others, serialised as the middleware would have it, in the order in which it was published.

The nodes are the same classes, and all that `GraphNode` does is done; only what rclpy's node does
is left out or done here. So there are no threads, no sockets and no waiting: a graph takes as long
as its callbacks, its process may fork, which none with participants of DDS can, and the same
messages give the same answers. Replays, the fault campaign, the policy and tests of single nodes
are made of it."""

from collections import defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from types import SimpleNamespace

from pydantic import JsonValue
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import LoggingSeverity, get_logger
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rclpy.time import Time
from std_srvs.srv import Trigger

from isogal_ros import topics
from isogal_ros.graph.plan import node_class
from isogal_ros.messages.prepared import serialised
from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import LOSSLESS, Message, Topic

Change = Callable[[str, bytes], list[bytes]]
"""Turns a serialised message on a topic, by its name, into those that come instead."""


@dataclass
class _Channel:
    """Who publishes and who listens to one topic."""

    publishers: "list[Publisher]" = field(default_factory=list)
    subscriptions: "list[Subscription]" = field(default_factory=list)
    taps: list[Callable[[bytes], None]] = field(default_factory=list)


class Bus:
    """Carries the messages of some nodes, whose warnings and errors are printed unless it is
    quiet. To its nodes it is what a context of rclpy is."""

    def __init__(self, quiet: bool = True) -> None:
        self.quiet, self.now = quiet, 0.0
        """s, what its nodes take for the wall clock."""
        self.change: Change | None = None
        """What becomes of messages on their way."""
        self.errors: list[str] = []
        """What the nodes have logged as errors."""
        self.nodes: list[GraphNode] = []
        """Those that are on it."""
        self.services: dict[tuple[str, str], Callable[[Trigger.Request], Trigger.Response]] = {}
        """What answers requests, by node and name."""
        self.channels: dict[str, _Channel] = defaultdict(_Channel)
        self._queue: deque[tuple[str, bytes]] = deque()

    def ok(self) -> bool:
        """Say that it is there."""
        return True

    def monotonic(self) -> float:
        """Return what its nodes take for the wall clock, s."""
        return self.now

    def add(self, name: str, values: Mapping[str, JsonValue]) -> GraphNode:
        """Return a node of the graph on the bus, active; raises InputError where a parameter is
        bad."""
        node = _class_of(topics.kind_of(name))(name, values=values, context=self)
        self.nodes.append(node)
        return node

    def remove(self, node: GraphNode) -> None:
        """Take a node off: it hears and says nothing any more."""
        if node in self.nodes:
            self.nodes.remove(node)
        for subscription in tuple(node.subscriptions):
            node.destroy_subscription(subscription)
        for publisher in tuple(node.publishers):
            node.destroy_publisher(publisher)

    def stop(self, node: GraphNode) -> None:
        """Let a node take nothing until `go`; what comes meanwhile waits."""
        for subscription in node.subscriptions:
            subscription.held = []

    def go(self, node: GraphNode) -> None:
        """Let a node take what has waited, each topic in its order, and go on."""
        waited = [(item, item.held or []) for item in node.subscriptions]
        for subscription, _ in waited:
            subscription.held = None
        for subscription, messages in waited:
            for data in messages:
                subscription.take(data)
        self.run()

    def hear(self, topic: Topic, take: Callable[[bytes], None]) -> None:
        """Call `take` with every serialised message of a topic, as it was published."""
        self.channels[topic.name].taps.append(take)

    def send(self, name: str, message: Message | bytes) -> None:
        """Publish a message, serialised or not, on a topic; `run` delivers it."""
        channel = self.channels[name]
        if channel.subscriptions or channel.taps:
            data = serialised(message)
            for take in channel.taps:
                take(data)
            arriving = [data] if self.change is None else self.change(name, data)
            self._queue.extend((name, item) for item in arriving)

    def run(self) -> None:
        """Deliver all that was published, and what is published because of it."""
        while self._queue:
            name, data = self._queue.popleft()
            for subscription in tuple(self.channels[name].subscriptions):
                subscription.take(data)

    def tick(self) -> None:
        """Let the timers of all nodes come, and deliver what they publish."""
        for node in tuple(self.nodes):
            for timer in tuple(node.timers):
                if timer.on:
                    timer.callback()
        self.run()


class Publisher:
    """What a node has of a topic that it publishes."""

    qos_profile, topic_type_hash = LOSSLESS, ""

    def __init__(self, name: str, bus: Bus) -> None:
        self.topic_name, self._bus = name, bus
        self.endpoint_gid = id(self).to_bytes(8, "little")
        bus.channels[name].publishers.append(self)

    def publish(self, message: Message | bytes) -> None:
        """Send a message."""
        self._bus.send(self.topic_name, message)

    def get_subscription_count(self) -> int:
        """Count those who listen."""
        channel = self._bus.channels[self.topic_name]
        return len(channel.subscriptions) + len(channel.taps)

    def wait_for_all_acked(self, _timeout: object = None) -> bool:
        """Nothing is under way for long."""
        return True


@dataclass(eq=False)
class Subscription:
    """What a node has of a topic that it listens to."""

    kind: type[Message]
    topic_name: str
    callback: Callable[[Message | bytes], None]
    raw: bool
    bus: Bus
    held: list[bytes] | None = None
    """Messages that a node which is stopped has yet to take; None = it takes them at once."""

    def take(self, data: bytes) -> None:
        """Call back with a serialised message."""
        if self.held is not None:
            self.held.append(data)
            return
        self.callback(data if self.raw else deserialize_message(data, self.kind))

    def get_publisher_count(self) -> int:
        """Count those who publish."""
        return len(self.bus.channels[self.topic_name].publishers)


@dataclass(eq=False)
class Timer:
    """A timer that comes with every tick of its bus."""

    callback: Callable[[], None]
    on: bool = True

    def cancel(self) -> None:
        """Come no more."""
        self.on = False

    def reset(self) -> None:
        """Come again."""
        self.on = True


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


class _BusNode(LifecycleNode):
    """In place of rclpy's node, below `GraphNode`."""

    # rclpy has properties of these names
    publishers: "cached_property[list[Publisher]]" = cached_property(lambda _: [])
    subscriptions: "cached_property[list[Subscription]]" = cached_property(lambda _: [])
    timers: "cached_property[list[Timer]]" = cached_property(lambda _: [])
    services = clients = ()

    def __init__(
        self, name: str, *, context: Bus, parameter_overrides: list[Parameter], **_: object
    ) -> None:
        # not of LifecycleNode, which needs the middleware; names that no node of the graph has
        self._bus_name, self._bus = name, context
        self._bus_values = {item.name: item for item in parameter_overrides}
        self._bus_log: _ErrorLog | RcutilsLogger = _ErrorLog(name, context.errors)
        if not context.quiet:
            self._bus_log = get_logger(name)
            self._bus_log.set_level(LoggingSeverity.WARN)

    @property
    def context(self) -> Bus:
        return self._bus

    def get_name(self) -> str:
        return self._bus_name

    def get_namespace(self) -> str:
        return "/"

    def get_fully_qualified_name(self) -> str:
        return f"/{self._bus_name}"

    def get_logger(self) -> _ErrorLog | RcutilsLogger:
        return self._bus_log

    def get_clock(self) -> SimpleNamespace:
        return SimpleNamespace(now=lambda: Time(seconds=self._bus.now))

    def get_parameters_by_prefix(self, _prefix: str) -> dict[str, Parameter]:
        return dict(self._bus_values)

    def undeclare_parameter(self, name: str) -> None:
        del self._bus_values[name]

    def _leave_out(self, *_: object, **__: object) -> None:
        """Do nothing: values are fixed, and checked by the models."""

    declare_parameter = add_pre_set_parameters_callback = _leave_out

    def add_on_set_parameters_callback(
        self, callback: Callable[[list[Parameter]], Message]
    ) -> None:
        self._bus_change = callback

    def set_parameters(self, parameters: Sequence[Parameter]) -> list[Message]:
        return [self._bus_change([parameter]) for parameter in parameters]

    def create_publisher(self, _kind: type[Message], name: str, _qos: object) -> Publisher:
        self.publishers.append(Publisher(name, self._bus))
        return self.publishers[-1]

    def create_subscription(
        self,
        kind: type[Message],
        name: str,
        callback: Callable[[Message | bytes], None],
        _qos: object,
        *,
        raw: bool = False,
        **_: object,
    ) -> Subscription:
        made = Subscription(kind, name, callback, raw, self._bus)
        self.subscriptions.append(made)
        self._bus.channels[name].subscriptions.append(made)
        return made

    def create_timer(self, _period: float, callback: Callable[[], None], **_: object) -> Timer:
        self.timers.append(Timer(callback))
        return self.timers[-1]

    def create_service(
        self,
        kind: type[Trigger],
        name: str,
        callback: Callable[[Trigger.Request, Trigger.Response], Trigger.Response],
    ) -> None:
        key = self._bus_name, name.removeprefix("~/")
        self._bus.services[key] = lambda request: callback(request, kind.Response())

    def destroy_subscription(self, subscription: Subscription) -> None:
        self.subscriptions.remove(subscription)
        self._bus.channels[subscription.topic_name].subscriptions.remove(subscription)

    def destroy_publisher(self, publisher: Publisher) -> None:
        self.publishers.remove(publisher)
        self._bus.channels[publisher.topic_name].publishers.remove(publisher)

    def destroy_timer(self, timer: Timer) -> None:
        timer.cancel()

    def destroy_node(self) -> None:
        self._bus.remove(self)

    def count_publishers(self, name: str) -> int:
        return len(self._bus.channels[name].publishers)

    def get_publishers_info_by_topic(self, name: str) -> list[Publisher]:
        return self._bus.channels[name].publishers


_NO_STATE = LifecycleState("", 0)


def _change_to(state: str) -> Callable[[_BusNode], TransitionCallbackReturn]:
    """Return what changes a node's state."""
    return lambda node: getattr(node, f"on_{state}")(_NO_STATE)


for _state in ("configure", "activate", "deactivate", "cleanup", "shutdown"):
    setattr(_BusNode, f"trigger_{_state}", _change_to(_state))


@cache
def _class_of(kind: str) -> type[GraphNode]:
    """Return a class of node of the graph as it is on a bus: `_BusNode` comes after all classes of
    Isogal's and before rclpy's."""
    base = node_class(kind)
    return type(base.__name__, (base, _BusNode), {})
