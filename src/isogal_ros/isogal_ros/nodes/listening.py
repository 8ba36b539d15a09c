"""Subscriptions that lose nothing, but hear publishers that may lose something, or that publish
another type of message, too.

Drivers of sensors are often best effort (`rclpy.qos.qos_profile_sensor_data`). A reliable
subscription is not connected with such a publisher at all; a best effort one is with both kinds.
Nothing else of `topics.LOSSLESS` asks for more than a publisher may offer. A publisher of another
type is not connected either: what `messages.drivers` takes in a topic's place is subscribed to
where nobody publishes the topic's own type.

ROS does not say whose a message is. So where a topic is of one publisher (`Topic.single`) and
nodes of different names publish it, none of their messages is used until one node is left: two
drivers by turns would be worse than none, of which the navigator knows what it costs."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from isogal_ros import topics
from isogal_ros.messages.drivers import takes_others, type_taken
from isogal_ros.nodes.health import ERROR
from isogal_ros.topics import LOSSLESS, Topic

if TYPE_CHECKING:
    from isogal_ros.nodes.base import GraphNode

Take = Callable[[topics.Message], None]
"""Takes a message of a topic; or a serialised one, as the subscription says."""
_BEST_EFFORT = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, depth=0, reliability=ReliabilityPolicy.BEST_EFFORT
)
_UNKNOWN = "NODE_NAME_UNKNOWN"
"""In the name of a node of which the middleware knows the publisher first."""


class Listening:
    """A subscription of a node, which becomes best effort where a publisher is.

    Parameters
    ----------
    node : GraphNode
    topic : Topic
    take : callable
        Takes a message, serialised if `raw`.
    single : bool, optional
        Whether it is of one publisher.
    """

    def __init__(
        self,
        node: "GraphNode",
        topic: Topic,
        take: Take,
        raw: bool = False,
        single: bool = False,
    ) -> None:
        self._node, self._topic, self._take, self._raw = node, topic, take, raw
        self._refused = False
        self.type: type[topics.Message] = topic.type
        """Of the messages that are taken: the topic's own, or one that a driver publishes."""
        self._is_down = False
        """Whether it waits for its subscription to be gone before it has another."""
        self._single = single
        self._several: str | None = None
        """Who publishes beside each other; None = it is one node."""
        self._subscription = self._subscribe(LOSSLESS)

    def _subscribe(self, profile: QoSProfile) -> Subscription:
        topic, events = self._topic, SubscriptionEventCallbacks(incompatible_qos=self._refuse)
        take = self._take_of_one if self._single else self._take
        self._connected = -1
        return self._node.create_subscription(
            self.type, topic.name, take, profile, raw=self._raw, event_callbacks=events
        )

    def _take_of_one(self, message: topics.Message) -> None:
        """Take a message, unless several nodes publish."""
        try:
            connected = self.get_publisher_count()
        except InvalidHandle:  # it ends, and its executor has had the message already
            return
        if connected != self._connected:
            self._connected = connected
            self._look()
        if self._several is None:
            self._take(message)
        else:
            self._node.health.drop(self._topic.name, self._several)

    def _look(self) -> None:
        """See anew who publishes. Publishers of one node's name may be one that was started again:
        of a process that was killed the middleware takes up to 20 s to notice that it is gone."""
        names = {
            f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            for info in self._node.get_publishers_info_by_topic(self.topic_name)
            if _UNKNOWN not in info.node_name
        }
        who = " and ".join(sorted(names))
        told = f"{self._topic.name} is published by {who}: not used until one is left"
        self._several = told if len(names) > 1 else None
        self._node.health.concern(f"publishers of {self._topic.name}", self._several, ERROR)

    def _refuse(self, _event: QoSRequestedIncompatibleQoSInfo) -> None:
        """Note that a publisher offers less than is asked for."""
        self._refused = True

    @property
    def topic_name(self) -> str:
        """The resolved name."""
        return str(self._subscription.topic_name)

    def get_publisher_count(self) -> int:
        """Return how many publishers are connected."""
        return 0 if self._is_down else int(self._subscription.get_publisher_count())

    def adapt(self) -> None:
        """Take less where a publisher has offered less, or another type, and tell of several
        publishers; a timer calls this."""
        if self._is_down and not self._is_up_again():
            return
        if self._single:
            self._look()
        if self._retyped():
            return
        # one that is heard without loss is not to lose messages for another
        if not self._refused or (self._single and self.get_publisher_count()):
            return
        self._refused = False
        self._node.get_logger().warning(
            f"{self._topic.name}: a publisher is best effort, and is heard as such: what gets lost"
            " on its way is missing"
        )
        before, self._subscription = self._subscription, self._subscribe(_BEST_EFFORT)
        self._node.destroy_subscription(before)

    def _retyped(self) -> bool:
        """Listen to another type of message that the topic takes, where only that is published."""
        if not takes_others(self._topic) or self.get_publisher_count():
            return False
        infos = self._node.get_publishers_info_by_topic(self.topic_name)
        kind = type_taken(self._topic, [info.topic_type for info in infos])
        if kind in (None, self.type):
            return False
        self._node.get_logger().warning(
            f"{self._topic.name}: published as {topics.type_name(kind)}, which is taken for"
            f" {topics.type_name(self._topic.type)}"
        )
        # a process has one type of a topic, and its executor holds what is destroyed for a while
        self.end()
        self.type, self._is_down = kind, True
        return True

    def _is_up_again(self) -> bool:
        """Subscribe to another type, where the last one is gone for good."""
        try:
            self._subscription = self._subscribe(LOSSLESS)
        except rclpy_implementation.RCLError:
            return False
        self._is_down = False
        return True

    def end(self) -> None:
        """Listen no more."""
        self._node.destroy_subscription(self._subscription)
