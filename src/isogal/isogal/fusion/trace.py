"""What a filter's own propagation says of how states of different times are correlated: for a
smoother, which goes back over it (`isogal.fusion.smoothing`)."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.fusion.auxiliary import Auxiliary
from isogal.fusion.sigma_points import CORE, Weights
from isogal.inertial.rotations import INLINE


class Trace(NamedTuple):
    """Of S intervals, N states. Sizes of 0 = nothing is asked for."""

    cross: Array
    """(S, N, N) covariance of the error before an interval (rows) with that after it."""
    predicted: Array
    """(S, N, N) covariance after an interval, before its height."""
    filtered: Array
    """(S, N, N) the same after its height."""
    correction: Array
    """(S, N) what the height moved the state by."""

    @classmethod
    def of(cls, intervals: int, states: int) -> "Trace":
        """Return an empty one."""
        square = (intervals, states, states)
        return cls(np.zeros(square), np.zeros(square), np.zeros(square), np.zeros(square[:2]))


NONE = Trace.of(0, 0)
"""Nothing is asked for."""


@kernel(**INLINE)
def record_cross(
    n: int,
    factor: Array,
    odd: Array,
    weights: Weights,
    auxiliary: Auxiliary,
    velocity: Array,
    dt: float,
    trace: Trace,
    k: int,
) -> None:
    """Write `Trace.cross` of interval k, if it is asked for, from the columns of the covariance's
    factor before it (`sigma_points.factorise`) and the halves of the differences of opposite
    points (`sigma_points.moments`), with the ageing of auxiliary states."""
    if k >= trace.cross.shape[0]:
        return
    cross = trace.cross[k]
    paired = 2.0 * weights.other * weights.spread
    distance = dt * math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1])
    for a in range(n):
        for b in range(n):
            cross[a, b] = 0.0
    for j in range(n):
        row, weight = (j, paired) if j < CORE else (j + 1, 1.0)
        for a in range(j, n):
            column = weight * factor[j, a]
            for b in range(n):
                cross[a, b] += column * odd[row, b]
    for j in range(n - CORE):
        left = math.exp(-dt * auxiliary.per_second[j] - distance * auxiliary.per_metre[j])
        for a in range(n):
            cross[a, CORE + j] *= left


@kernel(**INLINE)
def record_predicted(n: int, P: Array, error: Array, trace: Trace, k: int) -> None:
    """Write `Trace.predicted` of interval k, the symmetric part of P (N, W), if it is asked for;
    zeros in `error` (W,) then stand for a height that is not used."""
    if k >= trace.cross.shape[0]:
        return
    for a in range(n):
        error[a] = 0.0
        for b in range(n):
            trace.predicted[k, a, b] = 0.5 * (P[a, b] + P[b, a])


@kernel(**INLINE)
def record_filtered(n: int, P: Array, error: Array, trace: Trace, k: int) -> None:
    """Write `Trace.filtered` and `Trace.correction` of interval k, if they are asked for."""
    if k >= trace.cross.shape[0]:
        return
    for a in range(n):
        trace.correction[k, a] = error[a]
        for b in range(n):
            trace.filtered[k, a, b] = 0.5 * (P[a, b] + P[b, a])
