"""Which answers a step needs before the next one may come."""

from isogal.matching.batching import fix_due
from isogal.matching.several import Rhythm
from isogal.scenario import Scenario
from isogal_ros.messages.stamps import to_seconds


def reading_of(field: int) -> str:
    """Return what the answer of a field is called, by its place in the list of fields."""
    return f"reading {field}" if field else "reading"


class LockStep:
    """Counts the answers to the step under way.

    Every step is answered by ``nav/odom`` of its stamp; a scan also by the reduced reading, of
    each field that has one; a batch end also by ``pmht_mm/fix`` of its stamp (a fix, or none). The
    filter answers every message on ``pmht_mm/fix`` with ``nav/odom`` of its newest stamp, so there
    are as many of those as there were fixes, and one more."""

    def __init__(self, scenario: Scenario) -> None:
        self.ns = -1
        """Stamp of the step under way."""
        each = scenario.each_field
        self._per_scan = [one.steps_per_scan for one in each]
        self._lead = Rhythm.of(each).lead
        self._settings = each[self._lead].matcher
        self._nav = self._fixes = 0
        self._needs_readings: set[int] = set()
        self._needs_fix = self._takes_fixes = False
        self._done = True
        self._full = True
        self.answered = 0
        """How many steps, begun while nothing was absent, have had all their answers."""
        self.absent: set[str] = set()
        """Answers that nobody gives at present: nav, fix, and those of `reading_of`."""

    def forget(self) -> None:
        """Wait no longer for the answers to the step under way."""
        self._done = True

    def begin(self, step: int, ns: int) -> None:
        """Start a step; step 0, the start, has no IMU sample and needs no answer."""
        self.ns = ns
        self._nav = self._fixes = 0
        scanned = {k for k, steps in enumerate(self._per_scan) if step > 0 and step % steps == 0}
        self._needs_readings = {k for k in scanned if reading_of(k) not in self.absent}
        scans = step // self._per_scan[self._lead]
        is_end = self._lead in scanned and fix_due(scans, self._settings)
        self._needs_fix = self._takes_fixes = is_end and not self.absent
        self._done = step == 0 or "nav" in self.absent
        self._full = not self.absent

    @property
    def complete(self) -> bool:
        """Whether all answers are there."""
        return self._done

    def nav(self, ns: int) -> bool:
        """Count ``nav/odom``; return whether it completed the step, as the other methods do."""
        self._nav += ns == self.ns
        return self._check()

    def reading(self, ns: int, field: int = 0) -> bool:
        """Note a reduced reading of a field."""
        if ns == self.ns:
            self._needs_readings.discard(field)
        return self._check()

    def fix(self, ns: int) -> bool:
        """Count a message on ``pmht_mm/fix``; in retrodiction mode those of earlier scans come
        first. One of an earlier step, which was not waited for, may have been answered before
        this step began."""
        self._fixes += self._takes_fixes
        if ns == self.ns:
            self._needs_fix = False
        return self._check()

    def missing(self) -> str:
        """Say what is still to come."""
        lacking = []
        if self._nav < 1 + self._fixes:
            lacking.append(f"nav/odom ({self._nav} of {1 + self._fixes})")
        if self._needs_readings:
            lacking.append("the reduced reading")
        if self._needs_fix:
            lacking.append("pmht_mm/fix")
        return f"missing {', '.join(lacking)} of stamp {to_seconds(self.ns):.3f} s"

    def _check(self) -> bool:
        if self._done or self._needs_readings or self._needs_fix or self._nav < 1 + self._fixes:
            return False
        self._done = True
        self.answered += self._full
        return True
