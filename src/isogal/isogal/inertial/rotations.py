"""Quaternions (w, x, y, z) as scalar numba kernels: a quaternion turns vectors of its inner frame into its outer frame."""

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


@njit(cache=True, nogil=True)
def multiply(aw, ax, ay, az, bw, bx, by, bz):  # type: ignore[no-untyped-def]
    """Return the quaternion product a b."""
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@njit(cache=True, nogil=True)
def from_rotation_vector(x, y, z):  # type: ignore[no-untyped-def]
    """Return the quaternion of a rotation vector (rad): series below 0.02 rad (error under 1e-17), closed form above."""
    a2 = x * x + y * y + z * z
    if a2 < 4e-4:
        c = 1.0 - a2 * (1.0 / 8.0 - a2 * (1.0 / 384.0 - a2 / 46080.0))
        s = 0.5 - a2 * (1.0 / 48.0 - a2 * (1.0 / 3840.0 - a2 / 645120.0))
    else:
        a = np.sqrt(a2)
        c, s = np.cos(0.5 * a), np.sin(0.5 * a) / a
    return c, s * x, s * y, s * z


@njit(cache=True, nogil=True)
def to_rotation_vector(w, x, y, z):  # type: ignore[no-untyped-def]
    """Return the rotation vector (rad, length <= pi) of a unit quaternion."""
    if w < 0.0:
        w, x, y, z = -w, -x, -y, -z
    s2 = x * x + y * y + z * z
    if s2 < 1e-6:
        scale = 2.0 * (1.0 + s2 / 6.0 + 3.0 * s2 * s2 / 40.0)  # asin series: w is redundant for a unit quaternion
    else:
        s = np.sqrt(s2)
        scale = 2.0 * np.arctan2(s, w) / s
    return scale * x, scale * y, scale * z


@njit(cache=True, nogil=True)
def rotate(w, x, y, z, vx, vy, vz):  # type: ignore[no-untyped-def]
    """Return q v q*, the vector seen in the outer frame."""
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz, vz + w * tz + x * ty - y * tx


def matrix(quaternion: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation matrix (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(np.asarray(quaternion, float), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def from_heading(heading: ArrayLike) -> NDArray[np.float64]:
    """Return level attitude (..., 4) with the given heading (rad, clockwise from north)."""
    half = 0.5 * np.asarray(heading, float)
    zero = np.zeros_like(half)
    return np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1)
