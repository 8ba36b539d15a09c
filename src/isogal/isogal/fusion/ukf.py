"""The unscented Kalman filter as compiled functions (docs/mathematics.md, section 3.5).

The error state is that of `isogal.inertial.error_state`, fifteen states, and any number of
auxiliary states (`auxiliary`) after them: the small-rotation filter of Crassidis (2006) with the
rotation vector as attitude parameter. Every sigma point goes through the full
strapdown step (`sigma_points`). The update with a known height is linear in the error state, where
the unscented and the Kalman update are the same formula; so are all others
(`isogal.fusion.measurements`)."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.fusion.auxiliary import (
    Auxiliary,
    add_input,
    age,
    ageing,
    readings,
    spread_input,
    tail_points,
)
from isogal.fusion.clone import Clone, carry_clone, inform_clone_of_scalar
from isogal.fusion.nominal import Nominal, move
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
from isogal.inertial.gravity import Compensation, horizontal_gravity, misplaced
from isogal.inertial.rotations import INLINE, rotate


class Assumptions(NamedTuple):
    """What the filter assumes, as the kernels take it."""

    dt: float
    """s, IMU interval."""
    noise: Array
    """(6,) white noise densities of accelerometers and gyroscopes, m/s²/sqrt(Hz),
    rad/s/sqrt(Hz)."""
    height_sigma: float
    """m, 1-sigma of a height that comes with the inertial data, known or measured; 0 = none."""
    height_offset: Array
    """(M,) what such a height contains of each auxiliary state."""
    height_share: Array
    """(M,) what it contains of each beside that, per m of the height."""
    height_gate: float
    """The largest normalised innovation squared of a height that is used."""
    weights: Weights
    alpha: float
    """Of the scaled transform, which the weights follow from."""
    auxiliary: Auxiliary
    compensation: Compensation
    """Horizontal gravity that the strapdown takes off."""
    coning: float
    """Of the strapdown's step: `MEANS` or `ROTATIONS` of `isogal.inertial.strapdown`."""


@kernel(**INLINE)
def add_noise(attitude: Array, noise: Array, dt: float, covariance: Array) -> None:
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
def update_height(
    n: int,
    nominal: Nominal,
    covariance: Array,
    height: float,
    assumptions: Assumptions,
    clone: Clone,
    gain: Array,
    error: Array,
) -> None:
    """Update a state and a clone with a height (m), in place, unless it is beyond the gate; `gain`
    (W,) and `error` (W,) are work space. See `isogal.fusion.measurements.height` for what it
    contains."""
    up, sigma = nominal.position[2], assumptions.height_sigma
    innovation = up - height  # measured minus predicted, positive down
    for i in range(columns(n)):
        gain[i] = covariance[2, i]
    for j in range(n - N):
        contents = assumptions.height_offset[j] + assumptions.height_share[j] * up
        innovation += contents * nominal.auxiliary[j]
        for i in range(columns(n)):
            gain[i] -= contents * covariance[N + j, i]
    variance = gain[2]
    for j in range(n - N):
        contents = assumptions.height_offset[j] + assumptions.height_share[j] * up
        variance -= contents * gain[N + j]
    inverse = 1.0 / (variance + sigma * sigma)
    if innovation * innovation * inverse > assumptions.height_gate:
        return
    for i in range(clone.cross.shape[0]):
        error[i] = clone.cross[i, 2]
        for j in range(n - N):
            contents = assumptions.height_offset[j] + assumptions.height_share[j] * up
            error[i] -= contents * clone.cross[i, N + j]
    inform_clone_of_scalar(n, clone, error, gain, innovation, inverse)
    for i in range(columns(n)):
        error[i] = gain[i] * (innovation * inverse)
    for a in range(n):
        scaled = gain[a] * inverse
        for b in range(columns(n)):
            covariance[a, b] -= scaled * gain[b]
    move(nominal, error)


@kernel(**INLINE)
def write_symmetric(n: int, P: Array, covariance: Array) -> None:
    """Write the symmetric part of P (N, W) into a covariance (N, N)."""
    for i in range(n):
        for j in range(n):
            covariance[i, j] = 0.5 * (P[i, j] + P[j, i])


