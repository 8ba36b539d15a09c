"""Horizontal gravity that no compensation takes off, over a batch (docs/mathematics.md, section
3.9): it moves the navigator within the batch, as nothing else does that the batch knows of."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fields.known_gravity import KnownGravity
from isogal.inertial.error_state import BATCH_STATES
from isogal.matrices import square_root

_KNOTS = 8
"""The process is linear between so many times. Over a batch as long as three correlation lengths
they have 99 % of the variance that it gives the position."""
_LEAST = 0.1
"""Of the prior's position 1-sigma: a process that moves the position by less is left out, and its
components that do. A hundredth of the variance is nothing that errors would show."""


@dataclass(frozen=True, slots=True)
class ResidualGravity:
    """Horizontal components of gravity that are left, to north and to east: first-order
    Gauss-Markov processes along the track (Jekeli 2001, section 6.6)."""

    sigma: float = 0.0
    """m/s², of each component; 0 = none."""
    length: float = 10_000.0
    """m, correlation length."""

    @classmethod
    def of(cls, gravity: KnownGravity) -> "ResidualGravity":
        """Return what is left of gravity as a navigator knows it."""
        return cls(gravity.residual_sigma, gravity.residual_length)

    def apart(self, velocity: Array, times: Array, end: float, prior: Array) -> Array:
        """Return what the navigator's errors at scans are beside what its error at a time `end`
        says of them.

        Parameters
        ----------
        velocity : (T, 2) array
            m/s.
        times : (T,) array
            s, of the scans.
        prior : (n, n) array
            The navigator's covariance at the end; position (m) first.

        Returns
        -------
        (T, 7, K) array
            Per unit-variance component of K; 0 of them where they are too small to matter.
        """
        left = np.zeros((len(times), BATCH_STATES, 0))
        span = end - float(times.min())
        least = _LEAST * np.sqrt(np.trace(prior[:2, :2]) / 2.0)
        if 0.5 * self.sigma * span**2 <= least:
            return left
        speed = float(np.hypot(velocity[:, 0], velocity[:, 1]).mean())
        position, rate = _moves(times, end)
        knots = np.linspace(0.0, span, _KNOTS) * speed / self.length
        root = self.sigma * square_root(np.exp(-np.abs(knots[:, None] - knots)))
        position, rate = position @ root, rate @ root
        kept = np.abs(position).max(axis=0) > _LEAST * least
        count = int(kept.sum())
        result = np.zeros((len(times), BATCH_STATES, 2 * count))
        for axis in range(2):
            of_axis = slice(axis * count, (axis + 1) * count)
            result[:, axis, of_axis] = position[:, kept]
            result[:, 2 + axis, of_axis] = rate[:, kept]
        return result


UNMOVED = ResidualGravity()
"""Where nothing is left."""


def _moves(times: Array, end: float) -> tuple[Array, Array]:
    """Return (T, knots) the error of position and of velocity at scans per unit of acceleration at
    the knots, the errors at the end being 0: v(t) = -∫ a, p(t) = -∫ v from t to the end.

    Knots are equally spaced back from the end to the first scan; exact for what is linear between
    them."""
    step = (end - float(times.min())) / (_KNOTS - 1)
    ago = (end - times)[:, None] / step - np.arange(_KNOTS)  # steps back from each knot

    def ramp(x: Array, order: int) -> Array:
        return np.asarray(np.maximum(x, 0.0) ** order / math.factorial(order))

    def integrated(n: int) -> Array:
        """Integrate n times, from the end back, what is 1 at a knot and 0 at its neighbours: a sum
        of ramps; of the first knot there is half of it."""
        later = ramp(ago - 1.0, n + 1) - ramp(ago, n + 1)
        whole = later + ramp(ago + 1.0, n + 1) - ramp(ago, n + 1)
        return np.where(np.arange(_KNOTS) == 0, later + ramp(ago, n), whole)

    return step**2 * integrated(2), -step * integrated(1)
