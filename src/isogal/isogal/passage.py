"""What a navigator's own data make of its error between two times.

Where the heading is not known to where sines are linear in it, the error at a time says little of
the next unless the slow errors of the sensors, which turn the heading and stretch the path, are
known along with it; and what aids tell meanwhile, a gyroscope at rest above all, says which of
several places is likely. Both follow from the filter's joint Gaussian of the errors at the two
times (docs/mathematics.md, section 6.2)."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.fix import Information
from isogal.inertial.error_state import BATCH_STATES
from isogal.matrices import symmetric


@dataclass(frozen=True, slots=True, eq=False)
class Passage:
    """Joint Gaussian of the error x at one time and y at a later one, of n states: those of a
    batch (`isogal.inertial.error_state`), then slow errors of sensors."""

    begin: float
    """s, the time of x."""
    before: Array
    """(n, n) covariance of x without the data since."""
    mean: Array
    """(n,) of x with them; that of y is zero."""
    smoothed: Array
    """(n, n) covariance of x with them."""
    cross: Array
    """(n, n) covariance of x with y, with them."""
    after: Array
    """(n, n) covariance of y."""
    velocity: Array
    """(2,) m/s north and east at the first of them."""
    slow: Array
    """(2, n - 7) estimates of the slow errors at both times."""

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All but the time."""
        joint = self.before, self.mean, self.smoothed, self.cross, self.after
        return *joint, self.velocity, self.slow

    @classmethod
    def of_numbers(cls, begin: float, numbers: Array) -> "Passage":
        """Return that of a time (s) whose arrays have these numbers, one after the other; raises
        ValueError where there is none of so many."""
        # 4 n² + n + 2 + 2 (n - 7) of n states
        n = round((math.sqrt(9.0 + 16.0 * (len(numbers) + 12.0)) - 3.0) / 8.0)
        square, slow = (n, n), (2, max(n - BATCH_STATES, 0))
        shapes = square, (n,), square, square, square, (2,), slow
        ends = np.cumsum([math.prod(shape) for shape in shapes])
        if n < BATCH_STATES or ends[-1] != len(numbers):
            raise ValueError(f"{len(numbers)} numbers are no passage")
        arrays = (
            part.reshape(shape)
            for part, shape in zip(np.split(numbers, ends[:-1]), shapes, strict=True)
        )
        return cls(begin, *arrays)

    def part(self, states: int) -> "Passage":
        """Return that of the first so many states."""
        n = slice(0, states)
        return Passage(
            self.begin,
            self.before[n, n],
            self.mean[n],
            self.smoothed[n, n],
            self.cross[n, n],
            self.after[n, n],
            self.velocity,
            self.slow,
        )

    @property
    def told(self) -> Information:
        """What the data since say of x."""
        scale = np.sqrt(np.diag(self.before))
        unit = np.outer(scale, scale)
        posterior = np.linalg.inv(self.smoothed / unit)
        matrix = (posterior - np.linalg.inv(self.before / unit)) / unit
        return Information(posterior @ (self.mean / scale) / scale, symmetric(matrix))

    @property
    def transition(self) -> tuple[Array, Array]:
        """(n, n) and (n, n) A and Q of y = A (x - mean) + w with w ~ N(0, Q)."""
        scale = np.sqrt(np.diag(self.smoothed))
        unit = self.smoothed / np.outer(scale, scale)
        forward = np.linalg.solve(unit, self.cross / scale[:, None]).T / scale
        return forward, symmetric(self.after - forward @ self.cross)


class Aided(NamedTuple):
    """What other aids than the map have told the navigator since a time, where its heading is
    known well."""

    begin: float
    """s."""
    covariance: Array
    """(7, 7) of the navigator's error now without them."""
    jump: Array
    """(7,) of its estimate: with them minus without them."""

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All but the time."""
        return self.covariance, self.jump

    def information(self, prior: Array) -> Information:
        """Return what they say of the error now: that which turns N(jump, covariance) into
        N(0, prior), with the navigator's covariance `prior` (7, 7)."""
        scale = np.sqrt(np.diag(self.covariance))
        unit = np.outer(scale, scale)
        before, after = (np.linalg.inv(one / unit) for one in (self.covariance, prior))
        vector = -before @ (self.jump / scale) / scale
        return Information(vector, symmetric(after - before) / unit)


Since = Aided | Passage
"""What there is to say of the time since a fix."""


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """What has become of a navigator since the last batch."""

    correction: Array | None = None
    """(7,) change of its estimate; None = not known."""
    satellites: bool = False
    """Whether it may have satellites."""
    since: Since | None = None
    """What aids have told it, or, where its heading is not known well, what has become of its
    error; None = what its dynamics say."""

    @property
    def aided(self) -> Aided | None:
        """What aids have told it; None = nothing, or the passage has it."""
        return self.since if isinstance(self.since, Aided) else None

    @property
    def passage(self) -> Passage | None:
        """What has become of its error; None = what its dynamics say, and aids."""
        return self.since if isinstance(self.since, Passage) else None
