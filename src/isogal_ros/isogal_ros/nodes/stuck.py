"""Whether stamps and values may be: stamps that jump ahead, values that have stopped moving.

Of an instrument that counts in coarse steps the same value may come several times. Of steps so
coarse that a value is repeated with probability p, the longest of 60 rests was about
log 60 / log(1/p) values, and one rest in 60**4 is four times as long."""

from isogal_ros.messages.checks import BadMessageError


class Repetitions:
    """Counts how often a value comes again.

    Parameters
    ----------
    least : int
        Repetitions that are taken for noise of coarse steps at any rate; of a value that has
        rested as often as n times four times as many, and four.
    learnt : int, optional
        Changes after which it is known how long the value rests.
    """

    def __init__(self, least: int, learnt: int = 0) -> None:
        self._least, self._learnt = least, learnt
        self._last: object = None
        self._changes = self._longest = 0
        self.count = 0
        """How often the newest value has come again."""

    def take(self, value: object) -> None:
        """Take the next value; one that is not a number never comes again."""
        if value == self._last:
            self.count += 1
            return
        if self.count < self._limit:
            self._longest = max(self._longest, self.count)
        self._changes += 1
        self.count, self._last = 0, value

    @property
    def _limit(self) -> int:
        return max(self._least, 4 * (self._longest + 1))

    @property
    def unusual(self) -> bool:
        """Whether the newest value has come again more often in a row than any before it, once the
        value has changed `least` times. To let such values go costs little where they are true:
        in all as many as the longest rest has repetitions."""
        return self._changes > self._least and self.count > self._longest

    @property
    def beyond(self) -> int | None:
        """By how many repetitions more than noise explains it has stopped; None = it has not."""
        known = self._changes >= self._learnt and self.count >= self._limit
        return self.count - self._limit if known else None


class TimeJumps:
    """Does without a message whose stamp jumps ahead until the next one says that time has passed:
    a single wrong stamp would make the filter bridge hours, and have all messages after it
    refused.

    Parameters
    ----------
    longest : int
        Longest gap that is believed at once, ns.
    back : bool, optional
        Whether this is asked of stamps that jump back as well.
    """

    def __init__(self, longest: int, back: bool = False) -> None:
        self._longest, self._back = longest, back
        self._held: int | None = None

    def check(self, ns: int, newest: int) -> None:
        """Look at a stamp after the newest that was used; raises BadMessageError where it has to
        wait for the next."""
        ahead = ns - newest
        if ahead <= self._longest and not (self._back and ahead < -self._longest):
            self._held = None
            return
        held, self._held = self._held, ns
        if held is None or not 0 < ns - held <= self._longest:
            way = "ahead" if ahead > 0 else "back"
            raise BadMessageError(
                f"stamp is {abs(ahead) / 1e9:.0f} s {way}; used if the next one is, too"
            )
