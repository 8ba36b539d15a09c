"""The unscented Kalman filter as compiled functions over runs (docs/mathematics.md, section 3.5).

The error state is that of `isogal.inertial.error_state`, fifteen states, and any number of
auxiliary states (`auxiliary`) after them: the small-rotation filter of Crassidis (2006) with the
rotation vector as attitude parameter. Every sigma point goes through the full
strapdown step (`sigma_points`). Updates are linear in the error state (position, height), where
the unscented and the Kalman update are the same formula."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature
from isogal.fusion.auxiliary import (
    Auxiliary,
    add_input,
    age,
    of_gravity,
    spread_input,
    tail_points,
)
from isogal.fusion.height_states import HeightReading
from isogal.fusion.nominal import move, of_run
from isogal.fusion.sigma_points import (
    CENTRE,
    HALF,
    LANES,
    Weights,
    columns,
    errors_of,
    factorise,
    moments,
    propagate_points,
    spread_points,
)
from isogal.fusion.sigma_points import (
    CORE as N,
)
from isogal.inertial.gravity import Compensation, horizontal_gravity
from isogal.inertial.rotations import INLINE, rotate


class Assumptions(NamedTuple):
    """What the filter assumes, as the kernels take it."""

    dt: float
    """s, IMU interval."""
    noise: Array
    """(6,) white noise densities of accelerometers and gyroscopes, m/s²/sqrt(Hz),
    rad/s/sqrt(Hz)."""
    height_sigma: float
    """m, 1-sigma of the known height; 0 = no height aid."""
    weights: Weights
    scaling: tuple[float, float, float]
    """alpha, beta, kappa of the scaled transform, which the weights follow from."""
    auxiliary: Auxiliary
    compensation: Compensation
    """Horizontal gravity that the strapdown takes off."""
    height_reading: HeightReading
    """What a reading of the height contains beside it."""
    coning: float
    """Of the strapdown's step: `MEANS` or `ROTATIONS` of `isogal.inertial.strapdown`."""
    height_gate: float
    """The largest normalised innovation squared of a height that is used."""
    position_gate: float
    """Of a position."""


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
def update_height(  # type: ignore[no-untyped-def]
    n, nominal, covariance, height, sigma, gate, reading, gain, error
):
    """Update one run with a known or measured height (m), in place, unless it is beyond the gate;
    `gain` (W,) and `error` (W,) are work space."""
    up = nominal.position[2]
    innovation = up - height  # measured minus predicted, positive down
    for i in range(columns(n)):
        gain[i] = covariance[2, i]
    for j in range(n - N):
        contents = reading.offset[j] + reading.share[j] * up
        innovation += contents * nominal.auxiliary[j]
        for i in range(columns(n)):
            gain[i] -= contents * covariance[N + j, i]
    variance = gain[2]
    for j in range(n - N):
        variance -= (reading.offset[j] + reading.share[j] * up) * gain[N + j]
    inverse = 1.0 / (variance + sigma * sigma)
    if innovation * innovation * inverse > gate:
        return
    for i in range(columns(n)):
        error[i] = gain[i] * (innovation * inverse)
    for a in range(n):
        scaled = gain[a] * inverse
        for b in range(columns(n)):
            covariance[a, b] -= scaled * gain[b]
    move(nominal, error)