@kernel(**INLINE)
def write_row(nominal: Nominal, P: Array, track: Array, k: int) -> None:
    """Write row k of a track (S, 13): position, velocity, attitude, covariance of the position."""
    for i in range(3):
        track[k, i], track[k, 3 + i] = nominal.position[i], nominal.velocity[i]
    for i in range(4):
        track[k, 6 + i] = nominal.attitude[i]
    track[k, 10], track[k, 11], track[k, 12] = P[0, 0], P[0, 1], P[1, 1]


@kernel(error_model="numpy")
def advance(
    nominal: Nominal,
    covariance: Array,
    residual_gravity: Array,
    force: Array,
    rate: Array,
    height: Array,
    assumptions: Assumptions,
    track: Array,
    clone: Clone,
) -> int:
    """Run prediction and the height update over S intervals, in place; return the steps done
    before the covariance was no longer positive definite, S where it is.

    `force`, `rate` (S, 3) are the means over each interval in body axes, `height` (S,) m the known
    height after each, NaN where it is not known, `residual_gravity` (2,) as `FilterState` has it.
    `track` (S, 13) receives position, velocity and attitude after each interval, and the
    covariance of the position: north, north-east, east; `clone` is carried along."""
    steps = force.shape[0]
    dt, noise, weights = assumptions.dt, assumptions.noise, assumptions.weights
    compensation, coning = assumptions.compensation, assumptions.coning
    n = covariance.shape[0]
    width = columns(n)
    P = np.zeros((n, width))
    factor = np.empty((n, width))
    even = np.zeros((HALF, width))
    odd = np.zeros((n + 1, width))
    points = np.zeros((n, LANES))
    pushes = np.zeros((9, LANES))
    ends = np.empty((10, LANES))
    mean, gain, total = np.zeros(width), np.zeros(width), np.zeros(9)
    auxiliary, done = assumptions.auxiliary, steps
    keep, fresh = np.zeros(n - N), np.zeros(n - N)
    x, v, q = nominal.position, nominal.velocity, nominal.attitude
    for i in range(n):  # a slice would take seconds to compile
        for j in range(n):
            P[i, j] = covariance[i, j]
    for k in range(steps):
        if not factorise(n, P, factor, gain):
            done = k
            break
        spread_points(n, factor, weights.spread, points)
        f, w, read = force[k], rate[k], readings(force[k], rate[k])
        more = misplaced(compensation, 0.5 * (P[0, 0] + P[1, 1]))
        ageing(auxiliary, residual_gravity, more, v, dt, keep, fresh)
        for j in range(9):
            total[j] = 0.0
        for j in range(n - N):
            add_input(auxiliary, j, nominal.auxiliary[j], read, total)
        gn, ge = horizontal_gravity(compensation, x)
        if n > N:
            spread_input(auxiliary, read, points, pushes)
        propagate_points(
            nominal,
            (f[0] - total[3], f[1] - total[4], f[2] - total[5]),
            (w[0] - total[6], w[1] - total[7], w[2] - total[8]),
            (gn + total[0], ge + total[1], total[2]),
            dt,
            coning,
            points,
            pushes,
            ends,
        )
        tail_points(auxiliary, q, read, dt, factor, odd, total)
        errors_of(ends, points)
        moments(n, points, even, odd, weights, mean, P)
        carry_clone(n, factor, odd, weights, keep, clone, gain)
        age(keep, fresh, nominal.auxiliary, P)
        for i in range(3):
            x[i], v[i] = ends[i, CENTRE], ends[3 + i, CENTRE]
        for i in range(4):
            q[i] = ends[6 + i, CENTRE]
        add_noise(q, noise, dt, P)
        move(nominal, mean)
        if assumptions.height_sigma > 0.0 and not math.isnan(height[k]):
            update_height(n, nominal, P, height[k], assumptions, clone, gain, mean)
        write_row(nominal, P, track, k)
    write_symmetric(n, P, covariance)
    return done
