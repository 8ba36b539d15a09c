"""Scans that have been collected and wait to become a batch."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import HORIZONTAL_STATES
from isogal.matching.residual_gravity import ResidualGravity
from isogal.matching.transitions import Bridge


@dataclass(slots=True)
class Scan:
    """One, with the navigator's estimate of where it was taken. SI units, radians."""

    time: float
    latitude: float
    longitude: float
    velocity: Array
    reading: float | Array
    """One number, or those of `Scans.shape`; NaN = none."""
    sigma: float
    offset: float
    height: float


@dataclass(frozen=True, slots=True, eq=False)
class Collected:
    """What a `BatchBuilder` has collected, for a checkpoint."""

    scans: tuple[Scan, ...]
    count: int
    unused: int
    bridge: Bridge | None = None
    gravity: ResidualGravity | None = None
    """None = what the builder assumes anyway."""
    correction: Array | None = None
    """(7,) of the navigator's estimate since the last batch end; None = not known."""


_TIME, _LATITUDE, _LONGITUDE, _NORTH, _EAST, _SIGMA, _OFFSET, _HEIGHT, _COUNT = range(9)
"""Rows of the numbers of scans."""


class Scans:
    """The last scans of a run, oldest first: arrays, since each fix moves all of them.

    Parameters
    ----------
    most : int
        Scans that are kept.
    shape : (int, int)
        Of a reading: rows, and numbers of each, the first of which moves with the navigator.
    """

    def __init__(self, most: int, shape: tuple[int, int] = (1, 1)) -> None:
        self.most, self.shape = most, shape
        self._numbers = np.zeros((_COUNT, 2 * most))
        self._readings: Array = np.zeros((2 * most, *shape))
        self._end = 0
        self.added = 0
        """How many there have been."""

    def __len__(self) -> int:
        return min(self.added, self.most)

    def last(self, count: int) -> slice:
        """Return which are the last ones, so many at most; valid until another is added."""
        return slice(self._end - min(count, len(self)), self._end)

    @property
    def every(self) -> slice:
        """Which are all of them."""
        return self.last(self.most)

    def add(self, scan: Scan) -> None:
        """Add one."""
        if self._end == 2 * self.most:  # the last ones to the front
            kept = self.every
            count = kept.stop - kept.start
            self._numbers[:, :count] = self._numbers[:, kept].copy()
            self._readings[:count] = self._readings[kept].copy()
            self._end = count
        numbers = (scan.time, scan.latitude, scan.longitude, *scan.velocity)
        self._numbers[:, self._end] = (*numbers, scan.sigma, scan.offset, scan.height)
        reading = np.asarray(scan.reading, dtype=np.float64)
        self._readings[self._end] = reading.reshape(self.shape) if reading.ndim else reading
        self._end += 1
        self.added += 1

    def extend(self, scans: Iterable[Scan]) -> None:
        """Add several."""
        for scan in scans:
            self.add(scan)

    def __getitem__(self, index: int) -> Scan:
        """Return a copy of one; negative: counted from the last."""
        at = self._end + index if index < 0 else self.every.start + index
        numbers = self._numbers[:, at].tolist()
        time, latitude, longitude, north, east, sigma, offset, height = numbers
        reading = self._readings[at]
        reading = reading.item() if self.shape == (1, 1) else reading.copy()
        velocity = np.array([north, east])
        return Scan(time, latitude, longitude, velocity, reading, sigma, offset, height)

    def track(self, which: slice) -> tuple[Array, Array, Array, Array]:
        """Return latitudes and longitudes (T,) rad, velocities (T, 2) m/s and times (T,) s."""
        numbers = self._numbers[:, which].copy()
        velocity = np.ascontiguousarray(numbers[_NORTH:_SIGMA].T)
        return numbers[_LATITUDE], numbers[_LONGITUDE], velocity, numbers[_TIME]

    def heights(self, which: slice) -> Array:
        """Return (T,) m."""
        return self._numbers[_HEIGHT, which].copy()

    def sigmas(self, which: slice) -> Array:
        """Return (T,) 1-sigma of the readings."""
        return self._numbers[_SIGMA, which].copy()

    def offsets(self, which: slice) -> Array:
        """Return (T,) what is known to be wrong with the readings."""
        return self._numbers[_OFFSET, which].copy()

    def readings(self, which: slice) -> Array:
        """Return (T, *shape)."""
        return self._readings[which].copy()

    def until(self, time: float) -> slice:
        """Return which are not after a time (s)."""
        every = self.every
        times = self._numbers[_TIME, every]
        return slice(every.start, every.start + int(np.searchsorted(times, time, side="right")))

    def forget_readings(self, before: float) -> None:
        """Give up the readings before a time (s)."""
        every = self.every
        self._readings[every][self._numbers[_TIME, every] < before] = np.nan

    def move(self, which: slice, shift: Array, change: Array) -> None:
        """Add to positions (m) and velocities (T, 4), and to readings (T,)."""
        numbers = self._numbers[:, which]
        north, east = metres_per_radian(numbers[_LATITUDE])
        numbers[_LATITUDE] += shift[:, 0] / north
        numbers[_LONGITUDE] += shift[:, 1] / east
        numbers[_NORTH:_SIGMA] += shift[:, 2:].T
        self._readings[which, :, 0] += change[:, None]


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """What is known of scans at the end of a batch: the correction by its fix needs it again."""

    every: Array
    """(T, 7, 7) errors at the scans per unit of error at the end."""
    jacobian: Array
    """(T, 4) of the reduction."""
    count: int
    """Of scans that there have been."""
    end: float
    """s."""
    bridge: Bridge | None = None

    def is_of(self, scans: Scans, which: slice, end: float, bridge: Bridge | None) -> bool:
        """Whether it is of these scans, with none after them, and of this end."""
        same = self.count == scans.added and scans.last(len(self.every)) == which
        return same and end == self.end and bridge is self.bridge

    def moves(self, jump: Array) -> tuple[Array, Array]:
        """Return what a jump (7,) of the navigator at the end adds to positions (m) and
        velocities (T, 4) of the scans, and to readings (T,)."""
        shift = (self.every @ jump)[:, :HORIZONTAL_STATES]
        return shift, (self.jacobian * shift).sum(axis=1)
