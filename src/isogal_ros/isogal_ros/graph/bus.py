"""Nodes of a graph without middleware: what one publishes is handed to the callbacks of the
others, serialised as the middleware would have it, in the order in which it was published.

The nodes are the same classes, and all that `GraphNode` does is done; only what rclpy's node does
is left out or done here. So there are no threads, no sockets and no waiting: a graph takes as long
as its callbacks, its process may fork, and the same messages give the same answers. Replays, the
fault campaign, the policy and tests of single nodes are made of it."""

from collections import defaultdict, deque
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from rclpy.lifecycle import LifecycleNode
from rclpy.logging import LoggingSeverity, get_logger
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message

from isogal_ros.graph.plan import node_class
from isogal_ros.topics import LOSSLESS

ERRORS = 1000
"""Errors kept."""
Change = Callable[[str, bytes], list[bytes]]
"""Turns a serialised message on a topic, by its name, into those that come instead."""


def as_it_is(_topic: str, data: bytes) -> list[bytes]:
    """Change nothing."""
    return [data]


class Bus:
    """Carries the messages of some nodes, whose warnings and errors are printed unless it is
    quiet."""

    def __init__(self, quiet: bool = True) -> None:
        self.quiet, self.now = quiet, 0.0
        """s, what its nodes take for the wall clock."""
        self.change: Change = as_it_is
        """What becomes of messages on their way."""
        self.errors: list[str] = []
        """What the nodes have logged as errors, the first `ERRORS`."""
        self.nodes: list[Any] = []
        """Those that are on it."""
        self.services: dict[tuple[str, str], Callable[[Any], Any]] = {}
        """What answers requests, by node and name."""
        self._listeners: dict[str, list[Subscription]] = defaultdict(list)
        self._taps: dict[str, list[Callable[[bytes], None]]] = defaultdict(list)
        self._publishers: dict[str, list[Publisher]] = defaultdict(list)
        self._queue: deque[tuple[str, bytes]] = deque()

    def ok(self) -> bool:
        """Say that it is there, as an rclpy context does."""
        return True

    def monotonic(self) -> float:
        """Return what its nodes take for the wall clock, s."""
        return self.now

    def add(self, name: str, values: Mapping[str, Any]) -> Any:
        """Return a node of the graph on the bus, active; raises InputError where a parameter is
        bad."""
        node = _on_bus(node_class(name))(name, values=values, context=self)
        self.nodes.append(node)
        return node

    def remove(self, node: Any) -> None:
        """Take a node off: it hears and says nothing any more."""
        if node in self.nodes:
            self.nodes.remove(node)
        for subscription in node.subscriptions:
            self._listeners[subscription.topic_name].remove(subscription)
        for publisher in node.publishers:
            self._publishers[publisher.topic_name].remove(publisher)
            publisher.bus = None
        node.subscriptions.clear()
        node.publishers.clear()

    def stop(self, node: Any) -> None:
        """Let a node take nothing until `go`; what comes meanwhile waits."""
        for subscription in node.subscriptions:
            subscription.held = []

    def go(self, node: Any) -> None:
        """Let a node take what has waited, each topic in its order, and go on."""
        waited = [(item, item.held or []) for item in node.subscriptions]
        for subscription, _ in waited:
            subscription.held = None
        for subscription, messages in waited:
            for data in messages:
                subscription.take(data)
        self.run()

    def hear(self, topic: Any, take: Callable[[bytes], None]) -> None:
        """Call `take` with every serialised message of a topic, as it was published."""
        self._taps[topic.name].append(take)

    def send(self, name: str, message: Any) -> None:
        """Publish a message, serialised or not, on a topic; `run` delivers it."""
        if self._listeners[name] or self._taps[name]:
            data = message if isinstance(message, bytes) else serialize_message(message)
            for take in self._taps[name]:
                take(data)
            self._queue.extend((name, item) for item in self.change(name, data))

    def tick(self) -> None:
        """Let the timers of all nodes come, and deliver what they publish."""
        for node in tuple(self.nodes):
            for timer in tuple(node.timers):
                timer()
        self.run()

    def run(self) -> None:
        """Deliver all that was published, and what is published because of it."""
        while self._queue:
            name, data = self._queue.popleft()
            for subscription in tuple(self._listeners[name]):
                subscription.take(data)

    def listeners(self, name: str) -> int:
        """Count those who listen to a topic."""
        return len(self._listeners[name])

    def publishers(self, name: str) -> list["Publisher"]:
        """Return the publishers of a topic."""
        return self._publishers[name]


class Publisher:
    """What a node has of a topic that it publishes."""

    qos_profile, topic_type_hash = LOSSLESS, ""

    def __init__(self, name: str, bus: Bus) -> None:
        self.topic_name, self.bus = name, bus
        self.endpoint_gid = id(self).to_bytes(8, "little")
        bus.publishers(name).append(self)

    def publish(self, message: Any) -> None:
        """Send a message."""
        if self.bus is not None:
            self.bus.send(self.topic_name, message)

    def get_subscription_count(self) -> int:
        """Count those who listen."""
        return self.bus.listeners(self.topic_name)

    def wait_for_all_acked(self, _timeout: Any = None) -> bool:
        """Nothing is under way for long."""
        return True


