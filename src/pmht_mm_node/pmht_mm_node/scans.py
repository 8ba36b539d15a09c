"""Scans in order of time, from readings and the navigator's states, which arrive separately."""

import math
from collections.abc import Callable
from typing import Any

from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.batching import BatchBuilder
from isogal.scenario import Scenario
from isogal.sensors.scans import missing_scans
from isogal_ros.messages.checks import BadMessageError, require_later
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.nav_queue import NavQueue
from isogal_ros.nodes.nav_sample import NavSample, moved

SILENT = 4
"""Scans that fail to come, one after the other, after which the instrument counts as silent."""


class Scans:
    """Holds readings until the navigator's state of their stamp is there.

    Parameters
    ----------
    node : GraphNode
        Listens and tells its health.
    scenario : Scenario
        Says how far scans are apart.
    first : callable
        Called with the navigator's state of the first scan before it is taken; may set `last`.
    taken : callable
        Called with the navigator's state and the reading (NaN = none) of each scan, in order of
        time.
    """

    def __init__(
        self,
        node: GraphNode,
        scenario: Scenario,
        first: Callable[[NavSample], None],
        taken: Callable[[NavSample, Any], None],
    ) -> None:
        self._health, self._first, self._taken = node.health, first, taken
        self._interval = from_seconds(scenario.gravimeter.interval)
        self._missing = 0
        self._newest = -1
        self.last = -1
        """Stamp of the last scan, ns; -1 = none."""
        self.guessed = False
        """Whether the navigator said nothing of that scan, so that its state is a guess."""
        self._queue = NavQueue(node, scenario, self._process, self._look)

    @property
    def silent(self) -> str | None:
        """That the navigator has gone on without a reading for long; None = it has not."""
        gone = self._queue.nav.newest - self._newest
        if self._newest < 0 or gone <= SILENT * self._interval:
            return None
        return f"no readings for {to_seconds(gone):.0f} s"

    def _look(self) -> None:
        """Say that readings fail to come, by the time of the stamps."""
        self._health.concern("silent", self.silent)

    def before(self, ns: int) -> int:
        """Return how many scans there have been before the one of a stamp, counted from zero."""
        return max(round(ns / self._interval) - 1, 0)

    @property
    def waiting(self) -> int:
        """Number of readings for which the navigator's state is still to come."""
        return len(self._queue.waiting)

    def begin(self, ns: int) -> None:
        """Note that a reading of a stamp came, whatever is in it; raises BadMessageError unless it
        is later than all before."""
        require_later(ns, self._newest)
        self._newest = ns

    def add(self, ns: int, reading: Any) -> None:
        """Take a reading; NaN = the scan took place and gave nothing."""
        self._queue.put(ns, reading)

    def correct(self, builder: BatchBuilder, until: int) -> None:
        """Tell a builder of the navigator's jumps before a stamp (ns), and of the gaps in its
        states that ended by then."""
        for gap in self._queue.nav.take_gaps(until):
            self._carry_jumps(builder, gap.after.ns)
            before, after = gap.before, gap.after
            if len(before.covariance) == len(after.covariance) == BATCH_STATES:
                times = to_seconds(before.ns), to_seconds(after.ns)
                builder.bridge(times[0], before.covariance, times[1], after.covariance)
        self._carry_jumps(builder, until)

    def _carry_jumps(self, builder: BatchBuilder, before: int) -> None:
        for jump in self._queue.nav.take_jumps(before):
            builder.correct(to_seconds(jump.ns), jump.change)

    def _process(self, ns: int, reading: Any, nav: NavSample | None) -> None:
        if nav is not None:
            if self.last < 0:
                self._first(nav)
            if self.last >= 0:
                self._fill_missing(nav)
            self._scan(nav, reading)

    def _fill_missing(self, now: NavSample) -> None:
        """Add scans without reading where messages are missing, so that batches keep their length
        in time."""
        stamps = missing_scans(self.last, now.ns, self._interval)
        text = f"{len(stamps)} scans missing before {to_seconds(now.ns):.0f} s"
        self._health.concern("gap", text if len(stamps) >= SILENT else None)
        for stamp in stamps:
            self._missing += 1
            self._health.figures["scans missing"] = self._missing
            try:
                nav = self._queue.nav.at(stamp)
            except BadMessageError:
                nav = None
            # without a reading it does not matter much where the navigator was
            self.guessed = nav is None
            self._scan(nav or moved(now, stamp), math.nan)
        self.guessed = False

    def _scan(self, nav: NavSample, reading: Any) -> None:
        self.last = nav.ns
        self._taken(nav, reading)
