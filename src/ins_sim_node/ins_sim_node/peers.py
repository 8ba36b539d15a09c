"""Which other nodes of the graph are ready, by their diagnostics."""

from collections.abc import Iterable

from diagnostic_msgs.msg import DiagnosticArray

from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import figures_of


class Peers:
    """The nodes of the same namespace that are not ready yet.

    Parameters
    ----------
    node : GraphNode
        The one that waits.
    names : iterable of str
        Nodes to wait for, except itself.
    """

    def __init__(self, node: GraphNode, names: Iterable[str]) -> None:
        self.missing = {name for name in names if name != node.get_name()}
        """Names of the nodes that have not reported that all their listeners are there."""
        self._space = node.get_namespace().strip("/")

    def hear(self, array: DiagnosticArray) -> None:
        """Take the diagnostics of nodes."""
        for item in array.status:
            space, _, name = item.name.rpartition("/")
            if space == self._space and figures_of(item).get("ready") == "True":
                self.missing.discard(name)
