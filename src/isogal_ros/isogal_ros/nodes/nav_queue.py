"""Items that wait for the navigator's state of their stamp."""

from collections.abc import Callable
from typing import Any

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.nav_buffer import NavBuffer
from isogal_ros.nodes.nav_sample import NavSample

LONGEST = 1024
"""Items that wait at most."""


class NavQueue:
    """Hands each item on, in the order they came, once the navigator's state is there. Where too
    many wait, the oldest is handed on without.

    Parameters
    ----------
    node : GraphNode
        Listens to the navigator and tells its health.
    scenario : Scenario
        For `NavBuffer`.
    handle : callable
        Called with stamp (ns), item, and the navigator's state; None = it said nothing usable of
        that stamp.
    arrived : callable
        Called without arguments when something of the navigator has come.
    """

    def __init__(
        self,
        node: GraphNode,
        scenario: Scenario,
        handle: Callable[[int, Any, NavSample | None], None],
        arrived: Callable[[], None] = lambda: None,
    ) -> None:
        self.waiting: list[tuple[int, Any]] = []
        """Stamps and items."""
        self._health, self._handle, self._arrived = node.health, handle, arrived
        self.nav = NavBuffer(node, scenario, self._process)

    def put(self, ns: int, item: Any) -> None:
        """Take an item."""
        self.waiting.append((ns, item))
        self._process()

    def _process(self) -> None:
        """Deal with the waiting items as far as the navigator's states reach."""
        self._arrived()
        while self.waiting:
            ns, item = self.waiting[0]
            try:
                nav = self.nav.at(ns)
                if nav is None and len(self.waiting) <= LONGEST:
                    return
                if nav is None:
                    raise BadMessageError(f"more than {LONGEST} readings wait for the navigator")
            except BadMessageError as error:
                self._health.drop(topics.NAV_ODOM.name, str(error))
                nav = None
            del self.waiting[0]
            self._handle(ns, item, nav)
            self._health.tick(ns)