@kernel(error_model="numpy")
def update_position(  # type: ignore[no-untyped-def]
    nominal, covariance, latitude, longitude, fix_covariance, assumptions
):
    """Update one run with a horizontal position fix (rad; (2, 2) m²), in place; return (innovation
    north, east, normalised innovation squared).

    NaN for the last where fix plus prior covariance is not positive definite: nothing is changed
    then, nor where it is beyond the gate. The update is linear and needs none of the other
    assumptions; filterpy's does."""
    position, R = nominal.position, fix_covariance
    m, n = curvature(math.sin(position[0]))
    wrap = 2.0 * math.pi
    d_lon = (longitude - position[1] + math.pi) % wrap - math.pi
    y0 = (latitude - position[0]) * (m + position[2])
    y1 = d_lon * (n + position[2]) * math.cos(position[0])
    s00, s11 = covariance[0, 0] + R[0, 0], covariance[1, 1] + R[1, 1]
    s01 = covariance[0, 1] + 0.5 * (R[0, 1] + R[1, 0])
    determinant = s00 * s11 - s01 * s01
    if not (determinant > 0.0 and s00 > 0.0):
        return y0, y1, math.nan
    i00, i01, i11 = s11 / determinant, -s01 / determinant, s00 / determinant
    a0, a1 = i00 * y0 + i01 * y1, i01 * y0 + i11 * y1
    if y0 * a0 + y1 * a1 > assumptions.position_gate:
        return y0, y1, y0 * a0 + y1 * a1
    size = covariance.shape[0]
    error = np.empty(size)
    column = np.empty((size, 2))
    for i in range(size):
        column[i, 0], column[i, 1] = covariance[i, 0], covariance[i, 1]
        error[i] = column[i, 0] * a0 + column[i, 1] * a1
    for a in range(size):
        k0 = column[a, 0] * i00 + column[a, 1] * i01
        k1 = column[a, 0] * i01 + column[a, 1] * i11
        for b in range(a + 1):
            covariance[a, b] -= k0 * column[b, 0] + k1 * column[b, 1]
            covariance[b, a] = covariance[a, b]
    move(nominal, error)
    return y0, y1, y0 * a0 + y1 * a1


@kernel(error_model="numpy")
def advance(  # type: ignore[no-untyped-def]
    nominal, covariance, residual_gravity, force, rate, height, assumptions
):
    """Run prediction and the known-height update over S intervals for R runs, in place; return
    (R,) steps done before a failure.

    `force`, `rate` (R, S, 3) are the means over each interval in body axes, `height` (R, S) m the
    known or measured height after each, NaN where there is none, `residual_gravity` (R, 2) as
    `FilterState` has it. A run whose covariance is no
    longer positive definite stops at that step."""
    runs, steps = force.shape[0], force.shape[1]
    dt, noise, height_sigma, weights, _, every, compensation, reading, coning, gate, _ = (
        assumptions
    )
    n = covariance.shape[1]
    width = columns(n)
    done = np.empty(runs, np.int64)
    P = np.zeros((n, width))
    factor = np.empty((n, width))
    even = np.zeros((HALF, width))
    odd = np.zeros((n + 1, width))
    points = np.zeros((n, LANES))
    pushes = np.zeros((9, LANES))
    ends = np.empty((10, LANES))
    mean = np.zeros(width)
    gain = np.zeros(width)
    total = np.zeros(9)
    for r in range(runs):
        state, auxiliary = of_run(nominal, r), of_gravity(every, residual_gravity[r])
        x, v, q = state.position, state.velocity, state.attitude
        for i in range(n):  # a slice would take seconds to compile
            for j in range(n):
                P[i, j] = covariance[r, i, j]
        done[r] = steps
        for k in range(steps):
            if not factorise(n, P, factor, gain):
                done[r] = k
                break
            spread_points(n, factor, weights.spread, points)
            f, w = force[r, k], rate[r, k]
            total[:] = 0.0
            for j in range(n - N):
                add_input(auxiliary, j, state.auxiliary[j], f, w, total)
            gn, ge, gn_n, gn_e, ge_n, ge_e = horizontal_gravity(compensation, x)
            if n > N:
                spread_input(auxiliary, f, w, points, pushes)
            propagate_points(
                state,
                (f[0] - total[3], f[1] - total[4], f[2] - total[5]),
                (w[0] - total[6], w[1] - total[7], w[2] - total[8]),
                ((gn + total[0], ge + total[1], total[2]), (gn_n, gn_e, ge_n, ge_e)),
                dt,
                coning,
                points,
                pushes,
                ends,
            )
            tail_points(auxiliary, q, f, w, dt, factor, odd, total)
            errors_of(ends, points)
            moments(n, points, even, odd, weights, mean, P)
            age(auxiliary, state.auxiliary, v, dt, P)
            for i in range(3):
                x[i], v[i] = ends[i, CENTRE], ends[3 + i, CENTRE]
            for i in range(4):
                q[i] = ends[6 + i, CENTRE]
            add_noise(q, noise, dt, P)
            move(state, mean)
            if height_sigma > 0.0 and not math.isnan(height[r, k]):
                update_height(n, state, P, height[r, k], height_sigma, gate, reading, gain, mean)
        for i in range(n):
            for j in range(n):
                covariance[r, i, j] = 0.5 * (P[i, j] + P[j, i])
    return done
