"""Publishers of the graph's topics, which know who has to listen, and never end a node."""

import time
from typing import TYPE_CHECKING

from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation

from isogal_ros import topics
from isogal_ros.messages.frames import FrameNames
from isogal_ros.messages.prepared import Prepared
from isogal_ros.messages.stamps import to_ns, to_seconds
from isogal_ros.topics import LOSSLESS, Topic

if TYPE_CHECKING:
    from isogal_ros.nodes.base import GraphNode


class Publishing:
    """A publisher of one of the graph's topics. It counts what cannot be published, because a
    listener takes nothing, and what is older than a message before it and is let go (but where
    `Topic.single` says that it may be).

    Parameters
    ----------
    node : GraphNode
        Its health is told; frames have its names.
    topic : Topic
    listeners : int
        How many nodes of the graph have to listen.
    """

    def __init__(self, node: "GraphNode", topic: Topic, listeners: int) -> None:
        self._node, self.topic, self._listeners = node, topic, listeners
        self._publisher = node.create_publisher(topic.type, topic.name, LOSSLESS)
        self._bus = node.bus
        self._others = 0
        """Who listened by the middleware, besides those on the bus, at the last look."""
        self._in_order = topic.single and "header" in topic.type.get_fields_and_field_types()
        self._renamed = node.frame_names != FrameNames()
        self.newest: int | None = None
        """Stamp of the newest message published, where that matters; None = there is none."""

    def publish(self, message: topics.Message) -> None:
        """Publish a message; what is serialised is a recording's, and goes out as it is."""
        is_prepared = isinstance(message, Prepared)
        if not isinstance(message, bytes):
            if self._in_order:
                ns = message.ns if is_prepared else to_ns(message.header.stamp)
                if self.newest is not None and ns < self.newest:
                    than = f"{to_seconds(ns):.3f} s is older than {to_seconds(self.newest):.3f} s"
                    self._node.health.drop(self.topic.name, f"not published, {than}")
                    return
                self.newest = ns
            if self._renamed:
                outward = self._node.frame_names.outward
                message.rename(outward) if is_prepared else outward(message)
        try:
            if self._bus is not None:
                self._bus.send(self.topic.name, message)
            if self._bus is None or self._others:
                self._publisher.publish(message.serialised() if is_prepared else message)
        except rclpy_implementation.RCLError as error:
            if not self._node.context.ok():
                raise
            text = f"not published, a listener takes nothing: {error}"
            self._node.health.drop(self.topic.name, text)

    def look(self) -> None:
        """See how many listen by the middleware."""
        self._others = self._publisher.get_subscription_count()

    def get_subscription_count(self) -> int:
        """Return how many listen."""
        if self._bus is None:
            return int(self._publisher.get_subscription_count())
        return self._bus.count(self.topic.name) + self._others

    @property
    def missing(self) -> str:
        """Say that too few listen; empty = enough do."""
        needed = self._listeners + self._node.settings.recorders
        count = self.get_subscription_count()
        return f"{self.topic.name} {count} of {needed}" if count < needed else ""

    def wait(self, deadline: float) -> None:
        """Wait until listeners have had all, or the monotonic clock (s) is at a deadline."""
        left = max(0.0, deadline - time.monotonic())
        self._publisher.wait_for_all_acked(Duration(seconds=left))
