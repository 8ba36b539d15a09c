"""The 15-state unscented Kalman filter as numba kernels over runs.

Error state, in this order: position (north, east, down; m), velocity (north, east, down; m/s),
attitude (rotation vector in the navigation frame, rad), accelerometer biases (body, m/s²),
gyroscope biases (body, rad/s). A sigma point is the nominal state moved by an error state:
position over the local radii, attitude by the quaternion of the rotation vector on the left, the
rest by addition (the small-rotation filter of Crassidis 2006, with the rotation vector as attitude
parameter). Every sigma point goes through the full strapdown step. Sigma points and weights are
those of van der Merwe's scaled transform (filterpy's MerweScaledSigmaPoints; tested against it).
Updates are linear in the error state (position, height), where the unscented and the Kalman update
are the same formula.

The thirty sigma points of a run are the lanes of vector instructions: loops over `LANES` contain
neither branches nor calls, and the work arrays are made where the loops are inlined, since only
arrays of known shape let the compiler see that rows do not overlap. Lane 15 is the centre, lanes 0
to 14 are the points along the columns of the covariance's factor, 16 to 30 those opposite; lane 31
is the centre once more."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature
from isogal.inertial.rotations import (
    INLINE,
    SMALL,
    from_rotation_vector,
    from_short_rotation_vector,
    multiply,
    rotate,
    to_rotation_vector,
    to_small_rotation_vector,
)
from isogal.inertial.strapdown import step_at

N = 15
"""Number of error states."""
HALF, LANES, CENTRE = 16, 32, 15
NAVIGATION = 9
"""Error states that change over an interval: all but the biases."""
POSITION, VELOCITY, ATTITUDE, ACCELEROMETER_BIAS, GYROSCOPE_BIAS = (
    slice(i, i + 3) for i in range(0, N, 3)
)
HORIZONTAL = np.array([0, 1, 3, 4])
"""Indices of north, east, v_north, v_east."""
BATCH = np.array([0, 1, 3, 4, 6, 7, 8])
"""Indices of the states whose error moves a position by metres within a batch: horizontal position
and velocity, attitude."""


@dataclass(frozen=True, slots=True)
class UnscentedWeights:
    """Scaled sigma point weights (van der Merwe 2004, eq. 3.2): spread sqrt(n + lambda), weights
    of centre and others."""

    spread: float
    mean_centre: float
    covariance_centre: float
    other: float


def unscented_weights(
    n: int = N, alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0
) -> UnscentedWeights:
    """Return the weights; the defaults put no weight on the centre's mean (no cancellation of
    large weights of opposite sign)."""
    lam = alpha * alpha * (n + kappa) - n
    return UnscentedWeights(
        math.sqrt(n + lam),
        lam / (n + lam),
        lam / (n + lam) + 1.0 - alpha * alpha + beta,
        0.5 / (n + lam),
    )


@kernel(**INLINE)
def move(position, velocity, attitude, accelerometer_bias, gyroscope_bias, error):  # type: ignore[no-untyped-def]
    """Add an error state (15,) to one nominal state, in place."""
    m, n = curvature(math.sin(position[0]))
    position[1] += error[1] / ((n + position[2]) * math.cos(position[0]))
    position[0] += error[0] / (m + position[2])
    position[2] -= error[2]
    bw, bx, by, bz = from_rotation_vector(error[6], error[7], error[8])
    attitude[0], attitude[1], attitude[2], attitude[3] = multiply(
        bw, bx, by, bz, attitude[0], attitude[1], attitude[2], attitude[3]
    )
    for i in range(3):
        velocity[i] += error[3 + i]
        accelerometer_bias[i] += error[9 + i]
        gyroscope_bias[i] += error[12 + i]


@kernel(**INLINE)
def factorise(matrix, work, pivots):  # type: ignore[no-untyped-def]
    """Replace row k of `work` (15, 16) by column k of the lower Cholesky factor; return False
    where `matrix` is not positive definite.

    Rows are eliminated from top to bottom, square roots come last: they would only lengthen the
    chain of dependent operations."""
    for i in range(N):
        for j in range(HALF):
            work[i, j] = matrix[i, j]
    definite = True
    for k in range(N):
        pivot = work[k, k]
        definite = definite and pivot > 0.0
        inverse = 1.0 / pivot
        for i in range(k + 1, N):
            ratio = work[k, i] * inverse
            for j in range(HALF):
                work[i, j] -= ratio * work[k, j]
        pivots[k] = pivot
    for k in range(N):
        scale = 1.0 / math.sqrt(pivots[k])
        for j in range(HALF):
            work[k, j] *= scale
        for j in range(k):
            work[k, j] = 0.0
    return definite


@kernel(**INLINE)
def spread_points(factor, spread, points):  # type: ignore[no-untyped-def]
    """Write the error states of the sigma points (15, 32): spread times a column of the factor,
    and its opposite."""
    for i in range(N):
        for j in range(HALF):
            points[i, j] = 0.0
        for j in range(i + 1):
            points[i, j] = spread * factor[j, i]
        for j in range(HALF):
            points[i, HALF + j] = -points[i, j]


@kernel(**INLINE)
def propagate_points(position, velocity, attitude, ba, bg, force, rate, dt, points, ends):  # type: ignore[no-untyped-def]
    """Move the nominal state by each point's error and take the result through the strapdown;
    `ends` (10, 32) as `step` returns it."""
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
        end = step_at(
            s + (c * sine - s * versine),
            c - (s * sine + c * versine),
            lat + turn,
            lon + points[1, i] * per_east,
            h - points[2, i],
            vn + points[3, i],
            ve + points[4, i],
            vd + points[5, i],
            bw, bx, by, bz,
            fx - points[9, i],
            fy - points[10, i],
            fz - points[11, i],
            wx - points[12, i],
            wy - points[13, i],
            wz - points[14, i],
            dt,
        )  # fmt: skip
        for k in range(10):
            ends[k, i] = end[k]


@kernel(**INLINE)
def errors_of(ends, points):  # type: ignore[no-untyped-def]
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
def moments(points, even, odd, w_centre_cov, w_other, mean, covariance):  # type: ignore[no-untyped-def]
    """Write mean (16,) and covariance (15, 16) of the points, by halves of sums (`even`) and
    differences of opposite points (`odd`).

    With p and m a point and its opposite, p p' + m m' = 2 (e e' + o o'), e = (p + m) / 2, o = (p -
    m) / 2. Biases are constant over the interval, so their e is zero and their covariance stays;
    that of the others with them takes the odd part only."""
    for i in range(N):
        for j in range(HALF):
            odd[j, i] = 0.5 * (points[i, j] - points[i, HALF + j])
            even[j, i] = 0.5 * (points[i, j] + points[i, HALF + j])
    for i in range(HALF):
        mean[i] = 0.0
    for j in range(N):
        for i in range(HALF):
            mean[i] += even[j, i]
    for i in range(HALF):
        mean[i] *= 2.0 * w_other
    for a in range(NAVIGATION):
        for b in range(HALF):
            covariance[a, b] = w_centre_cov * mean[a] * mean[b]
    for j in range(N):
        for i in range(HALF):
            even[j, i] -= mean[i]
        for b in range(HALF):
            o, e = 2.0 * w_other * odd[j, b], 2.0 * w_other * even[j, b]
            for a in range(NAVIGATION):
                covariance[a, b] += odd[j, a] * o + even[j, a] * e
    for a in range(NAVIGATION, N):
        for b in range(NAVIGATION):
            covariance[a, b] = covariance[b, a]


@kernel(**INLINE)
def add_noise(attitude, noise, dt, covariance):  # type: ignore[no-untyped-def]
    """Add the white noise (6,) of the sensors' axes over an interval, turned to the navigation
    frame."""
    for i in range(3):
        axis = rotate(
            attitude[0], attitude[1], attitude[2], attitude[3],
            1.0 if i == 0 else 0.0, 1.0 if i == 1 else 0.0, 1.0 if i == 2 else 0.0,
        )  # fmt: skip
        va = noise[i] * noise[i] * dt
        vg = noise[3 + i] * noise[3 + i] * dt
        for a in range(3):
            for b in range(3):
                covariance[3 + a, 3 + b] += va * axis[a] * axis[b]
                covariance[6 + a, 6 + b] += vg * axis[a] * axis[b]


@kernel(**INLINE)
def update_height(position, velocity, attitude, ba, bg, covariance, height, sigma, gain, error):  # type: ignore[no-untyped-def]
    """Update one run with a known height (m), in place; `gain` (16,) and `error` (16,) are work
    space."""
    inverse = 1.0 / (covariance[2, 2] + sigma * sigma)
    innovation = position[2] - height  # measured minus predicted, positive down
    for i in range(HALF):
        gain[i] = covariance[2, i]
        error[i] = gain[i] * (innovation * inverse)
    for a in range(N):
        scaled = gain[a] * inverse
        for b in range(HALF):
            covariance[a, b] -= scaled * gain[b]
    move(position, velocity, attitude, ba, bg, error)


@kernel(error_model="numpy")
def update_position(  # type: ignore[no-untyped-def]
    position, velocity, attitude, ba, bg, covariance, latitude, longitude, r_nn, r_ne, r_ee
):
    """Update one run with a horizontal position fix, in place; return (innovation north, east,
    normalised innovation squared).

    NaN for the last where fix plus prior covariance is not positive definite: nothing is changed
    then."""
    m, n = curvature(math.sin(position[0]))
    wrap = 2.0 * math.pi
    d_lon = (longitude - position[1] + math.pi) % wrap - math.pi
    y0 = (latitude - position[0]) * (m + position[2])
    y1 = d_lon * (n + position[2]) * math.cos(position[0])
    s00, s01, s11 = covariance[0, 0] + r_nn, covariance[0, 1] + r_ne, covariance[1, 1] + r_ee
    determinant = s00 * s11 - s01 * s01
    if not (determinant > 0.0 and s00 > 0.0):
        return y0, y1, math.nan
    i00, i01, i11 = s11 / determinant, -s01 / determinant, s00 / determinant
    a0, a1 = i00 * y0 + i01 * y1, i01 * y0 + i11 * y1
    error = np.empty(15)
    column = np.empty((15, 2))
    for i in range(15):
        column[i, 0], column[i, 1] = covariance[i, 0], covariance[i, 1]
        error[i] = column[i, 0] * a0 + column[i, 1] * a1
    for a in range(15):
        k0 = column[a, 0] * i00 + column[a, 1] * i01
        k1 = column[a, 0] * i01 + column[a, 1] * i11
        for b in range(a + 1):
            covariance[a, b] -= k0 * column[b, 0] + k1 * column[b, 1]
            covariance[b, a] = covariance[a, b]
    move(position, velocity, attitude, ba, bg, error)
    return y0, y1, y0 * a0 + y1 * a1


@kernel(error_model="numpy")
def advance(  # type: ignore[no-untyped-def]
    position,
    velocity,
    attitude,
    ba,
    bg,
    covariance,
    force,
    rate,
    dt,
    noise,
    weights,
    height,
    height_sigma,
):
    """Run prediction and the known-height update over S intervals for R runs, in place; return
    (R,) steps done before a failure.

    A run whose covariance is no longer positive definite stops at that step. `height` (S,) m,
    known height after each interval; a sigma of 0 or less switches the height aid off."""
    runs, steps = force.shape[0], force.shape[1]
    spread, _, w_centre_cov, w_other = (
        weights  # the centre's error is zero: it adds nothing to the mean
    )
    done = np.empty(runs, np.int64)
    P = np.zeros((N, HALF))
    factor = np.empty((N, HALF))
    even = np.zeros((HALF, HALF))
    odd = np.zeros((HALF, HALF))
    points = np.zeros((N, LANES))
    ends = np.empty((10, LANES))
    mean = np.zeros(HALF)
    gain = np.zeros(HALF)
    for r in range(runs):
        x, v, q, a, g = position[r], velocity[r], attitude[r], ba[r], bg[r]
        P[:, :N] = covariance[r]
        done[r] = steps
        for k in range(steps):
            if not factorise(P, factor, gain):
                done[r] = k
                break
            spread_points(factor, spread, points)
            propagate_points(x, v, q, a, g, force[r, k], rate[r, k], dt, points, ends)
            errors_of(ends, points)
            moments(points, even, odd, w_centre_cov, w_other, mean, P)
            for i in range(3):
                x[i], v[i] = ends[i, CENTRE], ends[3 + i, CENTRE]
            for i in range(4):
                q[i] = ends[6 + i, CENTRE]
            add_noise(q, noise, dt, P)
            move(x, v, q, a, g, mean)
            if height_sigma > 0.0:
                update_height(x, v, q, a, g, P, height[k], height_sigma, gain, mean)
        for i in range(N):
            for j in range(N):
                covariance[r, i, j] = 0.5 * (P[i, j] + P[j, i])
    return done
