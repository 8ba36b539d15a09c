"""How many messages a second go on."""

EARLY = 0.05
"""Of the interval, by which a message may come before its time: stamps jitter."""


class Pace:
    """Says which messages go on: so many a second on average.

    Parameters
    ----------
    interval : int
        ns from one to the next.
    """

    def __init__(self, interval: int) -> None:
        self._interval = interval
        self._due: int | None = None

    def takes(self, ns: int) -> bool:
        """Whether a message of a stamp (ns) goes on."""
        due = ns if self._due is None else self._due
        late, early = ns - due, EARLY * self._interval
        if -2 * self._interval <= late < -early:
            return False
        # one that is late does not hold up the next; after a gap, or a jump back, time begins anew
        in_step = -early <= late < self._interval
        self._due = (due if in_step else ns) + self._interval
        return True
