"""Samples of a fast IMU brought to the navigator's rate without losing what they say of motion
within its intervals (docs/mathematics.md, section 3.10).

The strapdown takes, for one of its intervals, means of specific force and angular rate, as if both
were constant there. For a body that vibrates or cones they are not: rotations about changing axes
do not add up, and specific force is felt in axes that turn. From the samples within an interval
follow the rotation vector phi of the whole interval and the velocity increment dv in the axes of
its start,

    q <- q Exp(phi_l),    phi_l = a_l + w a_(l-1) x a_l
    dv <- dv + C(q) (J(phi_l) u_l + w (a_(l-1) x u_l + u_(l-1) x a_l)),

with a_l and u_l the increments of angle and velocity of sample l (Savage 1998; Groves 2013,
sections 5.5.1 to 5.5.4). The terms in w are the coning and sculling corrections within a sample,
from a rate that changes linearly over it and the one before: w = T_l² / (6 T_(l-1) (T_(l-1) +
T_l)), 1/12 for samples of equal duration. Savage's corrections between samples are exact here, as
the quaternion carries them. phi / T and the f that the strapdown's step turns into dv are then the
means it is given. J(phi) = I + [phi x] / 2 + [phi x]² / 6 - ... is the mean of Exp(phi s) over s =
0 to 1; the step ends it after the square."""

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.inertial.rotations import (
    INLINE,
    Vector,
    from_rotation_vector,
    multiply,
    to_rotation_vector,
)

J1, J2 = 0.5, 1.0 / 6.0
"""Coefficients of J as the strapdown's step has it."""


@kernel(**INLINE)
def _cross(ax: float, ay: float, az: float, bx: float, by: float, bz: float) -> Vector:
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@kernel(**INLINE)
def _turned(a: Array, u: Array, first: float, second: float) -> Vector:
    """Return u + first a x u + second a x (a x u)."""
    bx, by, bz = _cross(a[0], a[1], a[2], u[0], u[1], u[2])
    cx, cy, cz = _cross(a[0], a[1], a[2], bx, by, bz)
    return (
        u[0] + first * bx + second * cx,
        u[1] + first * by + second * cy,
        u[2] + first * bz + second * cz,
    )


@kernel(**INLINE)
def constant_force(phi: Array, dv: Array) -> Array:
    """Return the velocity increment of a constant force that J(phi) turns into dv: the inverse of
    J, by [phi x]³ = -|phi|² [phi x]."""
    square = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    d = 1.0 - square * J2
    second = (J1 * J1 - J2 * d) / (d * d + J1 * J1 * square)
    first = -J1 * (1.0 - square * second) / d
    return _turned(phi, dv, first, second)


@kernel(error_model="numpy")
def _preintegrate(
    force: Array, rate: Array, duration: Array, ends: Integers, mean_force: Array, mean_rate: Array
) -> None:
    """Write the means of each run and interval; see `preintegrate`."""
    for r in range(force.shape[0]):
        for s in range(ends.shape[0] - 1):
            qw, qx, qy, qz = 1.0, 0.0, 0.0, 0.0
            vx, vy, vz = 0.0, 0.0, 0.0
            whole = 0.0
            for k in range(ends[s], ends[s + 1]):
                t = duration[k]
                a = (rate[r, k, 0] * t, rate[r, k, 1] * t, rate[r, k, 2] * t)
                u = (force[r, k, 0] * t, force[r, k, 1] * t, force[r, k, 2] * t)
                phi, sculling = a, (0.0, 0.0, 0.0)
                if k > 0:
                    last = duration[k - 1]
                    w = t * t / (6.0 * (last + t))  # with rates, not increments, of the one before
                    b, g = rate[r, k - 1], force[r, k - 1]
                    cx, cy, cz = _cross(b[0], b[1], b[2], a[0], a[1], a[2])
                    phi = (a[0] + w * cx, a[1] + w * cy, a[2] + w * cz)
                    cx, cy, cz = _cross(b[0], b[1], b[2], u[0], u[1], u[2])
                    dx, dy, dz = _cross(g[0], g[1], g[2], a[0], a[1], a[2])
                    sculling = (w * (cx + dx), w * (cy + dy), w * (cz + dz))
                x = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
                first, second = J1 - x / 24.0 + x * x / 720.0, J2 - x / 120.0 + x * x / 5040.0
                ux, uy, uz = _turned(phi, u, first, second)
                ux, uy, uz = ux + sculling[0], uy + sculling[1], uz + sculling[2]
                # C(q) u
                tx, ty, tz = _cross(qx, qy, qz, ux, uy, uz)
                ex, ey, ez = _cross(qx, qy, qz, tx, ty, tz)
                vx += ux + 2.0 * (qw * tx + ex)
                vy += uy + 2.0 * (qw * ty + ey)
                vz += uz + 2.0 * (qw * tz + ez)
                pw, px, py, pz = from_rotation_vector(phi[0], phi[1], phi[2])
                qw, qx, qy, qz = multiply(qw, qx, qy, qz, pw, px, py, pz)
                whole += t
            phi = to_rotation_vector(qw, qx, qy, qz)
            u = constant_force(phi, (vx, vy, vz))
            for i in range(3):
                mean_rate[r, s, i] = phi[i] / whole
                mean_force[r, s, i] = u[i] / whole


def preintegrate(
    specific_force: Array, angular_rate: Array, duration: Array, ends: Integers
) -> tuple[Array, Array]:
    """Return means of specific force and angular rate over intervals of several samples, for the
    strapdown (see the module).

    Parameters
    ----------
    specific_force, angular_rate : (R, K, 3) arrays
        Means over each sample, body axes, m/s² and rad/s.
    duration : (K,) array
        Of each sample, s.
    ends : (S + 1,) array of int
        Interval s holds the samples ends[s] to ends[s + 1] - 1. A sample before the first
        interval serves the corrections of the first sample in it.

    Returns
    -------
    (R, S, 3) arrays
        Specific force and angular rate. A rotation by more than half a turn within an interval
        comes out as the shorter one the other way.
    """
    runs, intervals = specific_force.shape[0], len(ends) - 1
    force, rate = np.empty((runs, intervals, 3)), np.empty((runs, intervals, 3))
    _preintegrate(
        np.ascontiguousarray(specific_force, dtype=float),
        np.ascontiguousarray(angular_rate, dtype=float),
        np.ascontiguousarray(duration, dtype=float),
        np.ascontiguousarray(ends, dtype=np.int64),
        force,
        rate,
    )
    return force, rate
