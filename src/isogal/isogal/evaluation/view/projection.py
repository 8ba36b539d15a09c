"""Kilometres east and north of the start, as the maps of the page have them."""

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian


@dataclass(frozen=True, slots=True)
class Projection:
    """Equirectangular, true to scale at the middle latitude: a map's grid stays a regular grid,
    and whatever is drawn at one place is stretched alike (by 2 % one degree off that latitude at
    37 degrees)."""

    latitude: float
    """rad, of the origin."""
    longitude: float
    """rad, of the origin."""
    north: float
    """km per radian of latitude."""
    east: float
    """km per radian of longitude."""

    @staticmethod
    def of(latitude: Array, longitude: Array) -> "Projection":
        """Return the projection for a route (rad): its origin is the first point."""
        middle = 0.5 * float(latitude.min() + latitude.max())
        north, east = (float(m) / 1e3 for m in metres_per_radian(middle))
        return Projection(float(latitude[0]), float(longitude[0]), north, east)

    def __call__(self, latitude: ArrayLike, longitude: ArrayLike) -> tuple[Array, Array]:
        """Return km east and north of points (rad); longitudes within half a turn of the
        origin."""
        turn = np.remainder(np.asarray(longitude) - self.longitude + np.pi, 2.0 * np.pi) - np.pi
        return cast(Array, turn * self.east), (np.asarray(latitude) - self.latitude) * self.north

    def axes(self, latitude: Array, longitude: Array) -> tuple[Array, Array]:
        """Return km east and north of the columns and rows of a map, whose longitudes may be
        counted from another turn."""
        turn = longitude - self.longitude
        turn = turn - 2.0 * np.pi * np.round(turn.mean() / (2.0 * np.pi))
        return turn * self.east, (latitude - self.latitude) * self.north

    def stretch(self, latitude: ArrayLike) -> tuple[Array, Array]:
        """Return km on the map per metre east and north, at latitudes (rad)."""
        north, east = metres_per_radian(latitude)
        return self.east / np.asarray(east), self.north / np.asarray(north)
