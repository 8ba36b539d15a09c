"""A position, of the inertial sensors or of an antenna beside them (docs/mathematics.md, section
3.14):

    z = p + C l + e + v

relative to the estimate of the inertial sensors' position p (north, east, down, m), with the
attitude C (body to NED), the lever arm l from the inertial sensors (m, body axes), an error e that
changes slowly, where there are auxiliary states of it, and white noise v. Without a height the
first two rows."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.fusion.measurements.model import Innovation, Rows, update_linear
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.rotations import cross_matrix, matrix

NO_LEVER = (0.0, 0.0, 0.0)
AXES = "north", "east", "down"


@dataclass(frozen=True, slots=True, eq=False)
class PositionFix:
    """A position."""

    latitude: float
    """rad."""
    longitude: float
    """rad."""
    covariance: Array
    """(2, 2) or (3, 3) m² of the white noise, north, east, down."""
    height: float | None = None
    """m; None = not measured, or known better."""
    lever_arm: tuple[float, float, float] = NO_LEVER
    """m, forward, right, down."""
    source: str = ""
    """Which aid it is of, with which the names of the auxiliary states of its slowly changing
    error begin; empty = the map."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        if not (math.isfinite(self.latitude) and math.isfinite(self.longitude)):
            raise ValueError("fix is not finite")
        return update_linear(state, model, self.rows(state, model)).far_away()

    def rows(self, state: FilterState, model: FilterModel) -> Rows:
        """Return it linearised at a state."""
        latitude, longitude, height = state.position
        apart = horizontal_difference(self.latitude, self.longitude, latitude, longitude)
        if self.height is not None:
            apart = np.append(apart, height - self.height)
        size = len(apart)
        H, expected = np.eye(size, model.states), np.zeros(size)
        if self.lever_arm != NO_LEVER:
            arm = matrix(state.attitude) @ self.lever_arm
            H[:, 6:9], expected = -cross_matrix(arm)[:size], expected + arm[:size]
        for k, axis in enumerate(AXES[:size]):
            at = model.places.get(f"{self.source}_{axis}")
            if at is not None:
                H[k, at] = 1.0
                expected[k] += state.auxiliary[at - FILTER_STATES]
        return Rows(np.asarray(apart), expected, H, np.asarray(self.covariance))
