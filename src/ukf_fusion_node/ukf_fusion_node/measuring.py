"""What became of measurements, counted by the topic that they come from."""

import math
from collections import deque

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from isogal.fusion.measurements import Innovation, Outcome
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.health import ERROR, OK, WARN, Health, status

SEVERAL = 3
"""So many beyond the gate in a row are no outliers: what measures is wrong, or the navigator."""
JUDGED = 100
"""Measurements over which the mean of the normalised innovations squared is judged."""
LIKELY = 0.5, 2.0
"""What it may be: of 100 numbers of one dimension its 1-sigma is sqrt(2 / 100) = 0.14, so that
honest ones are outside once in 2,000 below and never above; slow errors that are no states, and
covariances that are rounded up, are what is found."""
LOST_AFTER = 3.0
"""Intervals without a measurement that is used, after which an aid is not in use."""


class Measured:
    """Counts the measurements of one topic, and says in the diagnostics what is wrong with them.

    Parameters
    ----------
    topic : str
    health : Health
    interval : float
        s between measurements.
    """

    def __init__(self, topic: str, health: Health, interval: float = 0.0) -> None:
        self._topic, self._health = topic, health
        self._silent = from_seconds(LOST_AFTER * interval)
        self.used = self.not_used = 0
        self.newest = -1
        """Stamp of the last measurement that was used; -1 = there was none."""
        self.why = "nothing has come yet"
        """Why the last was not used."""
        self._in_a_row = 0
        self._seen: deque[tuple[float, int]] = deque(maxlen=JUDGED)
        """Normalised innovation squared and dimensions of the newest measurements that were
        used."""

    def judge(self, result: Innovation) -> None:
        """Note whether a measurement was beyond the gate; one that was not ends a row."""
        rejected = result.outcome is Outcome.REJECTED
        self._in_a_row = self._in_a_row + 1 if rejected else 0
        if rejected:
            self._health.count(f"{self._topic} rejected")
        row = (
            f"{self._in_a_row} in a row on {self._topic} rejected: measurement or navigator wrong"
        )
        several = self._in_a_row >= SEVERAL
        self._health.concern(f"rejecting {self._topic}", row if several else None, ERROR)

    def take(self, stamp: int, result: Innovation) -> None:
        """Note what became of a measurement of a stamp (ns), and drop one that was not used with
        what is wrong with it."""
        if result.outcome is not Outcome.REFUSED:
            self.judge(result)
        if not result.used:
            why = result.reason or "not used"
            self.absent(why)
            if result.outcome is Outcome.REJECTED and result.expected.any():  # not of positions
                with np.printoptions(precision=3, suppress=True):
                    why = f"{result.measured} where {result.expected} was expected: {why}"
            self._health.drop(self._topic, why)
            return
        self.newest, self.used = max(stamp, self.newest), self.used + 1
        self._health.figures[f"{self._topic} used"] = self.used
        if math.isfinite(result.nis):  # it is not known while a navigator is being aligned
            self._seen.append((result.nis, max(1, len(result.innovation))))
        unlike = len(self._seen) == JUDGED and not LIKELY[0] <= self.nis <= LIKELY[1]
        times = f"{math.sqrt(self.nis):.2g} times"
        text = f"{self._topic}: innovations are {times} as large as its covariance says"
        self._health.concern(f"noise {self._topic}", text if unlike else None)

    def absent(self, why: str) -> None:
        """Note that a message could not be used, and why."""
        self.not_used, self.why = self.not_used + 1, why

    @property
    def has_come(self) -> bool:
        """Whether there was any message."""
        return self.used + self.not_used > 0

    def in_use(self, ns: int) -> bool:
        """Whether measurements are used at a stamp (ns)."""
        return self.newest >= 0 and ns - self.newest <= self._silent

    @property
    def nis(self) -> float:
        """Mean normalised innovation squared per dimension of the newest that were used."""
        return sum(one for one, _ in self._seen) / max(1, sum(size for _, size in self._seen))

    def status(self, name: str, used: bool) -> DiagnosticStatus:
        """Return what there is to say of the aid, under a name."""
        newest = to_seconds(self.newest) if self.newest >= 0 else None
        since = "never" if newest is None else f"not since {newest:.0f} s"
        figures = {
            "used": self.used,
            "not used": self.not_used,
            "last used": newest,
            "normalised innovation squared": self.nis,
        }
        text = "used" if used else f"{since}: {self.why}"
        return status(name, OK if used else WARN, text, figures)
