"""Which readings of an instrument are scans, and which scans are missing. Times are whole numbers
of any unit, so that equal times compare equal; the nodes have nanoseconds."""

EARLY = 0.25
"""How much too early a reading may be, in intervals: an instrument's clock need not be as regular
as the scans."""
MOST_MISSING = 1000
"""Scans of a gap that are counted as missing; a longer gap is not filled to its end."""


class Thinning:
    """Says which readings of an instrument are scans.

    Scans stay an interval apart on average, whatever the instrument's rate. An instrument as slow
    as the scans, or slower, loses nothing.

    Parameters
    ----------
    interval : int
        Between scans.
    early : float
        How much too early a reading may be, in intervals.
    """

    def __init__(self, interval: int, early: float = EARLY) -> None:
        self._interval, self._early = interval, early
        self._due = -interval  # long ago: the first reading is a scan

    def takes(self, time: int) -> bool:
        """Whether the reading of a time is a scan; times increase, or begin anew further back than
        two intervals."""
        late = time - self._due
        if -2 * self._interval <= late < -self._early * self._interval:
            return False
        # a later reading is not of a faster instrument: there is a gap, or the instrument is slow
        in_time = abs(late) <= (1.0 - self._early) * self._interval
        self._due = (self._due if in_time else time) + self._interval
        return True


def missing_scans(last: int, now: int, interval: int) -> range:
    """Return the times at which scans should have been between two that were taken, at most
    `MOST_MISSING`; the newer one may be up to half an interval late."""
    return range(last + interval, now - interval // 2 + 1, interval)[:MOST_MISSING]
