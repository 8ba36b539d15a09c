"""What the graph answers to a step."""

from collections.abc import Callable
from functools import partial

from ins_sim_node.lock_step import LockStep, reading_of
from ins_sim_node.outputs import Outputs
from ins_sim_node.peers import Activity
from isogal_ros import topics
from isogal_ros.messages.adapter import adapter_of
from isogal_ros.messages.stamps import peek_ns
from isogal_ros.nodes.base import GraphNode


class Answers:
    """Listens to the answers and tells when they are complete. It does so while the simulator is
    not active, too: an answer that it let go would be waited for in vain once it goes on.

    Parameters
    ----------
    node : GraphNode
        Listens.
    outputs : Outputs
        Compares the navigation with the truth.
    complete : callable
        Called without arguments when the last answer to a step has come.
    """

    def __init__(self, node: GraphNode, outputs: Outputs, complete: Callable[[], None]) -> None:
        self.lock_step = LockStep(node.scenario)
        self._outputs, self._complete = outputs, complete
        self._topics = {
            "nav": self._hear(node, topics.NAV_ODOM, self._take_nav),
            "fix": self._hear(node, topics.FIX, self._take_fix),
        }
        for field, one in enumerate(node.scenario.each_field):
            take = partial(self._take_reading, field)
            self._topics[reading_of(field)] = self._hear(node, adapter_of(one).reduced, take)
        self._node = node
        self._known: frozenset[bytes] | None = None
        self.activity = Activity(node)

    @staticmethod
    def _hear(node: GraphNode, topic: topics.Topic, take: Callable[[bytes], None]) -> str:
        """Listen to a topic; return its resolved name."""
        return node.hear(topic, partial(node.guard, topic, take), raw=True).topic_name

    def publishers(self) -> frozenset[bytes]:
        """Return what identifies the publishers of the answers: of a node that was started again
        they are others."""
        return frozenset(
            bytes(info.endpoint_gid)
            for name in self._topics.values()
            for info in self._node.get_publishers_info_by_topic(name)
        )

    def note_peers(self) -> None:
        """Take those who answer now as those who will answer."""
        self._known = self.publishers()

    def peers_changed(self) -> bool:
        """Whether one who answered has left, or another has come, since they were noted."""
        return self.publishers() != self._known

    def absent(self) -> set[str]:
        """Return which answers nobody publishes who is active."""
        return {what for what, name in self._topics.items() if not self.activity.publishers(name)}

    def _take_nav(self, data: bytes) -> None:
        ns = peek_ns(data)
        if ns == self.lock_step.ns:
            self._outputs.compare(data)
        self._tell(self.lock_step.nav(ns))

    def _take_fix(self, data: bytes) -> None:
        self._tell(self.lock_step.fix(peek_ns(data)))

    def _take_reading(self, field: int, data: bytes) -> None:
        self._tell(self.lock_step.reading(peek_ns(data), field))

    def _tell(self, complete: bool) -> None:
        if complete:
            self._complete()
