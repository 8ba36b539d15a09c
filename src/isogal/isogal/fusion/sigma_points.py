"""Sigma points of the error state: their weights, their way through the strapdown, their moments
(docs/mathematics.md, section 3.5).

Weights and spread are those of van der Merwe's scaled transform, as filterpy gives them. A sigma
point is the nominal state moved by an error state, and goes through the full strapdown step.

The thirty sigma points of a run are the lanes of vector instructions: loops over `LANES` contain
neither branches nor calls, and the work arrays are made where the loops are inlined, since only
arrays of known shape let the compiler see that rows do not overlap. Lane 15 is the centre, lanes 0
to 14 are the points along the first columns of the covariance's factor, 16 to 30 those opposite;
lane 31 is the centre once more. The columns of auxiliary states, where there are any, follow in
`auxiliary.tail_points`, without lanes: N below is the number of all states, W that of columns in
memory. Both are arguments, not constants: a kernel for each number of states would be a twentieth
faster (a sixth without auxiliary states), and take five seconds each to compile."""

import math
from functools import cache
from typing import NamedTuple

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature
from isogal.fusion.nominal import Nominal
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.rotations import (
    INLINE,
    SMALL,
    Vector,
    from_short_rotation_vector,
    multiply,
    to_rotation_vector,
    to_small_rotation_vector,
)
from isogal.inertial.strapdown import step

CORE = FILTER_STATES
HALF, LANES, CENTRE = 16, 32, 15
BETA = 2.0
"""Of a Gaussian."""
NAVIGATION = 9
"""Error states that change over an interval: all but the biases."""


class Weights(NamedTuple):
    """What the kernels need of the scaled transform. The centre's weight in the mean is not among
    it: the error of the centre is zero."""

    spread: float
    """How many columns of the covariance's factor a point is from the centre."""
    centre: float
    """Weight of the centre in the covariance."""
    other: float
    """Weight of each other point, in mean and covariance."""


@cache
def merwe_weights(alpha: float, states: int = CORE) -> Weights:
    """Return the spread and the weights of the scaled sigma points of so many states (van der
    Merwe 2004, section 3.2, with `BETA`, and kappa zero), equal to filterpy's, which would take a
    second to import."""
    scaling = alpha**2 * states - states
    total = states + scaling
    return Weights(math.sqrt(total), scaling / total + (1.0 - alpha**2 + BETA), 0.5 / total)


@kernel(**INLINE)
def columns(n: int) -> int:
    """Return W, the number of states rounded up to whole vectors."""
    return (n + 3) // 4 * 4


@kernel(**INLINE)
def factorise(n: int, matrix: Array, work: Array, pivots: Array) -> bool:
    """Replace row k of `work` (N, W) by column k of the lower Cholesky factor; return False
    where `matrix` is not positive definite.

    Rows are eliminated from top to bottom, square roots come last: they would only lengthen the
    chain of dependent operations."""
    width = columns(n)
    for i in range(n):
        for j in range(width):
            work[i, j] = matrix[i, j]
    definite = True
    for k in range(n):
        pivot = work[k, k]
        definite = definite and pivot > 0.0
        inverse = 1.0 / pivot
        for i in range(k + 1, n):
            ratio = work[k, i] * inverse
            for j in range(width):
                work[i, j] -= ratio * work[k, j]
        pivots[k] = pivot
    for k in range(n):
        scale = 1.0 / math.sqrt(pivots[k])
        for j in range(width):
            work[k, j] *= scale
        for j in range(k):
            work[k, j] = 0.0
    return definite


@kernel(**INLINE)
def spread_points(n: int, factor: Array, spread: float, points: Array) -> None:
    """Write the error states of the sigma points (N, 32): spread times a column of the factor, and
    its opposite."""
    for i in range(n):
        for j in range(HALF):
            points[i, j] = 0.0
        for j in range(min(i + 1, CORE)):
            points[i, j] = spread * factor[j, i]
        for j in range(HALF):
            points[i, HALF + j] = -points[i, j]


