"""What comes on pmht_mm/information, a whole fix in one message, and on pmht_mm/fix, its position
for all others: each stamp is used once, in whatever order the messages come."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from sensor_msgs.msg import NavSatFix

from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamps import to_seconds
from isogal_ros.messages.whole_fix import WholeFix

Content: TypeAlias = WholeFix | NavSatFix
KEPT = 8192
"""Stamps kept of fixes, of those that wait and of those that were used: hours of them: more
than the filter goes back."""
PATIENCE = 30.0
"""s of wall time that a position waits, from its arrival on, for the whole fix of its stamp."""


@dataclass(slots=True)
class _Stamp:
    """What has come of a stamp."""

    content: Content | None = None
    """While it waits to be used."""
    arrived: float = 0.0
    used: bool = False
    position_came: bool = False


class FixQueue:
    """Says which fixes are to be used now.

    Parameters
    ----------
    publishers : callable
        Returns how many publishers pmht_mm/information has; without any, a position is all there
        is and waits for nothing.
    ahead_ns : int
        How far ahead of the navigator a fix may be to wait for it, ns.
    clock : callable
        Wall time, s.
    """

    def __init__(
        self,
        publishers: Callable[[], int],
        ahead_ns: int = 0,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._publishers, self._ahead, self._clock = publishers, ahead_ns, clock
        self._stamps: dict[int, _Stamp] = {}
        self._waiting: dict[int, _Stamp] = {}

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def add_whole(self, ns: int, whole: WholeFix) -> None:
        """Take a whole fix; raises BadMessageError where its stamp has been used, or is none."""
        _require_stamp(ns)
        stamp = self._of(ns)
        if stamp.used or isinstance(stamp.content, WholeFix):
            raise BadMessageError(_repeated(ns))
        stamp.content = whole
        self._waiting[ns] = stamp

    def add_position(self, ns: int, message: NavSatFix) -> None:
        """Take a NavSatFix; raises BadMessageError where its stamp has had one, or is none."""
        _require_stamp(ns)
        stamp = self._of(ns)
        if stamp.position_came:
            raise BadMessageError(_repeated(ns))
        stamp.position_came = True
        if not stamp.used and stamp.content is None:
            stamp.content, stamp.arrived = message, self._clock()
            self._waiting[ns] = stamp

    def due(self, now_ns: int) -> list[tuple[int, Content]]:
        """Take out stamps and content of what need not wait any longer; the navigator is at a time
        (ns)."""
        if not self._waiting:
            return []
        alone = self._publishers() == 0
        found = [
            ns
            for ns, stamp in self._waiting.items()
            if not (0 < ns - now_ns <= self._ahead)
            and (
                alone
                or isinstance(stamp.content, WholeFix)
                or self._clock() - stamp.arrived > PATIENCE
            )
        ]
        return [(ns, self._use(ns)) for ns in found]

    def _use(self, ns: int) -> Content:
        stamp = self._waiting.pop(ns)
        content, stamp.content, stamp.used = stamp.content, None, True
        assert content is not None
        return content

    def _of(self, ns: int) -> _Stamp:
        found = self._stamps.get(ns)
        if found is None:
            if len(self._stamps) >= KEPT:
                oldest = next((one for one in self._stamps if one not in self._waiting), None)
                if oldest is None:
                    raise BadMessageError(f"more than {KEPT} fixes wait")
                del self._stamps[oldest]
            found = self._stamps[ns] = _Stamp()
        return found


def _require_stamp(ns: int) -> None:
    """A stamp of zero is one that nobody has set: within the horizon at a run's beginning, and a
    position of much later."""
    if ns == 0:
        raise BadMessageError("stamp is zero: not set")


def _repeated(ns: int) -> str:
    return f"a fix of {to_seconds(ns):.3f} s has come before"
