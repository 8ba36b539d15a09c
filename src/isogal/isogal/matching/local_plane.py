"""A plane about the navigator's last position, in metres."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.interfaces import Batch


@dataclass(frozen=True, slots=True)
class LocalPlane:
    """North and east metres from a point, on a plane whose scale is that of the point's latitude.

    Over the 7 km of a batch the plane is off by 0.1 % of a distance at most, which for the offset
    of a candidate is a metre or two.
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
    def of(cls, batch: Batch) -> "LocalPlane":
        """Plane at the navigator's position at the last scan."""
        latitude, longitude = float(batch.latitude[-1]), float(batch.longitude[-1])
        north, east = metres_per_radian(latitude)
        return cls(latitude, longitude, float(north), float(east))

    def metres(self, latitude: Array, longitude: Array) -> Array:
        """Positions (..., 2), m, of points in rad; a track may cross the date line."""
        turn = np.remainder(longitude - self.longitude + np.pi, 2.0 * np.pi) - np.pi
        return np.stack([(latitude - self.latitude) * self.north, turn * self.east], axis=-1)

    def radians(self, position: Array) -> tuple[Array, Array]:
        """Latitude and longitude, rad, of positions (..., 2) in metres."""
        return (
            self.latitude + position[..., 0] / self.north,
            self.longitude + position[..., 1] / self.east,
        )
