"""Strapdown navigation in the local navigation frame, one IMU interval at a time.

Inputs are the mean specific force and mean angular rate over the interval, resolved in body axes
(what integrating sensors give, divided by dt), or what pre-integration makes of faster samples.
The step is second order: rotation vector of the body against the navigation frame for the
attitude, velocity with its rotation correction, gravity and Coriolis at the interval's mid-point,
trapezoid for the position (docs/mathematics.md, section 3.1; Titterton & Weston 2004, ch. 11;
Groves 2013, ch. 5.4)."""

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import E2, EARTH_RATE, A, F
from isogal.earth.gravity import GAMMA_EQUATOR, GRAVITY_RATIO, SOMIGLIANA_K
from isogal.inertial.error_state import Estimate
from isogal.inertial.gravity import Compensation, horizontal_gravity, no_compensation
from isogal.inertial.rotations import (
    INLINE,
    Quaternion,
    Vector,
    from_short_rotation_vector,
    multiply,
    rotate,
)

MEANS, ROTATIONS = 1.0 / 6.0, 1.0 / 12.0
"""Coefficient `coning` of a x (a x z) in the attitude's step, for a turn by a and a rotation of
the navigation frame by z in it. A mean angular rate holds the mean of z, which turns with the
body: z - a x z / 2 + a x (a x z) / 6. The rotation vector of the whole interval, as of
`preintegration`, holds it as rotations compose, by the series of Baker, Campbell and Hausdorff to
first order in z: z - a x z / 2 + a x (a x z) / 12."""


@kernel(**INLINE)
def _earth(s: float, c: float, height: float, vn: float, ve: float) -> tuple[float, ...]:
    """Return 1/(M+h), 1/(N+h), normal gravity, Earth rate (n, d) and transport rate (n, e, d) at a
    latitude's sine and cosine."""
    w2 = 1.0 - E2 * s * s
    w = np.sqrt(w2)
    n = A / w
    inv_m = 1.0 / (n * (1.0 - E2) / w2 + height)
    inv_n = 1.0 / (n + height)
    s2 = s * s
    gravity = (GAMMA_EQUATOR * (1.0 + SOMIGLIANA_K * s2) / w) * (
        1.0
        - 2.0 / A * (1.0 + F + GRAVITY_RATIO - 2.0 * F * s2) * height
        + 3.0 / (A * A) * height * height
    )
    return (
        inv_m,
        inv_n,
        gravity,
        EARTH_RATE * c,
        -EARTH_RATE * s,
        ve * inv_n,
        -vn * inv_m,
        -ve * inv_n * s / c,
    )


@kernel(**INLINE)
def _turned(attitude: Quaternion, body: Vector, frame: Vector, coning: float) -> Quaternion:
    """Turn an attitude by the rotations of the body and of the navigation frame over an interval,
    rad, both in the latter's axes at its start.

    The body turns at a constant rate against the navigation frame, so that frame's rotation z, as
    the gyroscopes feel it, turns within the interval (`MEANS`, `ROTATIONS`). Else the coning of a
    minute's turn costs metres."""
    (an, ae, ad), (zn, ze, zd) = body, frame
    qw, qx, qy, qz = attitude
    pn, pe, pd = ae * zd - ad * ze, ad * zn - an * zd, an * ze - ae * zn
    bw, bx, by, bz = from_short_rotation_vector(
        an - zn + 0.5 * pn - (ae * pd - ad * pe) * coning,
        ae - ze + 0.5 * pe - (ad * pn - an * pd) * coning,
        ad - zd + 0.5 * pd - (an * pe - ae * pn) * coning,
    )
    qw, qx, qy, qz = multiply(bw, bx, by, bz, qw, qx, qy, qz)
    # one Newton step keeps the norm at 1
    scale = 1.5 - 0.5 * (qw * qw + qx * qx + qy * qy + qz * qz)
    return (qw * scale, qx * scale, qy * scale, qz * scale)


