"""Which nodes of the graph are active, by the events of their lifecycle."""

from collections.abc import Callable
from functools import partial

from lifecycle_msgs.msg import State, TransitionEvent

from isogal_ros.nodes.base import GraphNode
from isogal_ros.topics import LOSSLESS


class Activity:
    """Which publishers of a topic belong to a node that is active.

    Managed nodes publish each change of their state. One that leaves the state *active* counts as
    inactive until it says that it is active again, or until another process has its name.

    Parameters
    ----------
    node : GraphNode
        The one that wants to know.
    changed : callable
        Called with the name of a node and whether it is active, when that changes.
    """

    def __init__(self, node: GraphNode, changed: Callable[[str, bool], None]) -> None:
        self._node, self._changed = node, changed
        self._events: dict[str, str] = {}
        self._inactive: dict[str, frozenset[bytes]] = {}
        for name in node.settings.peers:
            if name != node.get_name():
                topic, hear = f"{name}/transition_event", partial(self._hear, name)
                made = node.create_subscription(TransitionEvent, topic, hear, LOSSLESS)
                self._events[name] = made.topic_name

    def publishers(self, topic: str) -> frozenset[bytes]:
        """Return what identifies the publishers of a topic whose nodes are active."""
        space = self._node.get_namespace().rstrip("/")
        inactive = {
            f"{space}/{name}"
            for name, known in self._inactive.items()
            if known == self._process(name)
        }
        every = self._node.publishers_of(topic)
        return frozenset(gid for gid, name in every.items() if name not in inactive)

    def _process(self, name: str) -> frozenset[bytes]:
        """Return what identifies the process that has a node's name."""
        return frozenset(self._node.publishers_of(self._events[name]))

    def _hear(self, name: str, event: TransitionEvent) -> None:
        if event.goal_state.id == State.PRIMARY_STATE_ACTIVE:
            if self._inactive.pop(name, None) is not None:
                self._changed(name, True)
        elif event.start_state.id == State.PRIMARY_STATE_ACTIVE:
            self._inactive[name] = self._process(name)
            self._changed(name, False)
