"""Readings and the navigator's states, which come apart and at any time, put together as scans in
order."""

import math
from collections.abc import Callable
from typing import Any

from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import BadMessageError
from isogal_ros.nodes.nav_buffer import Jump, NavBuffer, NavSample

MOST_MISSING = 1000
"""Longest run of missing scans that is filled in, scans."""


class Scans:
    """Holds readings until the navigator's state of their stamp is there.

    Parameters
    ----------
    node : GraphNode
        Listens and tells its health.
    scenario : Scenario
        Says how far scans are apart.
    taken : callable
        Called with the navigator's state and the reading (NaN = none) of each scan, in order of
        time.
    """

    def __init__(
        self, node: GraphNode, scenario: Scenario, taken: Callable[[NavSample, Any], None]
    ) -> None:
        self.waiting: list[tuple[int, Any]] = []
        """Readings (stamp, value) for which the navigator's state is still to come."""
        self._health = node.health
        self._interval = from_seconds(scenario.gravimeter.interval)
        self._taken = taken
        self._missing = 0
        self._newest, self._last = -1, -1
        self._nav = NavBuffer(node, scenario, self._process)

    def require_later(self, ns: int) -> None:
        """Raise BadMessageError unless a stamp is later than those of all readings so far, and
        note it."""
        if ns <= self._newest:
            raise BadMessageError(
                f"stamp {to_seconds(ns):.3f} s is not later than {to_seconds(self._newest):.3f} s"
            )
        self._newest = ns

    def add(self, ns: int, reading: Any) -> None:
        """Take a reading; NaN = the scan took place and gave nothing."""
        self.waiting.append((ns, reading))
        self._process()

    def take_jumps(self, before: int) -> list[Jump]:
        """Take out the navigator's jumps with stamps earlier than `before` (ns), oldest first."""
        return self._nav.take_jumps(before)

    def _process(self) -> None:
        """Deal with the waiting readings as far as the navigator's states reach."""
        while self.waiting:
            ns, reading = self.waiting[0]
            try:
                nav = self._nav.at(ns)
                if nav is None:
                    return
            except BadMessageError as error:
                self._health.drop(topics.NAV_ODOM.name, str(error))
                nav = None
            del self.waiting[0]
            if nav is not None:
                self._fill_missing(ns)
                self._scan(nav, reading)
            self._health.tick(ns)

    def _fill_missing(self, ns: int) -> None:
        """Add scans without reading where messages are missing, so that batches keep their length
        in time."""
        if self._last < 0:
            return
        expected = [self._last + i * self._interval for i in range(1, MOST_MISSING)]
        for stamp in expected:
            if stamp > ns - self._interval // 2:
                break
            self._missing += 1
            self._health.figures["scans missing"] = self._missing
            try:
                nav = self._nav.at(stamp)
            except BadMessageError:
                continue
            if nav is not None:
                self._scan(nav, math.nan)

    def _scan(self, nav: NavSample, reading: Any) -> None:
        self._last = nav.ns
        self._taken(nav, reading)
