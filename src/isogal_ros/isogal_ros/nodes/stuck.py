"""Whether a value that should have noise has stopped moving.

Of an instrument that counts in coarse steps the same value may come several times. Of steps so
coarse that a value is repeated with probability p, the longest of 60 rests was about
log 60 / log(1/p) values, and one rest in 60**4 is four times as long."""


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
