"""When the simulation may begin."""

from typing import Any

from ins_sim_node.peers import Peers

UNLOCKED_START = 2.0
"""s of wall time that a simulation without lock-step leaves others to come up."""


class Start:
    """Says when all is ready for the first step, and fails the node where it never is.

    Parameters
    ----------
    node : InsSimNode
    peers : Peers
        The others.
    """

    def __init__(self, node: Any, peers: Peers) -> None:
        self._node, self._peers = node, peers

    def may_begin(self, waited: float) -> bool:
        """Return whether the first step may come, `waited` s of wall time after the start."""
        node = self._node
        if node.settings.lock_step:
            ready = node.ready and not self._peers.missing
        else:
            ready = node.ready or waited > UNLOCKED_START
        if not ready and waited > node.settings.start_timeout:
            reasons = [f"{name} is not ready" for name in sorted(self._peers.missing)]
            reasons += [f"listeners of {text}" for text in node.missing_listeners()]
            node.fail(
                f"cannot begin after {node.settings.start_timeout:g} s: {'; '.join(reasons)}"
            )
        return ready
