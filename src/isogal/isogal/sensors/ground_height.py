"""The height of a vehicle on the ground, by its barometer.

A vehicle that stands or drives on the ground is at the height of the terrain below it, plus that
of the instrument above the wheels. Its barometer's height is therefore a reading of the terrain,
whatever the navigator takes as its own height; what the sea-level pressure, the instrument's place
in the vehicle and the datum of the map are off by is one constant (`matcher.bias_sigma`), what the
weather does while the vehicle is on its way is slow (`gravimeter.correlated_sigma` and
`correlation_time`, or `gravimeter.bias_walk`), and roads that are not where the map's cells have
their ground are errors of the map."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.sensors.reduction import Reduction, State


class GroundHeight(Reduction):
    """Barometric height (m) to terrain height (m): the same."""

    def raw(self, value: ArrayLike, at: State) -> Array:
        """Return the height that a barometer on the ground reads: that of the terrain."""
        return np.asarray(value, dtype=float)

    def reduce(self, raw: ArrayLike, at: State) -> Array:
        """Return the terrain height of a reading: the reading."""
        return np.asarray(raw, dtype=float)