@kernel(**INLINE)
def step(
    s: float,
    c: float,
    position: Vector,
    velocity: Vector,
    attitude: Quaternion,
    force: Vector,
    rate: Vector,
    gravity: Vector,
    dt: float,
    coning: float,
) -> tuple[Vector, Vector, Quaternion]:
    """Advance one state by one interval (see the module for the method).

    In: sine and cosine of the latitude (no calls, so loops over it are vectorised), position
    (latitude rad, longitude rad, height m), velocity (north, east, down; m/s), attitude (w, x, y,
    z), the interval's mean specific force (m/s²) and angular rate (rad/s) in body axes, and
    gravity beside normal gravity (north, east, down; m/s²). `coning` is `MEANS` or, for
    pre-integrated samples, `ROTATIONS`. Out: position, velocity, attitude."""
    lat, lon, h = position
    vn, ve, vd = velocity
    qw, qx, qy, qz = attitude
    (fx, fy, fz), (wx, wy, wz) = force, rate
    gn, ge, gd = gravity
    # increments in the navigation axes of the interval's start
    un, ue, ud = rotate(qw, qx, qy, qz, fx * dt, fy * dt, fz * dt)
    an, ae, ad = rotate(qw, qx, qy, qz, wx * dt, wy * dt, wz * dt)
    bn, be, bd = ae * ud - ad * ue, ad * un - an * ud, an * ue - ae * un

    # predictor: velocity and latitude at the mid-point from the rates at the start
    inv_m, inv_n, g, en, ed, tn, te, td = _earth(s, c, h, vn, ve)
    on, oe, od = 2.0 * en + tn, te, 2.0 * ed + td
    half = 0.5 * dt
    vn_m = vn + 0.5 * un - half * (oe * vd - od * ve - gn)
    ve_m = ve + 0.5 * ue - half * (od * vn - on * vd - ge)
    vd_m = vd + 0.5 * ud - half * (on * ve - oe * vn) + half * (g + gd)
    d_lat = half * 0.5 * (vn + vn_m) * inv_m
    s_m = s + d_lat * (c - 0.5 * d_lat * s)
    c_m = c - d_lat * (s + 0.5 * d_lat * c)
    h_m = h - half * 0.5 * (vd + vd_m)

    # corrector: rates at the mid-point
    inv_m, inv_n, g, en, ed, tn, te, td = _earth(s_m, c_m, h_m, vn_m, ve_m)
    on, oe, od = 2.0 * en + tn, te, 2.0 * ed + td
    # rotation of the navigation frame over the interval
    zn, ze, zd = (en + tn) * dt, te * dt, (ed + td) * dt
    # Integral of Exp(-t z) f(t), f turning with the body by a: both rotations to second order,
    # cross term included. Leaving out the second order costs 4 m in 7.5 h at 1 Hz.
    cn, ce, cd = ze * ud - zd * ue, zd * un - zn * ud, zn * ue - ze * un
    un += (
        0.5 * (bn - cn)
        + (ae * bd - ad * be + ze * cd - zd * ce) * (1.0 / 6.0)
        - (ze * bd - zd * be) * (1.0 / 3.0)
    )
    ue += (
        0.5 * (be - ce)
        + (ad * bn - an * bd + zd * cn - zn * cd) * (1.0 / 6.0)
        - (zd * bn - zn * bd) * (1.0 / 3.0)
    )
    ud += (
        0.5 * (bd - cd)
        + (an * be - ae * bn + zn * ce - ze * cn) * (1.0 / 6.0)
        - (zn * be - ze * bn) * (1.0 / 3.0)
    )
    vn1 = vn + un - dt * (oe * vd_m - od * ve_m - gn)
    ve1 = ve + ue - dt * (od * vn_m - on * vd_m - ge)
    vd1 = vd + ud - dt * (on * ve_m - oe * vn_m) + dt * (g + gd)

    lat1 = lat + half * (vn + vn1) * inv_m
    lon1 = lon + half * (ve + ve1) * inv_n / c_m
    h1 = h - half * (vd + vd1)

    attitude = _turned(attitude, (an, ae, ad), (zn, ze, zd), coning)
    return (lat1, lon1, h1), (vn1, ve1, vd1), attitude


