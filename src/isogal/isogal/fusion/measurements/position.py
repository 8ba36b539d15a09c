"""A horizontal position: z = (latitude, longitude) relative to the estimate, m, h = 0."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.fusion.measurements.model import Innovation, Rows, update_linear
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState


@dataclass(frozen=True, slots=True, eq=False)
class PositionFix:
    """A horizontal position."""

    latitude: float
    """rad."""
    longitude: float
    """rad."""
    covariance: Array
    """(2, 2) m², north-east."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        if not (math.isfinite(self.latitude) and math.isfinite(self.longitude)):
            raise ValueError("fix is not finite")
        latitude, longitude, _ = state.position
        apart = horizontal_difference(self.latitude, self.longitude, latitude, longitude)
        H = np.eye(2, model.states)
        rows = Rows(np.asarray(apart), np.zeros(2), H, np.asarray(self.covariance))
        return update_linear(state, model, rows).far_away()
