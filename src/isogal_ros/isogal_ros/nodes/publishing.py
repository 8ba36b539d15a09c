"""Publishers whose messages are in order of time, and that fail in peace."""

from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation

from isogal_ros.messages.stamps import to_ns, to_seconds
from isogal_ros.topics import Topic


class Published:
    """What a node has published: the stamp of the newest message on each topic.

    Parameters
    ----------
    node : GraphNode
        Its health is told.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._newest: dict[str, int] = {}

    def forget(self) -> None:
        """Begin anew: stamps may be those of another run."""
        self._newest.clear()

    def watch(self, publisher: Any, topic: Topic) -> None:
        """Let a publisher count what cannot be published, because a listener takes nothing, and
        what is older than a message before it and is let go (but where `Topic.single` says that it
        may be)."""
        in_order = topic.single and "header" in topic.type.get_fields_and_field_types()
        send = publisher.publish

        def publish(message: Any) -> None:
            # what is serialised is a recording's, and goes out as it is
            checked = in_order and not isinstance(message, bytes)
            if checked and self._goes_back(topic, to_ns(message.header.stamp)):
                return
            try:
                send(message)
            except rclpy_implementation.RCLError as error:
                if not self._node.context.ok():
                    raise
                text = f"not published, a listener takes nothing: {error}"
                self._node.health.drop(topic.name, text)

        publisher.publish = publish

    def _goes_back(self, topic: Topic, ns: int) -> bool:
        newest = self._newest.setdefault(topic.name, ns)
        if ns < newest:
            text = f"{to_seconds(ns):.3f} s is older than {to_seconds(newest):.3f} s"
            self._node.health.drop(topic.name, f"not published, {text}")
            return True
        self._newest[topic.name] = ns
        return False
