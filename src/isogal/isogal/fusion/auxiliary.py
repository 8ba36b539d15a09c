"""Auxiliary states of the filter: what disturbs the navigator's dynamics linearly.

Each is a first-order Gauss-Markov process in time or along the track, a random walk or a constant:
the horizontal gravity that no map takes off, the slowly changing part of a sensor's bias, its
scale factor. The filter's fifteen states go through the strapdown as sigma points; an auxiliary
state enters an interval as a constant acceleration or angular rate, which is linear, so that its
part of the covariance needs no sigma points through the strapdown (reduced sigma points of a
partially linear model: Morelande & Ristic 2006; docs/mathematics.md, section 3.5)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.rotations import INLINE, rotate

Enters = Literal[
    "gravity", "accelerometer", "accelerometer_scale", "gyroscope", "gyroscope_scale", "none"
]
_CODES: tuple[Enters, ...] = (
    "gravity",
    "accelerometer",
    "gyroscope",
    "accelerometer_scale",
    "gyroscope_scale",
    "none",
)
GRAVITY, ACCELEROMETER, GYROSCOPE, ACCELEROMETER_SCALE, GYROSCOPE_SCALE, NONE = range(6)


@dataclass(frozen=True, slots=True)
class AuxiliaryState:
    """One auxiliary state and its process."""

    name: str
    """What it is, for example ``gravity_north``."""
    enters: Enters
    """``gravity``: of gravity beside what the strapdown takes off (axis 0 to 2: north, east, down;
    m/s²). ``accelerometer``, ``gyroscope``: error of a reading (body axis; m/s²,
    rad/s). ``accelerometer_scale``, ``gyroscope_scale``: the same as a share of a reading.
    ``none``: only measurements see it."""
    axis: int
    sigma: float
    """1-sigma at the start; of a Gauss-Markov process at any time."""
    time: float = math.inf
    """Correlation time, s."""
    length: float = math.inf
    """Correlation length along the track, m."""
    walk: float = 0.0
    """Density of a random walk beside it, unit of the state / sqrt(s)."""
    source: int | None = None
    """Axis whose reading a share is of, where it is another one: the state is then a misalignment.
    """


class Auxiliary(NamedTuple):
    """The auxiliary states as the kernels take them."""

    enters: Integers
    """(M,) code of what each enters."""
    axis: Integers
    """(M,)."""
    source: Integers
    """(M,) axis whose reading a share is of."""
    variance: Array
    """(M,) of the steady process."""
    per_second: Array
    """(M,) 1 / correlation time."""
    per_metre: Array
    """(M,) 1 / correlation length."""
    walk: Array
    """(M,) variance that a random walk adds in a second."""


def auxiliary_of(states: Sequence[AuxiliaryState]) -> Auxiliary:
    """Return the states as the kernels take them."""
    codes = [_CODES.index(state.enters) for state in states]
    return Auxiliary(
        np.array(codes, dtype=np.int64),
        np.array([state.axis for state in states], dtype=np.int64),
        np.array(
            [state.axis if state.source is None else state.source for state in states],
            dtype=np.int64,
        ),
        np.array([state.sigma**2 for state in states], dtype=float),
        np.array([1.0 / state.time for state in states], dtype=float),
        np.array([1.0 / state.length for state in states], dtype=float),
        np.array([state.walk**2 for state in states], dtype=float),
    )


@kernel(**INLINE)
def of_gravity(auxiliary: Auxiliary, residual: Array) -> Auxiliary:
    """Return the states where those of gravity have a 1-sigma (m/s²) and a correlation length (m):
    `residual` (2,); zeros = their own."""
    variance, per_metre = auxiliary.variance.copy(), auxiliary.per_metre.copy()
    for j in range(len(auxiliary.enters)):
        if auxiliary.enters[j] == GRAVITY and residual[1] > 0.0:
            variance[j] = residual[0] * residual[0]
            per_metre[j] = 1.0 / residual[1]
    return Auxiliary(
        auxiliary.enters, auxiliary.axis, auxiliary.source, variance, auxiliary.per_second,
        per_metre, auxiliary.walk,
    )  # fmt: skip


@kernel(**INLINE)
def add_gravity(auxiliary: Auxiliary, left: Array, more: float) -> None:
    """Let a variance of `more`, (m/s²)², join that of the states of gravity in place; `left` (M,)
    without it."""
    for j in range(len(auxiliary.enters)):
        if auxiliary.enters[j] == GRAVITY:
            auxiliary.variance[j] = left[j] + more


@kernel(**INLINE)
def add_input(
    auxiliary: Auxiliary, j: int, value: float, force: Array, rate: Array, total: Array
) -> None:
    """Add what a value of state j does in an interval to `total` (9,): gravity (NED, m/s²),
    reading of the accelerometers (body, m/s²), of the gyroscopes (body, rad/s).

    `force`, `rate` (3,) are the interval's readings."""
    enters, axis = auxiliary.enters[j], auxiliary.axis[j]
    if enters <= GYROSCOPE:
        total[3 * enters + axis] += value
    elif enters == ACCELEROMETER_SCALE:
        total[3 + axis] += value * force[auxiliary.source[j]]
    elif enters == GYROSCOPE_SCALE:
        total[6 + axis] += value * rate[auxiliary.source[j]]


