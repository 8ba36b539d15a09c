"""Scans that have been collected and wait to become a batch."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.residual_gravity import UNMOVED, ResidualGravity
from isogal.matching.transitions import Bridge


class Scans(NamedTuple):
    """N scans, oldest first, with the navigator's estimate of where each was taken. SI units,
    radians."""

    time: Array
    latitude: Array
    longitude: Array
    velocity: Array
    """(N, 2), north and east."""
    reading: Array
    """(N, rows, numbers), the first of which moves with the navigator; NaN = none."""
    sigma: Array
    offset: Array
    height: Array
    level: Array
    """The height at which the vehicle surely was last (`BatchBuilder.add_scan`)."""

    @classmethod
    def none(cls, shape: tuple[int, int] = (1, 1)) -> "Scans":
        """Return no scans, whose readings would have a shape."""
        nothing = np.zeros(0)
        shapes = {"velocity": (0, 2), "reading": (0, *shape)}
        return cls(*(np.zeros(shapes[x]) if x in shapes else nothing for x in cls._fields))

    def part(self, rows: slice) -> "Scans":
        """Return some of them."""
        return Scans(*(column[rows] for column in self))

    def added(self, most: int, *numbers: float | Array) -> "Scans":
        """Return the last ones, so many at most, of these and one more, of which `numbers` are
        given in the order of the columns."""
        kept = slice(max(len(self.time) - most + 1, 0), None)
        each = []
        for column, number in zip(self, numbers, strict=True):
            new = np.empty((1, *column.shape[1:]))
            new[0] = number
            each.append(np.concatenate((column[kept], new)))
        return Scans(*each)


@dataclass(frozen=True, slots=True, eq=False)
class Collected:
    """What a `BatchBuilder` has collected, as a checkpoint keeps it."""

    scans: Scans
    count: int = 0
    """How many there have been."""
    unused: int = 0
    """How many no batch has used."""
    bridge: Bridge | None = None
    gravity: ResidualGravity = UNMOVED
    """What moves the navigator within a batch."""
    correction: Array = field(default_factory=lambda: np.zeros(BATCH_STATES))
    """(7,) of the navigator's estimate since the last batch end."""
