"""Rotations: quaternions (w, x, y, z), rotation vectors and matrices.

A quaternion turns vectors of its inner frame into its outer frame.

The compiled functions take and return scalars. They are inlined, and as far as possible without
branches and calls, so that a loop over many quaternions becomes vector instructions."""

import math

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.compiled import kernel

SERIES = 11
COSINE = tuple((-1.0) ** k / math.factorial(2 * k) for k in range(SERIES))
HALF_SINE = tuple(0.5 * (-1.0) ** k / math.factorial(2 * k + 1) for k in range(SERIES))
"""Coefficients of cos a and sin a / (2 a) in powers of a²."""

INLINE = {"forceinline": True, "error_model": "numpy"}
"""Options of compiled functions that are called in loops over many states."""


Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""w, x, y, z."""


@kernel(**INLINE)
def multiply(
    aw: float, ax: float, ay: float, az: float, bw: float, bx: float, by: float, bz: float
) -> Quaternion:
    """Return the quaternion product a b."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@kernel(**INLINE)
def from_rotation_vector(x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion of a rotation vector (rad)."""
    a2 = x * x + y * y + z * z
    if a2 <= 10.0:
        return from_short_rotation_vector(x, y, z)
    a = np.sqrt(a2)
    c, s = np.cos(0.5 * a), np.sin(0.5 * a) / a
    return c, s * x, s * y, s * z


@kernel(**INLINE)
def from_short_rotation_vector(x: float, y: float, z: float) -> Quaternion:
    """Return the quaternion of a rotation vector of at most half a turn (rad): series, to
    1e-16."""
    q = 0.25 * (x * x + y * y + z * z)
    c, s = 0.0, 0.0
    for k in range(SERIES - 1, -1, -1):
        c = c * q + COSINE[k]
        s = s * q + HALF_SINE[k]
    return c, s * x, s * y, s * z


TWICE_ARCSINE = tuple(2.0 * math.comb(2 * k, k) / (4.0**k * (2 * k + 1)) for k in range(8))
"""Coefficients of 2 asin(s) / s in powers of s²."""
SMALL = 0.01
"""Largest squared vector part of a quaternion (0.2 rad) for `to_small_rotation_vector`."""


@kernel(**INLINE)
def to_small_rotation_vector(x: float, y: float, z: float) -> Vector:
    """Return the rotation vector (rad) of a unit quaternion with w > 0 and a vector part within
    `SMALL`: series of asin, to 1e-17."""
    s = x * x + y * y + z * z
    scale = 0.0
    for k in range(len(TWICE_ARCSINE) - 1, -1, -1):
        scale = scale * s + TWICE_ARCSINE[k]
    return scale * x, scale * y, scale * z


@kernel(**INLINE)
def to_rotation_vector(w: float, x: float, y: float, z: float) -> Vector:
    """Return the rotation vector (rad, length <= pi) of a unit quaternion."""
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    s2 = x * x + y * y + z * z
    if s2 <= SMALL:
        return to_small_rotation_vector(x, y, z)
    s = np.sqrt(s2)
    scale = 2.0 * np.arctan2(s, w) / s
    return scale * x, scale * y, scale * z


@kernel(**INLINE)
def rotate(w: float, x: float, y: float, z: float, vx: float, vy: float, vz: float) -> Vector:
    """Return q v q*, the vector seen in the outer frame."""
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def matrix(quaternion: ArrayLike) -> Array:
    """Return the rotation matrix (..., 3, 3) of unit quaternions (..., 4)."""
    components = np.asarray(quaternion, float)
    # of one quaternion numbers of Python, with which this takes a tenth of the time
    one = components.ndim == 1
    w, x, y, z = components.tolist() if one else np.moveaxis(components, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.array(rows) if one else np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def cross_matrix(vector: ArrayLike) -> Array:
    """Return the matrix (..., 3, 3) of the vector product with vectors (..., 3)."""
    components = np.asarray(vector, float)
    if components.ndim == 1:  # numbers of Python, as above
        x, y, z = components.tolist()
        return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    x, y, z = np.moveaxis(components, -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def from_heading(heading: ArrayLike) -> Array:
    """Return level attitude (..., 4) with the given heading (rad, clockwise from north)."""
    half = 0.5 * np.asarray(heading, float)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)


def from_angles(roll: float, pitch: float, heading: float) -> Array:
    """Return the quaternion (4,) body to NED of heading, pitch and roll (rad), turned in this
    order (Groves 2013, eq. 2.38)."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    ch, sh = math.cos(0.5 * heading), math.sin(0.5 * heading)
    pitched = multiply(ch, 0.0, 0.0, sh, cp, 0.0, sp, 0.0)
    return np.array(multiply(*pitched, cr, sr, 0.0, 0.0))


def to_angles(rotation: Array) -> tuple[float, float, float]:
    """Return roll, pitch and heading (rad) of a rotation matrix (3, 3) body to NED (Groves 2013,
    eq. 2.23): the inverse of `from_angles`."""
    pitch = -math.asin(np.clip(rotation[2, 0], -1.0, 1.0))
    roll = math.atan2(rotation[2, 1], rotation[2, 2])
    return roll, pitch, math.atan2(rotation[1, 0], rotation[0, 0])


@kernel
def from_matrix(rotation: Array) -> Array:
    """Return the quaternion (4,) of a rotation matrix (3, 3), from its largest component (Shepperd
    1978)."""
    a, b, c = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    d, e, f = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    g, h, i = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    squares = np.array([a + e + i, a - e - i, e - a - i, i - a - e])
    largest = int(np.argmax(squares))
    s = math.sqrt(1.0 + squares[largest]) * 2.0
    if largest == 0:
        q = (s / 4.0, (h - f) / s, (c - g) / s, (d - b) / s)
    elif largest == 1:
        q = ((h - f) / s, s / 4.0, (b + d) / s, (c + g) / s)
    elif largest == 2:
        q = ((c - g) / s, (b + d) / s, s / 4.0, (f + h) / s)
    else:
        q = ((d - b) / s, (c + g) / s, (f + h) / s, s / 4.0)
    return np.array(q)
