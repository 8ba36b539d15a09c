"""Messages on pmht_mm/fix, paired with those on pmht_mm/information that belong to them."""

from collections.abc import Callable, Iterator
from typing import Any

from isogal.matching.interfaces import Information
from isogal_ros.messages.stamps import to_ns

Extra = tuple[bool, Information | None]
"""Content of a message on pmht_mm/information: whether the matcher found the navigator lost, and
the fix in information form (None = position and covariance say all)."""

KEPT = 4096
"""Messages on pmht_mm/information that are kept for fixes that are still to come."""
PATIENCE_NS = 30_000_000_000
"""How long a fix waits for the information that belongs to it, in the time of the stamps."""


class FixQueue:
    """Pairs the two topics by stamp; fixes leave in the order in which they came.

    Parameters
    ----------
    publishers : callable
        Returns how many publishers pmht_mm/information has; without any, no fix waits.
    """

    def __init__(self, publishers: Callable[[], int]) -> None:
        self._publishers = publishers
        self._waiting: list[Any] = []
        self._extras: dict[int, Extra] = {}

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add_fix(self, message: Any) -> None:
        """Take a NavSatFix."""
        self._waiting.append(message)

    def add_extra(self, ns: int, extra: Extra) -> None:
        """Take the information that belongs to the fix of a stamp."""
        self._extras[ns] = extra
        while len(self._extras) > KEPT:
            del self._extras[next(iter(self._extras))]

    def complete(self, now_ns: int) -> Iterator[tuple[Any, Extra]]:
        """Take out the fixes that need not wait any longer; the navigator is at a time (ns)."""
        while self._waiting:
            ns = to_ns(self._waiting[0].header.stamp)
            if ns not in self._extras and self._may_come(ns, now_ns):
                return
            yield self._waiting.pop(0), self._extras.pop(ns, (False, None))

    def _may_come(self, ns: int, now_ns: int) -> bool:
        """Whether the information of a stamp may still come: it is published in order, before the
        fix."""
        newest = next(reversed(self._extras), -1)
        return self._publishers() > 0 and newest <= ns and now_ns - ns < PATIENCE_NS
