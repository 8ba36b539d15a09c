"""Scans that have been collected and wait to become a batch."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
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
    level: float = 0.0
    """m, the height at which the vehicle surely was last (`BatchBuilder.add_scan`)."""


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


_TIME, _LATITUDE, _LONGITUDE, _NORTH, _EAST, _SIGMA, _OFFSET, _HEIGHT, _LEVEL = range(9)
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
        self._numbers: Array = np.zeros((_LEVEL + 1, 0))
        self._readings: Array = np.zeros((0, *shape))

    def __len__(self) -> int:
        return len(self._readings)

    def last(self, count: int) -> slice:
        """Return which are the last ones, so many at most; valid until another is added."""
        return slice(max(len(self) - count, 0), len(self))

    @property
    def every(self) -> slice:
        """Which are all of them."""
        return slice(0, len(self))

    def add(self, scan: Scan) -> None:
        """Add one."""
        numbers = (scan.time, scan.latitude, scan.longitude, *scan.velocity)
        new = np.array([*numbers, scan.sigma, scan.offset, scan.height, scan.level])[:, None]
        reading = np.asarray(scan.reading, dtype=np.float64)
        if reading.ndim == 0:
            reading = np.full(self.shape, reading)
        self._numbers = np.concatenate([self._numbers, new], axis=1)[:, -self.most :]
        self._readings = np.concatenate([self._readings, reading.reshape(1, *self.shape)])[
            -self.most :
        ]

    def extend(self, scans: Iterable[Scan]) -> None:
        """Add several."""
        for scan in scans:
            self.add(scan)

    def __getitem__(self, index: int) -> Scan:
        """Return a copy of one; negative: counted from the last."""
        numbers = self._numbers[:, index].tolist()
        time, latitude, longitude, north, east, *others = numbers
        reading = self._readings[index]
        reading = reading.item() if self.shape == (1, 1) else reading.copy()
        velocity = np.array([north, east])
        return Scan(time, latitude, longitude, velocity, reading, *others)

    def track(self, which: slice) -> tuple[Array, Array, Array, Array]:
        """Return latitudes and longitudes (T,) rad, velocities (T, 2) m/s and times (T,) s."""
        numbers = self._numbers[:, which].copy()
        velocity = np.ascontiguousarray(numbers[_NORTH:_SIGMA].T)
        return numbers[_LATITUDE], numbers[_LONGITUDE], velocity, numbers[_TIME]

    def heights(self, which: slice) -> Array:
        """Return (T,) m."""
        return self._numbers[_HEIGHT, which].copy()

    def levels(self, which: slice) -> Array:
        """Return (T,) m, see `Scan`."""
        return self._numbers[_LEVEL, which].copy()

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
        return slice(0, int(np.searchsorted(self._numbers[_TIME], time, side="right")))

    def forget_readings(self, before: float) -> None:
        """Give up the readings before a time (s)."""
        self._readings[self._numbers[_TIME] < before] = np.nan

    def move(self, which: slice, shift: Array, change: Array) -> None:
        """Add to positions (m) and velocities (T, 4), and to readings (T,)."""
        numbers = self._numbers[:, which]
        north, east = metres_per_radian(numbers[_LATITUDE])
        numbers[_LATITUDE] += shift[:, 0] / north
        numbers[_LONGITUDE] += shift[:, 1] / east
        numbers[_NORTH:_SIGMA] += shift[:, 2:].T
        self._readings[which, :, 0] += change[:, None]
