"""A heading: of a compass, of two antennas, or the course of a vehicle that goes straight ahead.

    z = atan2(c_east, c_north) + noise

with c the forward axis of the body in the navigation frame (Groves 2013, eq. 2.23)."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.fusion.measurements.model import Innovation, Rows, update_linear
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import matrix


@dataclass(frozen=True, slots=True)
class HeadingReading:
    """A heading of the body's forward axis."""

    heading: float
    """rad, clockwise from true north."""
    sigma: float
    """1-sigma of its white noise, rad."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        north, east, down = matrix(state.attitude)[:, 0].tolist()
        level = north * north + east * east
        if level < 1e-6:
            raise ValueError("the forward axis is vertical: it has no heading")
        expected = math.atan2(east, north)
        measured = expected + math.remainder(self.heading - expected, 2.0 * math.pi)
        H = np.zeros((1, model.states))
        H[0, 6:9] = -down * north / level, -down * east / level, 1.0
        R = np.array([[self.sigma**2]])
        return update_linear(state, model, Rows(np.array([measured]), np.array([expected]), H, R))