@kernel(**INLINE)
def spread_input(
    auxiliary: Auxiliary, force: Array, rate: Array, points: Array, pushes: Array
) -> None:
    """Write what the auxiliary part of each sigma point does in an interval, (9, lanes) as
    `add_input`."""
    first, lanes = FILTER_STATES, points.shape[1]
    for axis in range(9):
        for i in range(lanes):
            pushes[axis, i] = 0.0
    for j in range(len(auxiliary.enters)):
        enters, axis = auxiliary.enters[j], auxiliary.axis[j]
        if enters == NONE:
            continue
        if enters == ACCELEROMETER_SCALE:
            row, factor = 3 + axis, force[auxiliary.source[j]]
        elif enters == GYROSCOPE_SCALE:
            row, factor = 6 + axis, rate[auxiliary.source[j]]
        else:
            row, factor = 3 * enters + axis, 1.0
        for i in range(lanes):
            pushes[row, i] += factor * points[first + j, i]


@kernel(**INLINE)
def tail_points(
    auxiliary: Auxiliary,
    attitude: Array,
    force: Array,
    rate: Array,
    dt: float,
    factor: Array,
    odd: Array,
    total: Array,
) -> None:
    """Write the ends of the points along the auxiliary states' own columns of the covariance's
    factor (N, W), a row a column: to rows 16 on of `odd` (N + 1, W).

    Such a point moves no core state at the start; a constant acceleration and angular rate move
    velocity, position and attitude linearly, the latter tilting the specific force by half of its
    turn on the mean. `total` (9,) is work space."""
    first, size = FILTER_STATES, FILTER_STATES + len(auxiliary.enters)
    w, x, y, z = attitude[0], attitude[1], attitude[2], attitude[3]
    fn, fe, fd = rotate(w, x, y, z, force[0], force[1], force[2])
    for k in range(first, size):
        for i in range(9):
            total[i] = 0.0
        for j in range(k, size):
            add_input(auxiliary, j - first, factor[k, j], force, rate, total)
        pull = rotate(w, x, y, z, -total[3], -total[4], -total[5])
        turn = rotate(w, x, y, z, -total[6], -total[7], -total[8])
        half = 0.5 * dt
        tilt = (
            half * (turn[1] * fd - turn[2] * fe),
            half * (turn[2] * fn - turn[0] * fd),
            half * (turn[0] * fe - turn[1] * fn),
        )
        for i in range(3):
            gain = (total[i] + pull[i] + tilt[i]) * dt
            odd[k + 1, i] = 0.5 * dt * gain
            odd[k + 1, 3 + i] = gain
            odd[k + 1, 6 + i] = turn[i] * dt
            odd[k + 1, 9 + i] = 0.0
            odd[k + 1, 12 + i] = 0.0
        for j in range(first, size):
            odd[k + 1, j] = factor[k, j]


@kernel(**INLINE)
def age(auxiliary: Auxiliary, mean: Array, velocity: Array, dt: float, covariance: Array) -> None:
    """Let the auxiliary states of an interval change to those of the next, in place: x' = a x + w
    with a = exp(-time / T - distance / L) and w such that the variance stays."""
    first, size = FILTER_STATES, FILTER_STATES + len(auxiliary.enters)
    if size == first:
        return
    distance = dt * math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1])
    for j in range(size - first):
        at = first + j
        a = math.exp(-dt * auxiliary.per_second[j] - distance * auxiliary.per_metre[j])
        mean[j] *= a
        for i in range(size):
            covariance[at, i] *= a
        for i in range(size):
            covariance[i, at] *= a
        covariance[at, at] += auxiliary.variance[j] * (1.0 - a * a) + auxiliary.walk[j] * dt
