"""Scans in order of time, from readings and the navigator's states, which arrive separately."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.map_matching import MapMatching
from isogal.matching.registry import leading_field
from isogal.sensors.scans import missing_scans
from isogal_ros.messages.checks import BadMessageError, require_later
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.nav_queue import Jump, NavQueue, NavSample, moved

Reading = tuple[Array | float, Array | float]
"""A reading, NaN = none, and its variance."""
SILENT = 4
"""Scans that fail to come, one after the other, after which the instrument counts as silent."""


@dataclass(slots=True)
class _Field:
    """What has come of one field."""

    interval: int
    """ns between its scans."""
    newest: int = -1
    """Stamp of the newest reading, ns; -1 = none."""
    last: int = -1
    """Stamp of the last scan taken."""

    @property
    def due(self) -> int:
        """Stamp of the next reading."""
        return max(self.newest, 0) + self.interval


class Scans(NavQueue[tuple[int, Reading]]):
    """Holds readings until the navigator's state of their stamp is there, and those of other
    fields up to it, or their time is over.

    Parameters
    ----------
    node : GraphNode
        Listens and tells its health; its scenario says how far scans are apart.
    first : callable
        Called with the navigator's state of the first scan before it is taken; may set `last`.
    taken : callable
        Called with the field's place in the list of fields, the navigator's state, the reading
        (NaN = none) and its variance of each scan, in order of time; at one stamp with the field
        that says when batches end last.
    """

    def __init__(
        self,
        node: GraphNode,
        first: Callable[[NavSample], None],
        taken: Callable[[int, NavSample, Array | float, Array | float], None],
    ) -> None:
        super().__init__(node, self._take_scan)
        self._first, self._taken = first, taken
        each = node.scenario.each_field
        self._fields = [_Field(from_seconds(one.gravimeter.interval)) for one in each]
        self._names, self._lead = node.scenario.field_names, leading_field(each)
        self._begun = False
        self.ended = -1
        """Stamp of the last batch end, ns; readings up to it are too late."""
        self.guessed = False
        """Whether the navigator said nothing of the last scan, so that its state is a guess."""

    @property
    def last(self) -> tuple[int, ...]:
        """Stamp of the last scan of each field, ns; -1 = none."""
        return tuple(field.last for field in self._fields)

    def go_on(self, last: Sequence[int]) -> None:
        """Go on after the last scans of an earlier process, or begin (-1)."""
        for field, stamp in zip(self._fields, last, strict=True):
            field.last = stamp
        self._begun = max(last) >= 0
        self.ended = -1

    def begin_anew(self) -> None:
        """Forget all that has come: time may begin anew."""
        super().begin_anew()
        for field in self._fields:
            field.newest = -1
        self.go_on([-1] * len(self._fields))

    def arrived(self) -> None:
        """Say that readings fail to come while the navigator goes on, by the time of the
        stamps."""
        said = None
        for name, field in zip(self._names, self._fields, strict=True):
            gone = self.newest - field.newest
            if field.newest >= 0 and gone > SILENT * field.interval:
                of = f" of {name}" if len(self._fields) > 1 else ""
                said = f"no readings{of} for {to_seconds(gone):.0f} s"
        self._health.concern("silent", said)

    def before(self, ns: int, field: int = 0) -> int:
        """Return how many scans of a field there have been before the one of a stamp, counted from
        zero."""
        return max(round(ns / self._fields[field].interval) - 1, 0)

    def begin(self, ns: int, field: int = 0) -> None:
        """Note that a reading of a stamp came, whatever is in it; raises BadMessageError unless it
        is later than all before."""
        require_later(ns, self._fields[field].newest)
        self._fields[field].newest = ns
        if ns <= self.ended and field != self._lead:
            raise BadMessageError("it comes after the end of its batch")

    def add(self, ns: int, reading: Reading, field: int = 0) -> None:
        """Take a reading and its variance; NaN = the scan took place and gave nothing."""
        rank = len(self._fields) if field == self._lead else field
        self.put(ns, (field, reading), rank)

    def in_turn(self, ns: int) -> bool:
        """Whether no field may still give a reading up to a stamp: none is due, or the navigator
        has gone on by an interval since."""
        each = self._fields
        return all(one.due > ns or self.newest >= one.due + one.interval for one in each)

    def correct(self, matching: MapMatching, until: int) -> None:
        """Tell the matching of the navigator's jumps before a stamp (ns), and of the gaps in its
        states that ended by then."""
        for change in self.take_changes(until):
            if isinstance(change, Jump):
                matching.correct(to_seconds(change.ns), change.change)
                continue
            before, after = change
            if len(before.covariance) == len(after.covariance) == BATCH_STATES:
                times = to_seconds(before.ns), to_seconds(after.ns)
                matching.bridge(times[0], before.covariance, times[1], after.covariance)

    def _take_scan(self, ns: int, item: tuple[int, Reading], nav: NavSample | None) -> None:
        if nav is None:
            return
        k, reading = item
        if not self._begun:
            self._begun = True
            self._first(nav)
        if self._fields[k].last >= 0:
            self._fill_missing(k, nav)
        self._scan(k, nav, reading)

    def _fill_missing(self, k: int, now: NavSample) -> None:
        """Add scans without reading where messages are missing, so that batches keep their length
        in time."""
        field = self._fields[k]
        stamps = missing_scans(field.last, now.ns, field.interval)
        text = f"{len(stamps)} scans missing before {to_seconds(now.ns):.0f} s"
        name = "gap" if k == self._lead else f"gap of {self._names[k]}"
        self._health.concern(name, text if len(stamps) >= SILENT else None)
        for stamp in stamps:
            self._health.count("scans missing")
            try:
                nav = self.at(stamp)
            except BadMessageError:
                nav = None
            # without a reading it does not matter much where the navigator was
            self.guessed = nav is None
            self._scan(k, nav or moved(now, stamp), (math.nan, 0.0))
        self.guessed = False

    def _scan(self, k: int, nav: NavSample, reading: Reading) -> None:
        self._fields[k].last = nav.ns
        self._taken(k, nav, *reading)
