"""Positions as a scenario's aid gives them, and their slowly changing error as states of the
filter (docs/mathematics.md, section 3.14)."""

import numpy as np

from isogal.arrays import Array
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements.model import stated
from isogal.fusion.measurements.position import AXES, PositionFix
from isogal.scenario import PositionAid

LEAST_WHITE = 0.1
"""Share of a stated variance that is taken as white noise at least, however much of it changes
slowly: an aid whose whole error is smaller than the scenario's slow part is still not exact."""


def position_error_states(aid: PositionAid, height: bool) -> tuple[AuxiliaryState, ...]:
    """Return the slowly changing errors of an aid's positions, north and east, and down where its
    height is used: it is not where the height is known."""
    if aid.correlated_sigma == 0.0:
        return ()
    sigmas = aid.correlated_sigma * np.array(aid.unequal)[: 3 if height and aid.height else 2]
    return tuple(
        AuxiliaryState(f"{aid.prefix}_{axis}", "none", k, sigma, time=aid.correlation_time)
        for k, (axis, sigma) in enumerate(zip(AXES, sigmas.tolist(), strict=False))
    )


def white_part(stated: Array, slow: Array) -> Array:
    """Return the covariance (n, n) of white noise in a stated one of the whole error, of which
    variances (n,) are those of an error that changes slowly."""
    rest = np.asarray(stated) - np.diag(slow)
    rest[np.diag_indices(len(rest))] = np.maximum(np.diag(rest), LEAST_WHITE * np.diag(stated))
    return np.asarray(rest)


def position_fix(
    aid: PositionAid, place: Array, height_measured: bool, covariance: Array | None = None
) -> PositionFix:
    """Return an aid's position as a measurement.

    Parameters
    ----------
    aid : scenario.PositionAid
    place : (3,) array
        Latitude, longitude (rad), height (m; NaN = it has none now).
    height_measured : bool
        Whether the navigator's height is measured rather than known; the aid's is used then, if it
        has one.
    covariance : (3, 3) array, optional
        Of its whole error, NED, m², as the aid states it; None = as the scenario has it, and so is
        an axis without a variance.
    """
    unequal = np.square(aid.unequal)
    size = 3 if height_measured and aid.height and np.isfinite(place[2]) else 2
    if covariance is None:
        white = np.diag(unequal * aid.sigma**2)[:size, :size]
    else:
        slow = unequal * aid.correlated_sigma**2
        whole = stated(np.diag(unequal * aid.sigma**2 + slow), covariance)
        white = white_part(whole[:size, :size], slow[:size])
    latitude, longitude, height = place.tolist()
    above = height if size == 3 else None
    return PositionFix(latitude, longitude, white, above, aid.lever_arm, aid.prefix)
