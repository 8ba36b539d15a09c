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
_INPUTS = "gravity", "accelerometer", "gyroscope"
"""What an interval takes in, three axes each."""


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

    @property
    def input(self) -> tuple[int, int]:
        """Which of gravity (3), accelerometers (3) and gyroscopes (3) it enters, -1 = none; and
        which of 1, specific force (3) and angular rate (3) it is a share of (`readings`)."""
        sensor = self.enters.removesuffix("_scale")
        if sensor == "none":
            return -1, 0
        first = 3 * _INPUTS.index(sensor)
        source = self.axis if self.source is None else self.source
        return first + self.axis, 0 if sensor == self.enters else first - 2 + source


class Auxiliary(NamedTuple):
    """The auxiliary states as the kernels take them."""

    row: Integers
    """(M,) which input each enters, and"""
    share: Integers
    """(M,) of what it is a share: see `AuxiliaryState.input`."""
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
    inputs = np.array([one.input for one in states], dtype=np.int64).reshape(-1, 2)
    process = [(one.sigma**2, 1.0 / one.time, 1.0 / one.length, one.walk**2) for one in states]
    return Auxiliary(*inputs.T.copy(), *np.reshape(np.array(process, float), (-1, 4)).T.copy())


@kernel(**INLINE)
def readings(force: Array, rate: Array) -> Array:
    """Return (7,) what auxiliary states may be shares of: 1, specific force, angular rate."""
    return np.array([1.0, force[0], force[1], force[2], rate[0], rate[1], rate[2]])


@kernel(**INLINE)
def ageing(
    auxiliary: Auxiliary,
    residual: Array,
    more: float,
    velocity: Array,
    dt: float,
    keep: Array,
    fresh: Array,
) -> None:
    """Write how much of each auxiliary state an interval keeps, exp(-time / T - distance / L), to
    `keep` (M,), and the variance that comes in, such that that of its process stays, to `fresh`
    (M,).

    Those of gravity have a 1-sigma (m/s²) and a correlation length (m) of their own where
    `residual` (2,) is not zero, and a variance of `more`, (m/s²)², beside that."""
    distance = dt * math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1])
    for j in range(len(keep)):
        variance, per_metre = auxiliary.variance[j], auxiliary.per_metre[j]
        if 0 <= auxiliary.row[j] < 3:
            if residual[1] > 0.0:
                variance, per_metre = residual[0] * residual[0], 1.0 / residual[1]
            variance += more
        keep[j] = math.exp(-dt * auxiliary.per_second[j] - distance * per_metre)
        fresh[j] = variance * (1.0 - keep[j] * keep[j]) + auxiliary.walk[j] * dt


@kernel(**INLINE)
def add_input(auxiliary: Auxiliary, j: int, value: float, read: Array, total: Array) -> None:
    """Add what a value of state j does in an interval to `total` (9,): gravity (NED, m/s²),
    reading of the accelerometers (body, m/s²), of the gyroscopes (body, rad/s). `read` (7,) are
    the interval's `readings`."""
    if auxiliary.row[j] >= 0:
        total[auxiliary.row[j]] += value * read[auxiliary.share[j]]


@kernel(**INLINE)
def spread_input(auxiliary: Auxiliary, read: Array, points: Array, pushes: Array) -> None:
    """Write what the auxiliary part of each sigma point does in an interval, (9, lanes) as
    `add_input`."""
    lanes = points.shape[1]
    for axis in range(9):
        for i in range(lanes):
            pushes[axis, i] = 0.0
    for j in range(len(auxiliary.row)):
        row, factor = auxiliary.row[j], read[auxiliary.share[j]]
        if row >= 0:
            for i in range(lanes):
                pushes[row, i] += factor * points[FILTER_STATES + j, i]


@kernel(**INLINE)
def tail_points(
    auxiliary: Auxiliary,
    attitude: Array,
    read: Array,
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
    first, size = FILTER_STATES, FILTER_STATES + len(auxiliary.row)
    w, x, y, z = attitude[0], attitude[1], attitude[2], attitude[3]
    fn, fe, fd = rotate(w, x, y, z, read[1], read[2], read[3])
    for k in range(first, size):
        for i in range(9):
            total[i] = 0.0
        for j in range(k, size):
            add_input(auxiliary, j - first, factor[k, j], read, total)
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
def age(keep: Array, fresh: Array, mean: Array, covariance: Array) -> None:
    """Let the auxiliary states (M,) of an interval change to those of the next, in place, by what
    `ageing` has written."""
    size = FILTER_STATES + len(keep)
    for j in range(len(keep)):
        at = FILTER_STATES + j
        mean[j] *= keep[j]
        for i in range(size):
            covariance[at, i] *= keep[j]
        for i in range(size):
            covariance[i, at] *= keep[j]
        covariance[at, at] += fresh[j]
