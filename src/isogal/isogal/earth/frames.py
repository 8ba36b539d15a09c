"""Geodetic, Earth-centred Earth-fixed (ECEF) and local east-north-up (ENU) coordinates, exact on
GRS80."""

import math

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.ellipsoid import E2, A, F, in_radians, metres_per_radian


def geodetic_to_ecef(latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> Array:
    """Return ECEF (..., 3) m from latitude, longitude (rad) and height (m) (Groves 2013, eq.
    2.112)."""
    if isinstance(latitude, float) and isinstance(longitude, float) and isinstance(height, float):
        return np.array(_point_to_ecef(latitude, longitude, height))
    lat, lon, h = np.broadcast_arrays(
        np.asarray(latitude, float), np.asarray(longitude, float), np.asarray(height, float)
    )
    n = A / np.sqrt(1.0 - E2 * np.sin(lat) ** 2)
    p = (n + h) * np.cos(lat)
    return np.stack(
        [p * np.cos(lon), p * np.sin(lon), (n * (1.0 - E2) + h) * np.sin(lat)], axis=-1
    )


def _point_to_ecef(latitude: float, longitude: float, height: float) -> list[float]:
    """Do the same for one point, with numbers of Python: in a fiftieth of the time."""
    sl, cl = math.sin(latitude), math.cos(latitude)
    n = A / math.sqrt(1.0 - E2 * (sl * sl))
    p = (n + height) * cl
    z = (n * (1.0 - E2) + height) * sl
    return [p * math.cos(longitude), p * math.sin(longitude), z]


def ecef_to_geodetic(ecef: ArrayLike) -> tuple[Array, Array, Array]:
    """Return (latitude rad, longitude rad, height m) from ECEF (..., 3) m.

    Bowring (1976) with iterations of the reduced latitude: exact to rounding from the ellipsoid's
    core to space."""
    x, y, z = np.moveaxis(np.asarray(ecef, float), -1, 0)
    p = np.hypot(x, y)
    beta = np.arctan2(z, (1.0 - F) * p)
    ep2 = E2 / (1.0 - E2)
    lat = beta
    for _ in range(4):
        lat = np.arctan2(
            z + ep2 * A * (1.0 - F) * np.sin(beta) ** 3, p - E2 * A * np.cos(beta) ** 3
        )
        beta = np.arctan2((1.0 - F) * np.sin(lat), np.cos(lat))
    s, c = np.sin(lat), np.cos(lat)
    h = p * c + z * s - A * np.sqrt(1.0 - E2 * s * s)
    return lat, np.arctan2(y, x), h


def enu_axes(latitude: float, longitude: float) -> Array:
    """Return the rotation (3, 3) that turns ECEF vectors into east-north-up at a point (rad)."""
    sl, cl = math.sin(latitude), math.cos(latitude)
    so, co = math.sin(longitude), math.cos(longitude)
    return np.array([[-so, co, 0.0], [-sl * co, -sl * so, cl], [cl * co, cl * so, sl]])


class LocalFrame:
    """East-north-up frame at one origin (rad, m), exact through ECEF (no flat Earth). Raises
    InputError as `in_radians` does."""

    def __init__(self, latitude: float, longitude: float, height: float = 0.0) -> None:
        in_radians(latitude)
        self.axes = enu_axes(latitude, longitude)
        self.origin = geodetic_to_ecef(latitude, longitude, height)

    def from_geodetic(self, latitude: ArrayLike, longitude: ArrayLike, height: ArrayLike) -> Array:
        """Return ENU (..., 3) m of points given in rad and m."""
        return (geodetic_to_ecef(latitude, longitude, height) - self.origin) @ self.axes.T

    def to_geodetic(self, enu: ArrayLike) -> tuple[Array, Array, Array]:
        """Return (latitude rad, longitude rad, height m) of ENU points (..., 3) m."""
        return ecef_to_geodetic(np.asarray(enu, float) @ self.axes + self.origin)

    def rotation_from(self, latitude: float, longitude: float) -> Array:
        """Return the rotation (3, 3) from the ENU axes at another point to the axes of this
        frame."""
        return self.axes @ enu_axes(latitude, longitude).T


def horizontal_difference(
    latitude: ArrayLike, longitude: ArrayLike, latitude_0: ArrayLike, longitude_0: ArrayLike
) -> Array:
    """Return (..., 2) m, north and east, from point 0 to the point: small differences with the
    radii at point 0."""
    north, east = metres_per_radian(latitude_0)
    turn = np.subtract(longitude, longitude_0)
    to_north = np.subtract(latitude, latitude_0) * north
    to_east = (np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi) * east
    difference = np.empty((*np.broadcast(to_north, to_east).shape, 2))
    difference[..., 0], difference[..., 1] = to_north, to_east
    return difference


def displaced(latitude: ArrayLike, longitude: ArrayLike, metres: Array) -> tuple[Array, Array]:
    """Return latitude and longitude (rad) of points moved by small distances (..., 2), m north and
    east, with the radii at the points: the inverse of `horizontal_difference`."""
    north, east = metres_per_radian(latitude)
    return np.add(latitude, metres[..., 0] / north), np.add(longitude, metres[..., 1] / east)
