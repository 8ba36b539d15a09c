"""Positions by stamp, and between the stamps: real sensors do not sample at the same times."""

from bisect import bisect_right
from collections.abc import Sequence

import numpy as np
from rclpy.serialization import deserialize_message

from isogal.arrays import Array
from isogal_ros import topics
from isogal_ros.messages.position import read_position

LONGEST_GAP = 10_000_000_000
"""ns between two messages, between which a position is not guessed any more."""


class Places:
    """Positions of serialised NavSatFix messages of any frame, by stamp (ns)."""

    def __init__(self, messages: dict[int, bytes]) -> None:
        self._messages, self._stamps = messages, sorted(messages)

    def __contains__(self, ns: int) -> bool:
        return ns in self._messages or self._around(ns) is not None

    def at(self, stamps: Sequence[int]) -> Array:
        """Return latitude and longitude (rad) (n, 2) at stamps, linear between messages; NaN where
        there is none on either side."""
        return np.array([self._at(ns) for ns in stamps]).reshape(-1, 2)

    def before(self, ns: int) -> bytes:
        """Return the message of a stamp, or the last one before it."""
        return self._messages[self._stamps[bisect_right(self._stamps, ns) - 1]]

    def _at(self, ns: int) -> tuple[float, float]:
        if ns in self._messages:
            return self._position(ns)
        if (around := self._around(ns)) is None:
            return np.nan, np.nan
        (one, other), share = around, (ns - around[0]) / (around[1] - around[0])
        here, there = self._position(one), self._position(other)
        east = (there[1] - here[1] + np.pi) % (2.0 * np.pi) - np.pi  # also across 180 degrees
        return here[0] + share * (there[0] - here[0]), here[1] + share * east

    def _around(self, ns: int) -> tuple[int, int] | None:
        """Return the stamps before and after one; None where they are too far apart."""
        i = bisect_right(self._stamps, ns)
        if not 0 < i < len(self._stamps):
            return None
        before, after = self._stamps[i - 1 : i + 1]
        return (before, after) if after - before <= LONGEST_GAP else None

    def _position(self, ns: int) -> tuple[float, float]:
        message = deserialize_message(self._messages[ns], topics.NAV_FIX.type)
        latitude, longitude, _ = read_position(message, frame="")
        return latitude, longitude
