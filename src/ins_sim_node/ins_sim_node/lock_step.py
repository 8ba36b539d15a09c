"""Which answers a step needs before the next one may come."""

from isogal.matching.batching import fix_due
from isogal.scenario import Scenario
from isogal_ros.messages.stamps import to_seconds


class LockStep:
    """Counts the answers to the step under way.

    Every step is answered by ``nav/odom`` of its stamp; a scan also by the reduced reading; a
    batch end also by ``pmht_mm/fix`` of its stamp (a fix, or none). The filter answers every
    message on ``pmht_mm/fix`` with ``nav/odom`` of its newest stamp, so there are as many of those
    as there were fixes, and one more."""

    def __init__(self, scenario: Scenario) -> None:
        self.ns = -1
        """Stamp of the step under way."""
        self._per_scan = scenario.steps_per_scan
        self._settings = scenario.matcher
        self._nav = self._fixes = 0
        self._needs_reading = self._needs_fix = False
        self._done = True
        self.absent: set[str] = set()
        """Answers that nobody gives at present: nav, reading, fix."""

    def forget(self) -> None:
        """Wait no longer for the answers to the step under way."""
        self._done = True

    def begin(self, step: int, ns: int) -> None:
        """Start a step; step 0, the start, has no IMU sample and needs no answer."""
        self.ns = ns
        self._nav = self._fixes = 0
        scans, rest = divmod(step, self._per_scan)
        is_scan = step > 0 and rest == 0
        self._needs_reading = is_scan and "reading" not in self.absent
        self._needs_fix = is_scan and not self.absent and fix_due(scans, self._settings)
        self._done = step == 0 or "nav" in self.absent

    @property
    def complete(self) -> bool:
        """Whether all answers are there."""
        return self._done

    def nav(self, ns: int) -> bool:
        """Count ``nav/odom``; return whether it completed the step, as the other methods do."""
        self._nav += ns == self.ns
        return self._check()

    def reading(self, ns: int) -> bool:
        """Note a reduced reading."""
        if ns == self.ns:
            self._needs_reading = False
        return self._check()

    def fix(self, ns: int) -> bool:
        """Count a message on ``pmht_mm/fix``; in retrodiction mode those of earlier scans come
        first."""
        self._fixes += 1
        if ns == self.ns:
            self._needs_fix = False
        return self._check()

    def missing(self) -> str:
        """Say what is still to come."""
        lacking = []
        if self._nav < 1 + self._fixes:
            lacking.append(f"nav/odom ({self._nav} of {1 + self._fixes})")
        if self._needs_reading:
            lacking.append("the reduced gravimeter reading")
        if self._needs_fix:
            lacking.append("pmht_mm/fix")
        return f"missing {', '.join(lacking)} of stamp {to_seconds(self.ns):.3f} s"

    def _check(self) -> bool:
        if self._done or self._needs_reading or self._needs_fix or self._nav < 1 + self._fixes:
            return False
        self._done = True
        return True