@kernel(**INLINE)
def propagate_points(
    nominal: Nominal,
    force: Vector,
    rate: Vector,
    gravity: Vector,
    dt: float,
    coning: float,
    points: Array,
    pushes: Array,
    ends: Array,
) -> None:
    """Move the nominal state by each point's error and take the result through the strapdown.

    `force`, `rate` (3,) are the interval's means as measured, without what the auxiliary states
    take off them; `gravity` is what the navigator knows of gravity beside normal gravity: to
    north, east and down (m/s²); `coning` is that of the strapdown's step.
    `pushes` (9, 32) is what the auxiliary part of each point adds (`auxiliary.spread_input`),
    `ends` (10, 32) gets position, velocity and attitude of each point."""
    position, velocity, attitude, ba, bg, _ = nominal
    gn, ge, gd = gravity
    s, c = math.sin(position[0]), math.cos(position[0])
    m, n = curvature(s)
    per_north, per_east = 1.0 / (m + position[2]), 1.0 / ((n + position[2]) * c)
    lat, lon, h = position[0], position[1], position[2]
    vn, ve, vd = velocity[0], velocity[1], velocity[2]
    qw, qx, qy, qz = attitude[0], attitude[1], attitude[2], attitude[3]
    fx, fy, fz = force[0] - ba[0], force[1] - ba[1], force[2] - ba[2]
    wx, wy, wz = rate[0] - bg[0], rate[1] - bg[1], rate[2] - bg[2]
    for i in range(LANES):
        turn = points[0, i] * per_north
        # sine and cosine of the latitude by addition, from their series in the turn (exact to
        # 1e-16 for 300 km)
        t2 = turn * turn
        sine = turn * (
            1.0
            + t2 * (-1.0 / 6.0 + t2 * (1.0 / 120.0 + t2 * (-1.0 / 5040.0 + t2 * (1.0 / 362880.0))))
        )
        versine = t2 * (0.5 + t2 * (-1.0 / 24.0 + t2 * (1.0 / 720.0 + t2 * (-1.0 / 40320.0))))
        bw, bx, by, bz = from_short_rotation_vector(points[6, i], points[7, i], points[8, i])
        bw, bx, by, bz = multiply(bw, bx, by, bz, qw, qx, qy, qz)
        place, speed, turned = step(
            s + (c * sine - s * versine),
            c - (s * sine + c * versine),
            (lat + turn, lon + points[1, i] * per_east, h - points[2, i]),
            (vn + points[3, i], ve + points[4, i], vd + points[5, i]),
            (bw, bx, by, bz),
            (
                fx - points[9, i] - pushes[3, i],
                fy - points[10, i] - pushes[4, i],
                fz - points[11, i] - pushes[5, i],
            ),
            (
                wx - points[12, i] - pushes[6, i],
                wy - points[13, i] - pushes[7, i],
                wz - points[14, i] - pushes[8, i],
            ),
            (gn + pushes[0, i], ge + pushes[1, i], gd + pushes[2, i]),
            dt,
            coning,
        )
        ends[0, i], ends[1, i], ends[2, i] = place
        ends[3, i], ends[4, i], ends[5, i] = speed
        ends[6, i], ends[7, i], ends[8, i], ends[9, i] = turned


@kernel(**INLINE)
def errors_of(ends: Array, points: Array) -> None:
    """Overwrite the first nine rows of `points` by how far each end is from the centre's; biases
    have not moved."""
    lat, lon, h = ends[0, CENTRE], ends[1, CENTRE], ends[2, CENTRE]
    vn, ve, vd = ends[3, CENTRE], ends[4, CENTRE], ends[5, CENTRE]
    qw, qx, qy, qz = ends[6, CENTRE], ends[7, CENTRE], ends[8, CENTRE], ends[9, CENTRE]
    m, n = curvature(math.sin(lat))
    m += h
    n = (n + h) * math.cos(lat)
    large = 0
    for i in range(LANES):
        points[0, i] = (ends[0, i] - lat) * m
        points[1, i] = (ends[1, i] - lon) * n
        points[2, i] = h - ends[2, i]
        points[3, i] = ends[3, i] - vn
        points[4, i] = ends[4, i] - ve
        points[5, i] = ends[5, i] - vd
        w, x, y, z = multiply(ends[6, i], ends[7, i], ends[8, i], ends[9, i], qw, -qx, -qy, -qz)
        points[6, i], points[7, i], points[8, i] = to_small_rotation_vector(x, y, z)
        large += (w <= 0.0) | (x * x + y * y + z * z > SMALL)
    if large > 0:
        for i in range(LANES):
            points[6, i], points[7, i], points[8, i] = to_rotation_vector(
                *multiply(ends[6, i], ends[7, i], ends[8, i], ends[9, i], qw, -qx, -qy, -qz)
            )


@kernel(**INLINE)
def moments(
    n: int,
    points: Array,
    even: Array,
    odd: Array,
    weights: Weights,
    mean: Array,
    covariance: Array,
) -> None:
    """Write mean (W,) and covariance (N, W) of the points, by halves of sums (`even`) and
    differences of opposite points (`odd`, whose rows 16 on `auxiliary.tail_points` has written).

    With p and m a point and its opposite, p p' + m m' = 2 (e e' + o o'), e = (p + m) / 2, o = (p -
    m) / 2. Biases and auxiliary states are constant over the interval, so their e is zero and
    their covariance stays; that of the others with them takes the odd part only."""
    width = columns(n)
    for i in range(n):
        for j in range(HALF):
            odd[j, i] = 0.5 * (points[i, j] - points[i, HALF + j])
            even[j, i] = 0.5 * (points[i, j] + points[i, HALF + j])
    for i in range(width):
        mean[i] = 0.0
    for j in range(CORE):
        for i in range(width):
            mean[i] += even[j, i]
    for i in range(width):
        mean[i] *= 2.0 * weights.other
    for a in range(NAVIGATION):
        for b in range(width):
            covariance[a, b] = weights.centre * mean[a] * mean[b]
    for j in range(CORE):
        for i in range(width):
            even[j, i] -= mean[i]
        for b in range(width):
            o = 2.0 * weights.other * odd[j, b]
            e = 2.0 * weights.other * even[j, b]
            for a in range(NAVIGATION):
                covariance[a, b] += odd[j, a] * o + even[j, a] * e
    for j in range(HALF, n + 1):
        for b in range(width):
            # the spread is not in these points: their weight is 2 other spread² = 1; their even
            # part is that of the centre, zero, less the mean
            o = odd[j, b]
            e = 2.0 * weights.other * mean[b]
            for a in range(NAVIGATION):
                covariance[a, b] += odd[j, a] * o + mean[a] * e
    for a in range(NAVIGATION, n):
        for b in range(NAVIGATION):
            covariance[a, b] = covariance[b, a]