class Subscription:
    """What a node has of a topic that it listens to."""

    def __init__(
        self, name: str, kind: Any, callback: Callable[[Any], None], raw: bool, bus: Bus
    ) -> None:
        self.topic_name, self.callback, self.raw = name, callback, raw
        self._kind, self._bus = kind, bus
        self.held: list[bytes] | None = None
        """Messages that a node which is stopped has yet to take; None = it takes them at once."""

    def take(self, data: bytes) -> None:
        """Call back with a serialised message."""
        if self.held is not None:
            self.held.append(data)
            return
        self.callback(data if self.raw else deserialize_message(data, self._kind))

    def get_publisher_count(self) -> int:
        """Count those who publish."""
        return len(self._bus.publishers(self.topic_name))


class Timer:
    """A timer that comes when it is told to."""

    def __init__(self, callback: Callable[[], None]) -> None:
        self.callback, self._on = callback, True

    def __call__(self) -> None:
        """Come, unless cancelled."""
        if self._on:
            self.callback()

    def cancel(self) -> None:
        """Come no more."""
        self._on = False

    def reset(self) -> None:
        """Come again."""
        self._on = True


class _Log:
    """A node's log on a quiet bus: only errors are kept."""

    def __init__(self, name: str, bus: Bus) -> None:
        self._name, self._bus = name, bus

    def info(self, _text: str, **_: Any) -> None:
        pass

    warning = info

    def error(self, text: str, **_: Any) -> None:
        if len(self._bus.errors) < ERRORS:
            self._bus.errors.append(f"{self._name}: {text}")


def _log(name: str, bus: Bus) -> Any:
    """Return a node's log."""
    if bus.quiet:
        return _Log(name, bus)
    log = get_logger(name)
    log.set_level(LoggingSeverity.WARN)
    return log


class _BusNode(LifecycleNode):
    """In place of rclpy's node, below `GraphNode`."""

    # rclpy has properties of these names
    context: Any = None
    publishers: Any = ()
    subscriptions: Any = ()
    timers: Any = ()
    services: Any = ()
    clients: Any = ()

    def __init__(
        self, name: str, *, context: Bus, parameter_overrides: list[Parameter], **_: Any
    ) -> None:
        # not of LifecycleNode, which needs the middleware
        self._bus_name, self.context = name, context
        self._bus_log = _log(name, context)
        self._bus_values = {item.name: item for item in parameter_overrides}
        self.publishers, self.subscriptions, self.timers = [], [], []
        self.services, self.clients = [], []

    def get_name(self) -> str:
        return self._bus_name

    def get_namespace(self) -> str:
        return "/"

    def get_fully_qualified_name(self) -> str:
        return f"/{self._bus_name}"

    def get_logger(self) -> Any:
        return self._bus_log

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Any]:
        return dict(self._bus_values)

    def undeclare_parameter(self, name: str) -> None:
        del self._bus_values[name]

    def declare_parameter(self, *_: Any, **__: Any) -> None:
        pass

    def add_pre_set_parameters_callback(self, callback: Any) -> None:
        pass

    def add_on_set_parameters_callback(self, callback: Any) -> None:
        self._bus_change = callback

    def set_parameters(self, parameters: Any) -> list[Any]:
        return [self._bus_change([parameter]) for parameter in parameters]

    def create_publisher(self, _kind: Any, name: str, _qos: Any) -> Any:
        self.publishers.append(Publisher(name, self.context))
        return self.publishers[-1]

    def create_subscription(
        self, kind: Any, name: str, callback: Any, _qos: Any, *, raw: bool = False, **_: Any
    ) -> Any:
        self.subscriptions.append(Subscription(name, kind, callback, raw, self.context))
        self.context._listeners[name].append(self.subscriptions[-1])
        return self.subscriptions[-1]

    def create_timer(self, _period: float, callback: Any, **_: Any) -> Any:
        self.timers.append(Timer(callback))
        return self.timers[-1]

    def create_service(self, kind: Any, name: str, callback: Any, **_: Any) -> Any:
        key = self._bus_name, name.removeprefix("~/")
        self.context.services[key] = lambda request: callback(request, kind.Response())
        return self.context.services[key]

    def destroy_subscription(self, subscription: Any) -> None:
        self.subscriptions.remove(subscription)
        self.context._listeners[subscription.topic_name].remove(subscription)

    def destroy_publisher(self, publisher: Any) -> None:
        self.publishers.remove(publisher)
        self.context.publishers(publisher.topic_name).remove(publisher)

    def destroy_timer(self, timer: Any) -> None:
        timer.cancel()

    def destroy_node(self) -> None:
        self.context.remove(self)

    def count_publishers(self, name: str) -> int:
        return len(self.context.publishers(name))

    def get_publishers_info_by_topic(self, name: str) -> list[Any]:
        return self.context.publishers(name)

    def trigger_configure(self) -> Any:
        return self.on_configure(None)

    def trigger_activate(self) -> Any:
        return self.on_activate(None)

    def trigger_deactivate(self) -> Any:
        return self.on_deactivate(None)

    def trigger_cleanup(self) -> Any:
        return self.on_cleanup(None)

    def trigger_shutdown(self) -> Any:
        return self.on_shutdown(None)


@cache
def _on_bus(kind: Any) -> Any:
    """Return a class of node of the graph as it is on a bus: `_BusNode` comes after all classes of
    Isogal's and before rclpy's."""
    return type(kind.__name__, (kind, _BusNode), {})
