"""Dead reckoning over a fraction of a navigator's interval."""

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian


def dead_reckoned(position: Array, velocity: Array, seconds: float) -> Array:
    """Return the position (3,) some seconds later: latitude rad, longitude rad, height m, moved
    horizontally with a velocity (3,) NED, m/s; the height stays."""
    latitude, longitude, height = position
    north, east = metres_per_radian(latitude, height)
    moved = latitude + seconds * velocity[0] / north, longitude + seconds * velocity[1] / east
    return np.array([*moved, height])
