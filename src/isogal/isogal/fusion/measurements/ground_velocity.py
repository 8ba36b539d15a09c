"""A velocity over ground in the navigation frame, of the inertial sensors or of an antenna beside
them (docs/mathematics.md, section 3.14):

    z = v + C (w x l) + noise

with the velocity v (NED, m/s), the attitude C (body to NED), the angular rate w relative to the
Earth (body, rad/s) and the lever arm l (body, m)."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements.model import LinearMeasurement, Rows, stated
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import cross_matrix, matrix
from isogal.scenario import Gnss
from isogal.scenario.aids import VERTICAL

GNSS = "gnss"
"""What the names of its states begin with."""


@dataclass(frozen=True, slots=True, eq=False)
class GroundVelocity(LinearMeasurement):
    """A velocity over ground."""

    velocity: Array
    """(3,) m/s, NED; NaN = not measured, but one of them is."""
    covariance: Array
    """(3, 3) of its white noise, (m/s)²."""
    relative: Array
    """(3,) m/s, body axes: w x l, of the antenna relative to the inertial sensors."""
    source: str = ""
    """Which aid it is of."""

    def rows(self, state: FilterState, model: FilterModel) -> Rows:
        """Return it linearised at a state."""
        axes = np.flatnonzero(np.isfinite(self.velocity))
        around = matrix(state.attitude) @ self.relative
        H = np.zeros((3, model.states))
        H[:, 3:6], H[:, 6:9] = np.eye(3), -cross_matrix(around)
        R = np.asarray(self.covariance)[np.ix_(axes, axes)]
        expected = (state.velocity + around)[axes]
        return Rows(self.velocity[axes], expected, H[axes], R, over_ground=True)


def satellite_velocity(
    gnss: Gnss, velocity: Array, turn_rate: Array, covariance: Array | None = None
) -> GroundVelocity | None:
    """Return a receiver's velocity as a measurement; None where it has no number.

    Parameters
    ----------
    gnss : scenario.Gnss
    velocity : (3,) array
        NED, m/s; NaN = not measured.
    turn_rate : (3,) array
        Of the vehicle relative to the Earth, body axes, rad/s.
    covariance : (3, 3) array, optional
        Of its noise, (m/s)²; None, or zero variances = as the scenario has it.
    """
    if not np.isfinite(velocity).any():
        return None
    sigma = gnss.velocity_sigma or Gnss().velocity_sigma or 0.0
    R = stated(np.diag(np.square([1.0, 1.0, VERTICAL]) * sigma**2), covariance)
    return GroundVelocity(velocity, R, np.cross(turn_rate, gnss.lever_arm), GNSS)
