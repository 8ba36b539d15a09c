"""Satellite fixes and velocities as a scenario's receiver gives them, and the slowly changing
error of its positions as states of the filter (docs/mathematics.md, section 3.14)."""

import numpy as np

from isogal.arrays import Array
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements.ground_velocity import GroundVelocity
from isogal.fusion.measurements.position import AXES, PositionFix
from isogal.scenario import Gnss
from isogal.scenario.aids import VERTICAL

GNSS = "gnss"
"""What the names of the states begin with."""
LEAST_WHITE = 0.1
"""Share of a stated variance that is taken as white noise at least, however much of it changes
slowly: a receiver whose whole error is smaller than the scenario's slow part is still not exact.
"""


def satellite_error_states(gnss: Gnss, height: bool) -> tuple[AuxiliaryState, ...]:
    """Return the slowly changing errors of a receiver's positions, north and east, and down where
    its height is used."""
    if not gnss.used or gnss.correlated_sigma == 0.0:
        return ()
    sigma, time = gnss.correlated_sigma, gnss.correlation_time
    sigmas = (sigma, sigma, VERTICAL * sigma)[: 3 if height else 2]
    return tuple(
        AuxiliaryState(f"{GNSS}_{axis}", "none", k, one, time=time)
        for k, (axis, one) in enumerate(zip(AXES, sigmas, strict=False))
    )


def satellite_fix(
    gnss: Gnss, place: Array, height_used: bool, covariance: Array | None = None
) -> PositionFix:
    """Return a receiver's position as a measurement.

    Parameters
    ----------
    gnss : scenario.Gnss
    place : (3,) array
        Latitude, longitude (rad), height (m).
    height_used : bool
        Whether its height is used: it is not where the height is known.
    covariance : (3, 3) array, optional
        Of its whole error, NED, m², as the receiver states it; None = as the scenario has it.
    """
    white = np.diag(np.square([1.0, 1.0, VERTICAL]) * gnss.position_sigma**2)
    if covariance is not None:
        slow = np.diag(np.square([1.0, 1.0, VERTICAL]) * gnss.correlated_sigma**2)
        rest = np.asarray(covariance) - slow
        least = LEAST_WHITE * np.diag(covariance)
        rest[np.diag_indices(3)] = np.maximum(np.diag(rest), least)
        white = rest
    size = 3 if height_used else 2
    latitude, longitude, height = place.tolist()
    above = height if height_used else None
    return PositionFix(latitude, longitude, white[:size, :size], above, gnss.lever_arm, GNSS)


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
    R = np.diag(np.square([1.0, 1.0, VERTICAL]) * sigma**2)
    if covariance is not None:
        known = np.flatnonzero(np.diag(covariance) > 0.0)
        R[np.ix_(known, known)] = np.asarray(covariance)[np.ix_(known, known)]
    return GroundVelocity(velocity, R, np.cross(turn_rate, gnss.lever_arm), GNSS)
