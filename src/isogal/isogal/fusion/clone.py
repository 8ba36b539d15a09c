"""Errors of an earlier time that a filter keeps along with those of now: how both are correlated,
and what all data since say of them (stochastic cloning, Roumeliotis & Burdick 2002, ICRA;
docs/mathematics.md, section 3.18)."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.fusion.sigma_points import CORE, Weights
from isogal.inertial.rotations import INLINE
from isogal.matrices import inverse_of_lower, lower, product, product_transposed


class Clone(NamedTuple):
    """What is known of r errors of an earlier time, which are combinations of the filter's N; the
    functions of a filter change the arrays in place. Without rows nothing is kept."""

    cross: Array
    """(r, N) covariance with the error now."""
    shift: Array
    """(r,) how far data since have moved their estimate."""
    change: Array
    """(r, r) what these have added to their covariance."""

    @classmethod
    def of(cls, covariance: Array, rows: Array | None = None) -> "Clone":
        """Return that of errors of now, given the covariance (N, N): of combinations (r, N), or of
        all."""
        cross = covariance.copy() if rows is None else rows @ covariance
        return cls(cross, np.zeros(len(cross)), np.zeros((len(cross), len(cross))))

    def about(self, now: Array, then: Array) -> "Clone":
        """Return its second moments about another error then (r,), where the error now (N,) is so
        far from what it is taken for."""
        if not len(self.shift):
            return self
        off = self.shift - then
        return Clone(self.cross + np.outer(off, now), then, self.change + np.outer(off, off))

    def copy(self) -> "Clone":
        """Return one that shares nothing with this one."""
        return Clone(*(array.copy() for array in self)) if len(self.shift) else self


NO_CLONE = Clone(np.zeros((0, CORE)), np.zeros(0), np.zeros((0, 0)))
"""Nothing is kept."""


@kernel(**INLINE)
def carry_clone(
    n: int,
    factor: Array,
    odd: Array,
    weights: Weights,
    keep: Array,
    clone: Clone,
    work: Array,
) -> None:
    """Carry a clone over an interval: C' = C P^-1 X, with X = L O the covariance of the error
    before the interval with that after it, so that C' = (C L'^-1) O.

    L is the covariance's factor before it (`factor`, a row a column: `sigma_points.factorise`), O
    has the halves of the differences of opposite points (`sigma_points.moments`) with their
    weights; of the auxiliary states so much is left as `keep` (M,) says. `work` (W,) is work
    space."""
    paired = 2.0 * weights.other * weights.spread
    for i in range(clone.cross.shape[0]):
        row = clone.cross[i]
        for k in range(n):
            value = row[k]
            for j in range(k):
                value -= work[j] * factor[j, k]
            work[k] = value / factor[k, k]
        for k in range(n):
            row[k] = 0.0
        for j in range(n):
            value = paired * work[j] if j < CORE else work[j]
            point = j if j < CORE else j + 1
            for k in range(n):
                row[k] += value * odd[point, k]
    for j in range(n - CORE):
        for i in range(clone.cross.shape[0]):
            clone.cross[i, CORE + j] *= keep[j]


@kernel(**INLINE)
def inform_clone_of_scalar(
    n: int, clone: Clone, across: Array, gain: Array, innovation: float, inverse: float
) -> None:
    """Tell a clone what a scalar measurement says, with P H' (W,) of the error now as `gain`, and
    its own (W,) as `across`, the innovation and the inverse of its variance."""
    rows = clone.cross.shape[0]
    for i in range(rows):
        scaled = across[i] * inverse
        clone.shift[i] += scaled * innovation
        for j in range(rows):
            clone.change[i, j] -= scaled * across[j]
        for k in range(n):
            clone.cross[i, k] -= scaled * gain[k]


@kernel(error_model="numpy")
def inform_clone(clone: Clone, before: Array, after: Array, correction: Array) -> None:
    """Tell a clone, in place, what a measurement has made of the error now: its covariance before
    and after (N, N), and the correction (N,) of the estimate.

    Of the clone a measurement says nothing but by the error now, of which with G = C P^-1 it is
    G e + what is independent of e."""
    n, rows = before.shape[0], clone.cross.shape[0]
    scale, unit = np.empty(n), np.empty((n, n))
    for a in range(n):
        scale[a] = math.sqrt(before[a, a])
    for a in range(n):
        for b in range(n):
            unit[a, b] = before[a, b] / (scale[a] * scale[b])
    inverse = inverse_of_lower(lower(unit))
    scaled, reduced = np.empty((rows, n)), np.empty((n, n))
    for i in range(rows):
        for a in range(n):
            scaled[i, a] = clone.cross[i, a] / scale[a]
    gain = product(product_transposed(scaled, inverse), inverse)
    for i in range(rows):
        for a in range(n):
            gain[i, a] /= scale[a]
            clone.shift[i] += gain[i, a] * correction[a]
    for a in range(n):
        for b in range(n):
            reduced[a, b] = after[a, b] - before[a, b]
    by_now = product(gain, reduced)
    change = product_transposed(by_now, gain)
    for i in range(rows):
        for a in range(n):
            clone.cross[i, a] += by_now[i, a]
        for j in range(rows):
            clone.change[i, j] += 0.5 * (change[i, j] + change[j, i])
