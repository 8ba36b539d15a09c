"""The 15-state unscented Kalman filter as numba kernels over runs.

Error state, in this order: position (north, east, down; m), velocity (north, east, down; m/s), attitude (rotation vector in the
navigation frame, rad), accelerometer biases (body, m/s²), gyroscope biases (body, rad/s). A sigma point is the nominal state moved by an
error state: position over the local radii, attitude by the quaternion of the rotation vector on the left, the rest by addition (the small-rotation
filter of Crassidis 2006, with the rotation vector as attitude parameter). Every sigma point goes through the full strapdown step.
Sigma points and weights are those of van der Merwe's scaled transform (filterpy's MerweScaledSigmaPoints; tested against it).
Updates are linear in the error state (position, height), where the unscented and the Kalman update are the same formula.
"""

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from isogal.earth.ellipsoid import curvature
from isogal.inertial.rotations import from_rotation_vector, multiply, rotate, to_rotation_vector
from isogal.inertial.strapdown import step

Array = NDArray[np.float64]

N = 15
"""Number of error states."""
POSITION, VELOCITY, ATTITUDE, ACCELEROMETER_BIAS, GYROSCOPE_BIAS = (slice(i, i + 3) for i in range(0, N, 3))
HORIZONTAL = np.array([0, 1, 3, 4])
"""Indices of north, east, v_north, v_east."""
BATCH = np.array([0, 1, 3, 4, 6, 7, 8])
"""Indices of the states whose error moves a position by metres within a batch: horizontal position and velocity, attitude."""


@dataclass(frozen=True, slots=True)
class UnscentedWeights:
    """Scaled sigma point weights (van der Merwe 2004, eq. 3.2): spread sqrt(n + lambda), weights of centre and others."""

    spread: float
    mean_centre: float
    covariance_centre: float
    other: float


def unscented_weights(n: int = N, alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0) -> UnscentedWeights:
    """Return the weights; the defaults put no weight on the centre's mean (no cancellation of large weights of opposite sign)."""
    lam = alpha * alpha * (n + kappa) - n
    return UnscentedWeights(
        math.sqrt(n + lam), lam / (n + lam), lam / (n + lam) + 1.0 - alpha * alpha + beta, 0.5 / (n + lam)
    )


