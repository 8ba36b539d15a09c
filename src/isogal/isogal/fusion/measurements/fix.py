"""A fix as measurements, in the one order in which what it says reaches a navigator."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.fix import Fix
from isogal.fusion.measurements.information import InformationUpdate
from isogal.fusion.measurements.model import Innovation, Measurement
from isogal.fusion.measurements.position import PositionFix
from isogal.fusion.measurements.trust import AGREEING, VELOCITY
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import BATCH, Estimate


@dataclass(frozen=True, slots=True)
class LearntMapError:
    """How wrong the gravity map is: so much of horizontal gravity is not taken off."""

    sigma: float
    """1-sigma, m/s²."""
    length: float
    """Correlation length, m."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        if not (0.0 < self.sigma < math.inf and 0.0 < self.length < math.inf):
            raise ValueError("map error is not positive and finite")
        residual = model.gravity.residual
        if residual is not None:
            state.residual_gravity[:] = residual.given(self.sigma, self.length)
        return Innovation.of(np.zeros(2), 0.0, math.inf)


@dataclass(frozen=True, slots=True, eq=False)
class Widening:
    """The navigator was found diverged, or not to be what it says: it becomes less certain, and
    its velocity aid has to agree with it for a while before it is used again."""

    covariance: Array
    """(7, 7) what is added to that of a batch's states (`isogal.inertial.error_state`)."""

    def update(self, state: FilterState, model: FilterModel) -> Innovation:
        """See `isogal.fusion.measurements.Measurement`."""
        state.contradicted[VELOCITY] = AGREEING
        state.covariance[np.ix_(BATCH, BATCH)] += self.covariance
        return Innovation.of(np.zeros(2), 0.0, math.inf)


OF_FIXES = InformationUpdate, LearntMapError, Widening
"""What fixes consist of that say more than a position."""


def measurements_of(fix: Fix, relative_to: Estimate | None = None) -> list[Measurement]:
    """Return what a fix consists of: first what it says of gravity, which counts from its stamp
    on, and what makes the navigator less certain, because the measurements were matched with that
    as prior; then the information if there is any, else the position.

    Parameters
    ----------
    fix : Fix
    relative_to : Estimate, optional
        See `InformationUpdate`.
    """
    found: list[Measurement] = []
    if fix.map_error is not None:
        found.append(LearntMapError(*fix.map_error))
    if fix.widening is not None:
        found.append(Widening(fix.widening))
    if fix.published and fix.information is not None:
        b, A = np.array(fix.information.vector), np.array(fix.information.matrix)
        found.append(InformationUpdate(b, A, relative_to))
    elif fix.published:
        found.append(PositionFix(fix.latitude, fix.longitude, np.array(fix.covariance)))
    return found