@kernel(error_model="numpy")
def _propagate(
    state: tuple[Array, Array, Array],
    force: Array,
    rate: Array,
    dt: float,
    height: Array,
    compensation: Compensation,
    coning: float,
    history: Array,
) -> None:
    """Advance R runs in place; `state` is their positions, velocities and attitudes, `height` (S +
    1,) or (0,), `history` (R, S, 10) or (R, 0, 10)."""
    positions, velocities, attitudes = state
    runs, steps = force.shape[0], force.shape[1]
    for r in range(runs):
        p, v, q = positions[r], velocities[r], attitudes[r]
        position = (p[0], p[1], p[2])
        velocity = (v[0], v[1], v[2])
        attitude = (q[0], q[1], q[2], q[3])
        for k in range(steps):
            f, w = force[r, k], rate[r, k]
            north, east = horizontal_gravity(compensation, position)
            position, velocity, attitude = step(
                np.sin(position[0]),
                np.cos(position[0]),
                position,
                velocity,
                attitude,
                (f[0], f[1], f[2]),
                (w[0], w[1], w[2]),
                (north, east, 0.0),
                dt,
                coning,
            )
            if height.shape[0] > 0:  # known height: the vertical channel follows it
                velocity = (velocity[0], velocity[1], (height[k] - height[k + 1]) / dt)
                position = (position[0], position[1], height[k + 1])
            if history.shape[1] > 0:
                history[r, k, 0], history[r, k, 1], history[r, k, 2] = position
                history[r, k, 3], history[r, k, 4], history[r, k, 5] = velocity
                history[r, k, 6], history[r, k, 7] = attitude[0], attitude[1]
                history[r, k, 8], history[r, k, 9] = attitude[2], attitude[3]
        p[0], p[1], p[2] = position
        v[0], v[1], v[2] = velocity
        q[0], q[1], q[2], q[3] = attitude


def propagate(
    state: Estimate,
    specific_force: Array,
    angular_rate: Array,
    dt: float,
    known_height: Array | None = None,
    compensation: Compensation | None = None,
    history: bool = False,
    preintegrated: bool = False,
) -> tuple[Estimate, Array]:
    """Run the strapdown over S intervals for R runs.

    Parameters
    ----------
    state : Estimate
        Start of all runs, (R, 3), (R, 3), (R, 4); not changed.
    specific_force, angular_rate : (R, S, 3) arrays
        Means over each interval, body axes, m/s² and rad/s.
    dt : float
        Interval, s.
    known_height : (S + 1,) array, optional
        Height (m) at the start and after each interval, which the vertical channel then follows:
        by itself it is unstable (docs/mathematics.md, section 3.4).
    compensation : Compensation, optional
        Horizontal gravity that is taken off; default: none.
    history : bool
        Whether to return the state after each interval: latitude, longitude (rad), height (m),
        velocity NED (m/s) and attitude.
    preintegrated : bool
        Whether force and rate are those of `isogal.inertial.preintegration` rather than means.

    Returns
    -------
    Estimate, (R, S, 10) array (S = 0 without history)
    """
    end = Estimate(*(part.copy() for part in state))
    runs, steps = specific_force.shape[:2]
    track = np.empty((runs, steps if history else 0, 10))
    height = (
        np.empty(0) if known_height is None else np.ascontiguousarray(known_height, dtype=float)
    )
    compensation = compensation or no_compensation()
    coning = ROTATIONS if preintegrated else MEANS
    _propagate(tuple(end), specific_force, angular_rate, dt, height, compensation, coning, track)
    return end, track
