"""The clearance meter: a radar or laser that looks straight down from the vehicle to the ground.

Terrain height is the navigator's height less the clearance. The navigator knows its height from
another source (docs/mathematics.md, section 3.4), and the error of that height is an error of the
reading. Heights are above the map's zero: where the navigator's height is ellipsoidal and the
map's above sea level, the geoid between them is an offset that `matcher.bias_sigma` has to allow
for."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.scenario import Altimeter
from isogal.sensors.reduction import Reduction, State


class TerrainReduction(Reduction):
    """Clearance (m) to terrain height (m).

    Parameters
    ----------
    settings : scenario.Altimeter
    """

    def __init__(self, settings: Altimeter) -> None:
        self.settings = settings

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the clearance above terrain of a height; raises InputError where the vehicle is
        not above it."""
        clearance = np.asarray(at.height, dtype=float) - np.asarray(value)
        if (clearance <= 0.0).any():
            i = int(np.argmin(clearance))
            latitude, longitude, height = (
                np.broadcast_to(x, clearance.shape).flat[i] for x in at[:3]
            )
            raise InputError(
                f"route.height: the vehicle is {-float(clearance.flat[i]):.0f} m below the terrain"
                f" at latitude {np.degrees(latitude):.4f}, longitude {np.degrees(longitude):.4f}"
                f" deg, where it flies at {height:.0f} m"
            )
        return clearance

    def report(self, raw: ArrayLike) -> Array:
        """Return a clearance in single precision, as sensor_msgs/Range carries it; NaN out of
        range."""
        single = np.asarray(raw, dtype=np.float32).astype(np.float64)
        outside = (single < self.settings.min_range) | (single > self.settings.max_range)
        return np.where(outside, np.nan, single)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return terrain height: estimated height less clearance."""
        return np.asarray(at.height, dtype=float) - np.asarray(raw)

    def height_slope(self, at: State) -> Array:
        """Return one: an error of height is one of terrain height."""
        return np.ones(np.shape(at.latitude))
