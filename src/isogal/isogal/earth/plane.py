"""A plane about a point of the Earth, in metres north and east."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian

_CIRCLE = 2.0 * np.pi


@dataclass(frozen=True, slots=True)
class Plane:
    """Metres north and east from a point, on a plane whose scale is that of one latitude
    (equirectangular), so that a regular grid stays one.

    Distances to the east are off by tan(latitude) times the angle (rad) to that latitude: over
    the 7 km of a batch by 0.1 % at most, 1 % for 40 km at 60 deg.
    """

    latitude: float
    """Origin, rad."""
    longitude: float
    """Origin, rad."""
    north: float
    """Metres per radian of latitude."""
    east: float
    """Metres per radian of longitude."""

    @classmethod
    def at(cls, latitude: float, longitude: float, true_at: float | None = None) -> Self:
        """Return the plane about a point (rad), true to scale there or at another latitude."""
        north, east = metres_per_radian(latitude if true_at is None else true_at)
        return cls(float(latitude), float(longitude), float(north), float(east))

    @classmethod
    def about(cls, latitude: Array, longitude: Array) -> Self:
        """Return the plane about the middle of some points (rad)."""
        return cls.at(*(0.5 * float(axis.min() + axis.max()) for axis in (latitude, longitude)))

    def metres(self, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """Return positions (..., 2), m, of points in rad, whose longitudes may be counted from
        another turn: a track may cross the date line."""
        turn = np.subtract(longitude, self.longitude)
        turn = turn - _CIRCLE * np.round(turn / _CIRCLE)
        north = np.subtract(latitude, self.latitude) * self.north
        return np.stack(np.broadcast_arrays(north, turn * self.east), axis=-1)

    def radians(self, position: Array) -> tuple[Array, Array]:
        """Return latitude and longitude, rad, of positions (..., 2) in metres."""
        return (
            self.latitude + position[..., 0] / self.north,
            self.longitude + position[..., 1] / self.east,
        )
