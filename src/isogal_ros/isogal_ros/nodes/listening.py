"""Subscriptions that lose nothing, but hear publishers that may lose something, too.

Drivers of sensors are often best effort (`rclpy.qos.qos_profile_sensor_data`). A reliable
subscription is not connected with such a publisher at all; a best effort one is with both kinds.
Nothing else of `topics.LOSSLESS` asks for more than a publisher may offer.

Where a topic is of one publisher (`Topic.single`), that is the first one heard, and messages of
others are dropped (`isogal_ros.nodes.sources`)."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from isogal_ros import topics
from isogal_ros.nodes.sources import NAMELESS, Sources
from isogal_ros.nodes.taking import foretell, take_next
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
        Whether to use one publisher only; a node on a bus (`isogal_ros.graph.bus`) has no others.
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
        self._sources = Sources(self._look) if single else None
        self._subscription = self._subscribe(LOSSLESS)

    def _subscribe(self, profile: QoSProfile) -> Subscription:
        topic, events = self._topic, SubscriptionEventCallbacks(incompatible_qos=self._refuse)
        made = self._node.create_subscription(
            topic.type, topic.name, self._take, profile, raw=self._raw, event_callbacks=events
        )
        self._publishers, self._settled = -1, False
        if not isinstance(made, Subscription):
            self._sources = None
        elif self._sources is not None:
            foretell(made, self._sort)
        return made

    def _look(self) -> dict[bytes, str]:
        """Return who publishes, connected or not."""
        return {
            bytes(info.endpoint_gid): NAMELESS
            if _UNKNOWN in info.node_name
            else f"{info.node_namespace.rstrip('/')}/{info.node_name}"
            for info in self._node.get_publishers_info_by_topic(self.topic_name)
        }

    def _sort(self) -> None:
        """Take the messages that wait, unless there is one publisher, which is known: then rclpy
        does that as well, and sooner."""
        assert self._sources is not None
        publishers = self.get_publisher_count()
        if publishers != self._publishers:
            self._publishers, self._settled = publishers, False
            self._sources.look()
        if self._settled:
            return
        while (taken := take_next(self._subscription)) is not None:
            data, gid = taken
            why = None if gid is None else self._sources.refuse(gid, publishers <= 1)
            self._settled = publishers == 1
            if why is not None:
                self._node.health.drop(self._topic.name, why)
            else:
                self._take(data if self._raw else deserialize_message(data, self._topic.type))

    def _refuse(self, _event: QoSRequestedIncompatibleQoSInfo) -> None:
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
        """Take less where a publisher has offered less, and tell of several publishers; a timer
        calls this."""
        if self._sources is not None:
            self._sources.look()
            self._node.health.concern(f"publishers of {self._topic.name}", self._several())
        # one that is heard without loss is not to lose messages for another that is not used
        if not self._refused or (self._sources is not None and self.get_publisher_count()):
            return
        self._refused = False
        self._node.get_logger().warning(
            f"{self._topic.name}: a publisher is best effort, and is heard as such: what gets lost"
            " on its way is missing"
        )
        before, self._subscription = self._subscription, self._subscribe(_BEST_EFFORT)
        self._node.destroy_subscription(before)

    def _several(self) -> str | None:
        several = None if self._sources is None else self._sources.several
        return several and f"{self._topic.name} is {several}"

    def end(self) -> None:
        """Listen no more."""
        self._node.destroy_subscription(self._subscription)
