"""What a navigator's own data make of its error between two times.

The error at the first of them and that at the second are one joint Gaussian, which the filter
keeps (docs/mathematics.md, section 6.2). Where slow errors of the sensors decide where a navigator
goes, they are part of both."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fix import Information
from isogal.inertial.error_state import BATCH_STATES
from isogal.matrices import symmetric

TOLD = 1e-3
"""Of the navigator's own information of the error at the first time, how much later data have to
say of it to be told: less changes no 1-sigma by more than half of that."""


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
    jump: Array
    """(7,) by how much satellites have moved the estimate since the first of them, where what they
    say may be wrong: all else is of a navigator without it. Else zeros."""

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All but the time."""
        joint = self.before, self.mean, self.smoothed, self.cross, self.after
        return *joint, self.velocity, self.slow, self.jump

    @classmethod
    def of_numbers(cls, begin: float, numbers: Array) -> "Passage":
        """Return that of a time (s) whose arrays have these numbers, one after the other; raises
        ValueError where there is none of so many."""
        # 4 n² + n + 2 + 2 (n - 7) + 7 of n states
        n = round((math.sqrt(9.0 + 16.0 * (len(numbers) + 5.0)) - 3.0) / 8.0)
        square, slow = (n, n), (2, max(n - BATCH_STATES, 0))
        shapes = square, (n,), square, square, square, (2,), slow, (BATCH_STATES,)
        ends = np.cumsum([math.prod(shape) for shape in shapes])
        if n < BATCH_STATES or ends[-1] != len(numbers):
            raise ValueError(f"{len(numbers)} numbers are no passage")
        arrays = (
            part.reshape(shape)
            for part, shape in zip(np.split(numbers, ends[:-1]), shapes, strict=True)
        )
        return cls(begin, *arrays)

    @classmethod
    def of_dynamics(cls, begin: float, before: Array, forward: Array, growth: Array) -> "Passage":
        """Return that of a navigator of which the dynamics (7, 7) are known alone, with what has
        joined its covariance (7, 7)."""
        nothing, cross = np.zeros(BATCH_STATES), before @ forward.T
        after = symmetric(forward @ cross + growth)
        none = np.zeros(2), np.zeros((2, 0)), nothing
        return cls(begin, before, nothing, before, cross, after, *none)

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
            self.slow[:, : states - BATCH_STATES],
            self.jump,
        )

    @property
    def told(self) -> Information:
        """What the data since say of x."""
        scale = np.sqrt(np.diag(self.before))
        unit = np.outer(scale, scale)
        posterior = np.linalg.inv(self.smoothed / unit)
        matrix = symmetric(posterior - np.linalg.inv(self.before / unit))
        if np.abs(matrix).max() < TOLD:
            return Information(np.zeros_like(scale), np.zeros_like(matrix))
        return Information(posterior @ (self.mean / scale) / scale, matrix / unit)

    def aided(self, prior: Array) -> Information:
        """Return what satellites say of y, which they have made N(0, prior), (7, 7): of what was
        N(jump, after) without them."""
        after = self.after[:BATCH_STATES, :BATCH_STATES]
        scale = np.sqrt(np.diag(after))
        unit = np.outer(scale, scale)
        without, with_them = (np.linalg.inv(one / unit) for one in (after, prior))
        vector = -without @ (self.jump / scale) / scale
        return Information(vector, symmetric(with_them - without) / unit)

    @property
    def transition(self) -> tuple[Array, Array]:
        """(n, n) and (n, n) A and Q of y = A (x - mean) + w with w ~ N(0, Q)."""
        scale = np.sqrt(np.diag(self.smoothed))
        unit = self.smoothed / np.outer(scale, scale)
        forward = np.linalg.solve(unit, self.cross / scale[:, None]).T / scale
        forward = np.ascontiguousarray(forward)  # for another layout kernels are compiled anew
        return forward, symmetric(self.after - forward @ self.cross)


@dataclass(frozen=True, slots=True, eq=False)
class History:
    """What has become of a navigator since the last batch."""

    correction: Array | None = None
    """(7,) change of its estimate; None = not known."""
    satellites: bool = False
    """Whether it may have satellites."""
    passage: Passage | None = None
    """What has become of its error; None = nobody says it."""

    @property
    def aided(self) -> bool:
        """Whether satellites have told it what may be wrong."""
        return self.passage is not None and bool(self.passage.jump.any())
