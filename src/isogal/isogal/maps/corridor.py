"""What lies within a margin of a route."""

from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.axes import Window

CORRIDOR_MARGIN = 25_000.0
"""m of map kept around a route by default."""
_SHORTEST = 1000.0  # m of the route in one window at least


class Corridor(NamedTuple):
    """The part of the Earth within a margin of a route."""

    latitude: Array
    """(K,) rad."""
    longitude: Array
    """(K,) rad, continuous (no jumps of whole circles)."""
    margin: float
    """m."""

    @property
    def window(self) -> Window:
        """The window around all of it."""
        lat, lon = self.latitude, self.longitude
        return _around(lat, lon).grown(self.margin)

    def windows(self) -> list[Window]:
        """Return small windows, in the order of the route, that cover it together."""
        spacing = max(0.2 * self.margin, _SHORTEST)
        along = along_track(self.latitude, self.longitude)
        at = np.linspace(0.0, along[-1], int(along[-1] / spacing) + 2)
        latitude = np.interp(at, along, self.latitude)
        longitude = np.interp(at, along, self.longitude)
        reach = self.margin + 0.5 * spacing  # what a bend between two of the points needs
        return [
            _around(latitude[k : k + 2], longitude[k : k + 2]).grown(reach)
            for k in range(at.size - 1)
        ]


def corridor_of(latitude: Array, longitude: Array, margin: float = CORRIDOR_MARGIN) -> Corridor:
    """Return the corridor of route points (rad) with a margin (m); routes may cross the date
    line."""
    return Corridor(latitude, np.unwrap(longitude), margin)


def _around(latitude: Array, longitude: Array) -> Window:
    return Window(latitude.min(), latitude.max(), longitude.min(), longitude.max())


def joined(one: Window, other: Window) -> Window:
    """Return the window around two windows, whose longitudes are continuous with each other."""
    return Window(
        min(one.south, other.south),
        max(one.north, other.north),
        min(one.west, other.west),
        max(one.east, other.east),
    )


def along_track(latitude: Array, longitude: Array) -> Array:
    """Return the distance from the first point, m, along points (rad) that lie close together."""
    north, east = metres_per_radian(0.5 * (latitude[1:] + latitude[:-1]))
    steps = np.hypot(north * np.diff(latitude), east * np.diff(np.unwrap(longitude)))
    return np.r_[0.0, np.cumsum(steps)].astype(np.float64)
