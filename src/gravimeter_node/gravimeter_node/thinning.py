"""One reading per scan of an instrument that gives more."""

EARLY = 0.25
"""How much too early a reading may be, in intervals: the instrument's clock need not be as regular
as the scans."""


class Thinning:
    """Says which readings of an instrument are scans.

    Scans stay an interval apart on average, whatever the rate. An instrument as slow as the scans,
    or slower, loses nothing.

    Parameters
    ----------
    interval_ns : int
        Between scans.
    """

    def __init__(self, interval_ns: int) -> None:
        self._interval = interval_ns
        self._due = -interval_ns  # long ago: the first reading is a scan

    def takes(self, ns: int) -> bool:
        """Whether the reading of a stamp is a scan; stamps increase."""
        if ns < self._due - EARLY * self._interval:
            return False
        # what comes later than this is no faster instrument's: there is a gap, or it is a slow one
        in_time = ns <= self._due + (1.0 - EARLY) * self._interval
        self._due = (self._due if in_time else ns) + self._interval
        return True
