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
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.measurements.model import (
    Innovation,
    LinearMeasurement,
    Rows,
    stated,
    update_linear,
    white_part,
)
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import FILTER_STATES
from isogal.inertial.rotations import cross_matrix, matrix
from isogal.scenario import PositionAid

NO_LEVER = (0.0, 0.0, 0.0)
AXES = "north", "east", "down"


@dataclass(frozen=True, slots=True, eq=False)
class PositionFix(LinearMeasurement):
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


def position_error_states(aid: PositionAid, height: bool) -> tuple[AuxiliaryState, ...]:
    """Return the slowly changing errors of an aid's positions, north and east, and down where its
    height is used: it is not where the height is known."""
    sigmas = aid.correlated_sigma * np.array(aid.unequal)[: 3 if height and aid.height else 2]
    return tuple(
        AuxiliaryState(f"{aid.prefix}_{axis}", "none", k, sigma, time=aid.correlation_time)
        for k, (axis, sigma) in enumerate(zip(AXES, sigmas.tolist(), strict=False))
    )


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
