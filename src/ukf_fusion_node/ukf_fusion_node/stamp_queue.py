"""Messages that wait for the navigator to reach their stamps: each stamp is used once."""

from typing import Generic, TypeVar

from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamps import to_seconds

KEPT = 8192
"""Messages that wait at most, and stamps kept of those that have come: of fixes hours, more than
the filter goes back."""

Item = TypeVar("Item")


class StampQueue(Generic[Item]):
    """Says which messages of a topic are to be used now, in whatever order they come.

    Parameters
    ----------
    ahead : int
        How far ahead of the navigator a message may be to wait for it, ns.
    """

    def __init__(self, ahead: int = 0) -> None:
        self._ahead = ahead
        self._known: dict[int, None] = {}
        self._waiting: dict[int, Item] = {}

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add(self, ns: int, item: Item) -> None:
        """Take a message of a stamp; raises BadMessageError where there has been one of it, or too
        many wait."""
        if ns == 0:  # within the horizon at a run's beginning, and a measurement of much later
            raise BadMessageError("stamp is zero: not set")
        if ns in self._known:
            raise BadMessageError(f"one of {to_seconds(ns):.3f} s has come before")
        if len(self._waiting) >= KEPT:
            raise BadMessageError(f"more than {KEPT} wait for the navigator")
        if len(self._known) >= KEPT:
            del self._known[next(iter(self._known))]
        self._known[ns], self._waiting[ns] = None, item

    def due(self, now: int) -> list[tuple[int, Item]]:
        """Take out stamps and messages, oldest first, that need not wait any longer for the
        navigator, which is at a time (ns): it has reached them, or they are so far ahead that they
        are to be refused."""
        found = sorted(ns for ns in self._waiting if not 0 < ns - now <= self._ahead)
        return [(ns, self._waiting.pop(ns)) for ns in found]

    def forget(self) -> None:
        """Forget all: time may begin anew."""
        self._known.clear()
        self._waiting.clear()
