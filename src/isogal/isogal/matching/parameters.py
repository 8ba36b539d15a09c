"""Constants, or what changes slowly, that are estimated along with the navigator's error: what a
magnetic vehicle adds to its readings, a wrong speed of sound, the tilt of a gradiometer's platform
(docs/mathematics.md, section 5.2)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Integers


@dataclass(frozen=True, slots=True, eq=False)
class Parameters:
    """C unknowns theta ~ N(0, diag(sigma²)), and what they do to the T rows of a batch:
    reading = map(place - position theta) + reading theta + ..."""

    names: tuple[str, ...]
    """(C,) as the diagnostics have them; "" of those that they do not have."""
    sigma: Array
    """(C,) before the first reading."""
    reading: Array
    """(T, C) by how much a row's reading is larger per unit of each, map's unit."""
    position: Array | None = None
    """(T, 2, C) by how much the batch's place of a row is off (north, east; m) per unit of each;
    None = not at all."""

    time: Array | None = None
    """(C,) s, correlation time of those that are stationary Gauss-Markov processes of 1-sigma
    `sigma`; inf = others. What moves places may change slowly only, as readings are linearised
    where it is at the end of a batch; None = all are constants."""
    walk: Array | None = None
    """(C,) random walk, unit of each per root second."""

    @property
    def moves(self) -> Array:
        """`position`, or zeros."""
        if self.position is not None:
            return self.position
        rows, count = self.reading.shape
        return np.zeros((rows, 2, count))

    def part(self, rows: Integers) -> "Parameters":
        """Return the parameters of some rows."""
        position = None if self.position is None else self.position[rows]
        return replace(self, reading=self.reading[rows], position=position)

    @classmethod
    def together(cls, parts: "Sequence[Parameters | None]") -> "Parameters | None":
        """Return several as one; None where there are none."""
        some = [one for one in parts if one is not None]
        if len(some) < 2:
            return some[0] if some else None
        return cls(
            tuple(name for one in some for name in one.names),
            np.concatenate([one.sigma for one in some]),
            np.concatenate([one.reading for one in some], axis=1),
            np.concatenate([one.moves for one in some], axis=2),
            np.concatenate([one.times for one in some]),
            np.concatenate([one.walks for one in some]),
        )

    @property
    def times(self) -> Array:
        """`time`, or inf."""
        return np.full(len(self.sigma), np.inf) if self.time is None else self.time

    @property
    def walks(self) -> Array:
        """`walk`, or zeros."""
        return np.zeros(len(self.sigma)) if self.walk is None else self.walk


@dataclass(frozen=True, slots=True, eq=False)
class InstrumentErrors:
    """What is known of the readings of a batch beside the white noise."""

    parameters: Parameters | None = None
    """What they have in common and the matcher estimates along: correlated noise, tilt, a
    vehicle's magnetism; None = nothing."""
    bias_walk: float = 0.0
    """Random walk of their bias, map's unit per root second."""
    delay_sigma: float = 0.0
    """1-sigma of a delay beyond the specified one, s."""
    added: Array | None = None
    """(T,) what the reduction adds to each reading by the navigator's state, map's unit; None =
    nothing."""
    filter_time: float = 0.0
    """s, time constant of the low-pass filter that they have come through, where the batch has
    them where they were reported from, not where they tell of in the mean."""

    def part(self, rows: Integers) -> "InstrumentErrors":
        """Return those of some rows."""
        return replace(
            self,
            parameters=None if self.parameters is None else self.parameters.part(rows),
            added=None if self.added is None else self.added[rows],
        )

    def along(self, *more: Parameters | None) -> "InstrumentErrors":
        """Return them with more parameters."""
        return replace(self, parameters=Parameters.together([self.parameters, *more]))
