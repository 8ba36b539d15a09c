"""GRS80 ellipsoid: constants and radii of curvature.

Source: Moritz (2000), Geodetic Reference System 1980, J. Geodesy 74:128-133. boule.GRS80 gives the
same numbers (tested)."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array, real_numbers
from isogal.compiled import kernel
from isogal.errors import InputError

A = 6378137.0
"""Equatorial radius, m."""
F = 1.0 / 298.257222101
"""Flattening."""
E2 = F * (2.0 - F)
"""First eccentricity squared."""
GM = 3.986005e14
"""Geocentric gravitational constant, m³/s²."""
EARTH_RATE = 7.292115e-5
"""Angular velocity, rad/s."""
_FARTHEST = 1.6
"""rad; a filter's latitude may be a little beyond a pole (1.571), no other one can be."""


def in_radians(latitude: ArrayLike) -> Array:
    """Return latitudes (rad) as an array, NaN where they are masked; raises InputError where one
    is no number, or beyond the poles, as degrees mostly are."""
    array = np.asarray(real_numbers(latitude, "latitude"), dtype=float)
    beyond = np.abs(array) > _FARTHEST
    if beyond.any():
        raise InputError(
            "latitude must be in radians, within pi/2 north and south, is"
            f" {array[beyond].flat[0]:g}; is it in degrees?"
        )
    return array


@kernel(forceinline=True, error_model="numpy")
def curvature(sin_latitude: float) -> tuple[float, float]:
    """Return (meridian M, prime vertical N) radius, m, at the sine of a geodetic latitude (Groves
    2013, eqs. 2.105, 2.106)."""
    w2 = 1.0 - E2 * sin_latitude * sin_latitude
    n = A / np.sqrt(w2)
    return n * (1.0 - E2) / w2, n


def radii(latitude: ArrayLike) -> tuple[Array, Array]:
    """Return (M, N), m, at geodetic latitudes (rad), any shape."""
    w2 = 1.0 - E2 * np.sin(latitude) ** 2
    n = A / np.sqrt(w2)
    return n * (1.0 - E2) / w2, n


def metres_per_radian(latitude: ArrayLike, height: ArrayLike = 0.0) -> tuple[Array, Array]:
    """Return metres per radian of (latitude, longitude) at a latitude (rad) and ellipsoidal height
    (m)."""
    m, n = radii(latitude)
    return m + np.asarray(height), (n + np.asarray(height)) * np.cos(latitude)
