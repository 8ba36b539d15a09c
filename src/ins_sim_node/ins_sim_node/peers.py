"""Whether the other nodes of the graph are there, as their diagnostics say."""

from collections.abc import Iterable

from diagnostic_msgs.msg import DiagnosticArray

from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import figures_of


class Peers:
    """The nodes of one's namespace that are still to come up.

    Parameters
    ----------
    node : GraphNode
        The one that waits; it does not wait for itself.
    names : iterable of str
    """

    def __init__(self, node: GraphNode, names: Iterable[str]) -> None:
        self.missing = {name for name in names if name != node.get_name()}
        """Names of those that have not said that all their listeners are there."""
        self._space = node.get_namespace().strip("/")

    def hear(self, array: DiagnosticArray) -> None:
        """Take what nodes say about themselves."""
        for item in array.status:
            space, _, name = item.name.rpartition("/")
            if space == self._space and figures_of(item).get("ready") == "True":
                self.missing.discard(name)
