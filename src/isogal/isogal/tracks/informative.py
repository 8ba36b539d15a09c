"""Whether a fix of a recorded track says anything as a position.

A fix holds the information of the readings alone. What little a batch tells can, as a position
with a covariance, lie anywhere: of a place known to 2 km, readings that narrow it to 1.9 km in one
direction say "6 km, give or take". Whoever takes it for a position is misled by its place, and by
its ellipse learns nothing. So a fix is declined whose 1-sigma exceeds what was known before in any
direction, and one that what was known contradicts (docs/mathematics.md, section 10.1)."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.matching.information import position_information
from isogal.matching.interfaces import Batch, Fix, declined

MOST_SIGMAS = 5.0
"""Of prior and fix together, by which they may be apart."""


def wider_than(fix: Fix, known: Array) -> str | None:
    """Return why a published fix says less than what was known, a covariance (2, 2) of north and
    east in m²; None where it says more in every direction."""
    factor = np.linalg.inv(np.linalg.cholesky(known))
    values, vectors = np.linalg.eigh(factor @ fix.covariance @ factor.T)
    if values[-1] <= 1.0:
        return None
    # the direction, across the fix's ellipse, in which it compares worst
    axis = factor.T @ vectors[:, -1]
    axis /= np.hypot(*axis)
    sigma, before = (math.sqrt(float(axis @ one @ axis)) for one in (fix.covariance, known))
    return f"wider than the prior: 1-sigma of {_km(sigma)} where {_km(before)} were known"


def contradicts(fix: Fix, batch: Batch) -> str | None:
    """Return why a published fix and the prior of its batch, with what the fix widens it by, do
    not belong together; None where they may."""
    known = batch.prior[:2, :2]
    if fix.widening is not None:
        known = known + fix.widening[:2, :2]
    told = position_information(batch, fix.latitude, fix.longitude, fix.covariance)
    apart = fix.covariance @ told.vector[:2]
    sigmas = math.sqrt(float(apart @ np.linalg.solve(fix.covariance + known, apart)))
    if sigmas <= MOST_SIGMAS:
        return None
    return (
        f"contradicts the prior: {_km(float(np.hypot(*apart)))} from where the track was thought"
        f" to be, {sigmas:.1f} sigmas of both together"
    )


def without_fix(fix: Fix, batch: Batch, reason: str) -> Fix:
    """Return the fix declined, with its figures and what it found of the navigator."""
    none = declined(batch, reason, **fix.diagnostics)
    return replace(none, reset=fix.reset, widened=fix.widened, shown=fix.shown)


def _km(metres: float) -> str:
    return f"{metres / 1e3:.3g} km"
