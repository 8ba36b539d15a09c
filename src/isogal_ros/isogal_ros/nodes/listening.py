"""Subscriptions that lose nothing, but hear publishers that may lose something, too.

Drivers of sensors are often best effort (`rclpy.qos.qos_profile_sensor_data`). A reliable
subscription is not connected with such a publisher at all; a best effort one is with both kinds.
Nothing else of `topics.LOSSLESS` asks for more than a publisher may offer."""

from collections.abc import Callable
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy

from isogal_ros.topics import LOSSLESS, Topic

_BEST_EFFORT = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, depth=0, reliability=ReliabilityPolicy.BEST_EFFORT
)


class Listening:
    """A subscription of a node, which becomes best effort where a publisher is.

    Parameters
    ----------
    node : GraphNode
    topic : Topic
    take : callable
        Takes a message, serialised if `raw`.
    """

    def __init__(
        self, node: Any, topic: Topic, take: Callable[[Any], object], raw: bool = False
    ) -> None:
        self._node, self._topic, self._take, self._raw = node, topic, take, raw
        self._refused = False
        self._subscription = self._subscribe(LOSSLESS)

    def _subscribe(self, profile: QoSProfile) -> Any:
        topic, events = self._topic, SubscriptionEventCallbacks(incompatible_qos=self._refuse)
        return self._node.create_subscription(
            topic.type, topic.name, self._take, profile, raw=self._raw, event_callbacks=events
        )

    def _refuse(self, _event: Any) -> None:
        """Note that a publisher offers less than is asked for."""
        self._refused = True

    @property
    def topic_name(self) -> str:
        """The resolved name."""
        return str(self._subscription.topic_name)

    def get_publisher_count(self) -> int:
        """Return how many publishers are connected."""
        return int(self._subscription.get_publisher_count())

    def adapt(self) -> None:
        """Take less where a publisher has offered less; a timer calls this."""
        if not self._refused:
            return
        self._refused = False
        self._node.get_logger().warning(
            f"{self._topic.name}: a publisher is best effort, and is heard as such: what gets lost"
            " on its way is missing"
        )
        before, self._subscription = self._subscription, self._subscribe(_BEST_EFFORT)
        self._node.destroy_subscription(before)

    def end(self) -> None:
        """Listen no more."""
        self._node.destroy_subscription(self._subscription)