@njit(cache=True, nogil=True)
def cholesky(matrix, factor):  # type: ignore[no-untyped-def]
    """Write the lower Cholesky factor of a symmetric matrix; return False where it is not positive definite."""
    n = matrix.shape[0]
    for j in range(n):
        total = matrix[j, j]
        for k in range(j):
            total -= factor[j, k] * factor[j, k]
        if not total > 0.0:
            return False
        root = math.sqrt(total)
        factor[j, j] = root
        for i in range(j + 1, n):
            total = matrix[i, j]
            for k in range(j):
                total -= factor[i, k] * factor[j, k]
            factor[i, j] = total / root
        for i in range(j):
            factor[i, j] = 0.0
    return True


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def predict(position, velocity, attitude, ba, bg, covariance, force, rate, dt, noise, weights, factor, errors):  # type: ignore[no-untyped-def]
    """Propagate mean and covariance of one run over one IMU interval, in place; return False where the covariance is not SPD.

    `noise` (6,) is the white noise density of accelerometers and gyroscopes; `factor` (15, 15) and `errors` (30, 15) are work space.
    """
    spread, _, w_centre_cov, w_other = weights  # the centre's error is zero: it adds nothing to the mean
    if not cholesky(covariance, factor):
        return False
    m0, n0 = curvature(math.sin(position[0]))
    m0 += position[2]
    n0 = (n0 + position[2]) * math.cos(position[0])
    lat, lon, h, vn, ve, vd, qw, qx, qy, qz = step(
        position[0], position[1], position[2], velocity[0], velocity[1], velocity[2],
        attitude[0], attitude[1], attitude[2], attitude[3],
        force[0] - ba[0], force[1] - ba[1], force[2] - ba[2],
        rate[0] - bg[0], rate[1] - bg[1], rate[2] - bg[2], dt,
    )  # fmt: skip
    m1, n1 = curvature(math.sin(lat))
    m1 += h
    n1 = (n1 + h) * math.cos(lat)

    mean = np.zeros(15)
    for j in range(15):
        for sign in range(2):
            scale = spread if sign == 0 else -spread
            row = errors[2 * j + sign]
            bw, bx, by, bz = from_rotation_vector(scale * factor[6, j], scale * factor[7, j], scale * factor[8, j])
            pw, px, py, pz = multiply(bw, bx, by, bz, attitude[0], attitude[1], attitude[2], attitude[3])
            lat_i, lon_i, h_i, vn_i, ve_i, vd_i, pw, px, py, pz = step(
                position[0] + scale * factor[0, j] / m0,
                position[1] + scale * factor[1, j] / n0,
                position[2] - scale * factor[2, j],
                velocity[0] + scale * factor[3, j],
                velocity[1] + scale * factor[4, j],
                velocity[2] + scale * factor[5, j],
                pw, px, py, pz,
                force[0] - ba[0] - scale * factor[9, j],
                force[1] - ba[1] - scale * factor[10, j],
                force[2] - ba[2] - scale * factor[11, j],
                rate[0] - bg[0] - scale * factor[12, j],
                rate[1] - bg[1] - scale * factor[13, j],
                rate[2] - bg[2] - scale * factor[14, j],
                dt,
            )  # fmt: skip
            row[0] = (lat_i - lat) * m1
            row[1] = (lon_i - lon) * n1
            row[2] = h - h_i
            row[3] = vn_i - vn
            row[4] = ve_i - ve
            row[5] = vd_i - vd
            row[6], row[7], row[8] = to_rotation_vector(*multiply(pw, px, py, pz, qw, -qx, -qy, -qz))
            for i in range(9, 15):
                row[i] = scale * factor[i, j]
            for i in range(9):
                mean[i] += w_other * row[i]

    for a in range(15):
        for b in range(a + 1):
            total = w_centre_cov * mean[a] * mean[b]
            covariance[a, b] = total
    for i in range(30):
        row = errors[i]
        for a in range(15):
            row[a] -= mean[a]
        for a in range(15):
            scaled = w_other * row[a]
            for b in range(a + 1):
                covariance[a, b] += scaled * row[b]
    for i in range(3):  # white noise of the axes, turned to the navigation frame
        cx, cy, cz = rotate(qw, qx, qy, qz, 1.0 if i == 0 else 0.0, 1.0 if i == 1 else 0.0, 1.0 if i == 2 else 0.0)
        va = noise[i] * noise[i] * dt
        vg = noise[3 + i] * noise[3 + i] * dt
        covariance[3, 3] += va * cx * cx
        covariance[4, 3] += va * cy * cx
        covariance[4, 4] += va * cy * cy
        covariance[5, 3] += va * cz * cx
        covariance[5, 4] += va * cz * cy
        covariance[5, 5] += va * cz * cz
        covariance[6, 6] += vg * cx * cx
        covariance[7, 6] += vg * cy * cx
        covariance[7, 7] += vg * cy * cy
        covariance[8, 6] += vg * cz * cx
        covariance[8, 7] += vg * cz * cy
        covariance[8, 8] += vg * cz * cz
    for a in range(15):
        for b in range(a):
            covariance[b, a] = covariance[a, b]

    position[0], position[1], position[2] = lat, lon, h
    velocity[0], velocity[1], velocity[2] = vn, ve, vd
    attitude[0], attitude[1], attitude[2], attitude[3] = qw, qx, qy, qz
    move(position, velocity, attitude, ba, bg, mean)
    return True


@njit(cache=True, nogil=True)
def update_height(position, velocity, attitude, ba, bg, covariance, height, sigma):  # type: ignore[no-untyped-def]
    """Update one run with a known height (m), in place."""
    s = covariance[2, 2] + sigma * sigma
    innovation = position[2] - height  # measured minus predicted, positive down
    gain = np.empty(15)
    for i in range(15):
        gain[i] = covariance[i, 2]
    for a in range(15):
        for b in range(a + 1):
            covariance[a, b] -= gain[a] * gain[b] / s
            covariance[b, a] = covariance[a, b]
    for i in range(15):
        gain[i] *= innovation / s
    move(position, velocity, attitude, ba, bg, gain)


@njit(cache=True, nogil=True)
def update_position(position, velocity, attitude, ba, bg, covariance, latitude, longitude, r_nn, r_ne, r_ee):  # type: ignore[no-untyped-def]
    """Update one run with a horizontal position fix, in place; return (innovation north, east, normalised innovation squared).

    NaN for the last where fix plus prior covariance is not positive definite: nothing is changed then.
    """
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


@njit(cache=True, nogil=True)
def advance(position, velocity, attitude, ba, bg, covariance, force, rate, dt, noise, weights, height, height_sigma):  # type: ignore[no-untyped-def]
    """Run predict and the known-height update over S intervals for R runs, in place; return (R,) steps done before a failure.

    `height` (S,) m, known height after each interval; a sigma of 0 or less switches the height aid off.
    """
    runs, steps = force.shape[0], force.shape[1]
    done = np.empty(runs, np.int64)
    factor = np.empty((15, 15))
    errors = np.empty((30, 15))
    for r in range(runs):
        done[r] = steps
        for k in range(steps):
            if not predict(
                position[r],
                velocity[r],
                attitude[r],
                ba[r],
                bg[r],
                covariance[r],
                force[r, k],
                rate[r, k],
                dt,
                noise,
                weights,
                factor,
                errors,
            ):
                done[r] = k
                break
            if height_sigma > 0.0:
                update_height(
                    position[r], velocity[r], attitude[r], ba[r], bg[r], covariance[r], height[k], height_sigma
                )
    return done
