"""Readings of both magnetometers as they come: each of the scalar one waits until the vector one
has been read at its time (docs/magnetometer.md, section 4.3)."""

from collections import deque
from collections.abc import Iterator
from typing import Generic, TypeVar

import numpy as np

from isogal.arrays import Array
from isogal.magnetics.compensation import Compensation
from isogal.magnetics.terms import terms

LONGEST_GAP = 2.0
"""s between readings of the vector magnetometer over which it is not interpolated."""
MOST_WAITING = 5
"""Readings of the scalar magnetometer that wait; if there are more, the oldest is none. The two
instruments are not on the same topic, so one may be far ahead of the other in a replay."""
_KEPT = 1000
"""Readings of the vector magnetometer that are kept."""
_NOTHING = np.full(3, np.nan)
Item = TypeVar("Item")


class CompensatedStream(Generic[Item]):
    """Compensates readings one by one.

    Parameters
    ----------
    compensation : Compensation
        Currents, which are not in the stream, are taken not to flow.
    online : bool
        Whether the terms of what is left are wanted with each reading.
    """

    def __init__(self, compensation: Compensation, online: bool = False) -> None:
        self._compensation, self._online = compensation, online
        self._vectors: deque[tuple[float, Array]] = deque(maxlen=_KEPT)
        self._waiting: deque[tuple[float, float, Item]] = deque()

    def vector(self, time: float, vector: Array) -> None:
        """Take a reading (3,) nT of the vector magnetometer; one that is not later than the last
        is left out."""
        if not self._vectors or time > self._vectors[-1][0]:
            self._vectors.append((time, vector))

    def scalar(self, time: float, total: float, item: Item) -> None:
        """Take a reading, nT, of the scalar magnetometer, and what belongs to it."""
        self._waiting.append((time, total, item))

    def ready(self) -> Iterator[tuple[float | Array, Item]]:
        """Yield the readings that can be compensated, in the order they came: total field without
        the vehicle, nT, NaN where the vector magnetometer was not read, and what belongs to
        it. With `online` the total field is an array (1 + C,) with the terms."""
        while self._waiting:
            time, total, item = self._waiting[0]
            late = time + self._compensation.lag
            due = bool(self._vectors) and self._vectors[-1][0] >= late
            if not due and len(self._waiting) <= MOST_WAITING:
                return
            self._waiting.popleft()
            yield self._clean(late, total), item

    def _clean(self, time: float, total: float) -> float | Array:
        """Return a total field without what the vehicle adds at a time of the vector
        magnetometer, nT."""
        vector, rate = self._at(time)
        clean = total - float(self._compensation.one(vector, rate, np.asarray(total)))
        return np.append(clean, terms(vector, rate, np.asarray(total))) if self._online else clean

    def _at(self, time: float) -> tuple[Array, Array]:
        """Return the vector at a time, nT, and its rate of change, nT/s."""
        # readings come in order, so that what is looked for is near the end
        after = len(self._vectors)
        while after and self._vectors[after - 1][0] >= time:
            after -= 1
        if after in (0, len(self._vectors)):
            return _NOTHING, _NOTHING
        (t0, v0), (t1, v1) = self._vectors[after - 1], self._vectors[after]
        if t1 - t0 > LONGEST_GAP:
            return _NOTHING, _NOTHING
        rate = (v1 - v0) / (t1 - t0)
        return v0 + rate * (time - t0), rate
