"""Kilometres east and north of the start, as the maps of the page have them."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.plane import Plane


class Projection(Plane):
    """The plane of a route in kilometres, true to scale at its middle latitude: whatever is drawn
    at one place is stretched alike (by 2 % one degree off that latitude at 37 degrees)."""

    @classmethod
    def of(cls, latitude: Array, longitude: Array) -> "Projection":
        """Return the projection for a route (rad): its origin is the first point."""
        middle = 0.5 * float(latitude.min() + latitude.max())
        plane = cls.at(latitude[0], longitude[0], middle)
        return replace(plane, north=plane.north / 1e3, east=plane.east / 1e3)

    def __call__(self, latitude: ArrayLike, longitude: ArrayLike) -> tuple[Array, Array]:
        """Return km east and north of points (rad); longitudes within half a turn of the
        origin."""
        north, east = np.moveaxis(self.metres(latitude, longitude), -1, 0)
        return east, north

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
