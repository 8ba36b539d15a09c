"""The velocity that a satellite receiver gives (docs/mathematics.md, section 3.14); its positions
are those of any other aid."""

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements.ground_velocity import GroundVelocity
from isogal.fusion.measurements.model import stated
from isogal.scenario import Gnss
from isogal.scenario.aids import VERTICAL

GNSS = "gnss"
"""What the names of its states begin with."""


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
