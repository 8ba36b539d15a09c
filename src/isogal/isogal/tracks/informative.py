"""Whether a fix of a recorded track says anything as a position.

A fix holds the information of the readings alone. What little a batch says can, as a position
with a covariance, lie anywhere: of a place known to 2 km, readings that narrow it to 1.9 km in one
direction say "6 km, give or take". Whoever takes it for a position is misled by its place, and by
its ellipse learns nothing. So a fix is declined whose 1-sigma exceeds what was known before in any
direction, and one that what was known contradicts (docs/mathematics.md, section 10.1)."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.matching.information import relative
from isogal.matching.interfaces import Batch, Fix, declined

MOST_SIGMAS = 5.0
"""Of prior and fix together, by which they may be apart."""


def judged(fix: Fix, batch: Batch, prior: Array) -> tuple[Fix, Fix]:
    """Return a fix as it is published, and as it counts for the track's error: one that is wider
    than the prior (4, 4) still says something of it, one that contradicts it does not."""
    if not fix.published:
        return fix, fix
    if reason := contradiction(fix, batch, batch.prior[:2, :2]):
        fix = declined(batch, reason, **fix.diagnostics)
        return fix, fix
    # of chained batches what is known now may be more or less than at the start
    known = max((prior[:2, :2], batch.prior[:2, :2]), key=np.trace)
    if reason := wider_than(fix, known):
        return declined(batch, reason, **fix.diagnostics), fix
    return fix, fix


def wider_than(fix: Fix, known: Array) -> str | None:
    """Return why a published fix says less than what was known, a covariance (2, 2) of north and
    east in m²; None where it says more in every direction."""
    factor, values, vectors = relative(fix.covariance, known)
    if values[-1] <= 1.0:
        return None
    # the direction, across the fix's ellipse, in which it compares worst
    axis = np.linalg.solve(factor.T, vectors[:, -1])
    axis /= np.hypot(*axis)
    sigma, before = (math.sqrt(float(axis @ one @ axis)) for one in (fix.covariance, known))
    return f"wider than the prior: 1-sigma of {_km(sigma)} where {_km(before)} were known"


def contradiction(fix: Fix, batch: Batch, known: Array) -> str | None:
    """Return why a published fix and what was known (2, 2) do not belong together; None where they
    may."""
    apart = horizontal_difference(fix.latitude, fix.longitude, *batch.end)
    sigmas = math.sqrt(float(apart @ np.linalg.solve(fix.covariance + known, apart)))
    if sigmas <= MOST_SIGMAS:
        return None
    return (
        f"contradicts the prior: {_km(float(np.hypot(*apart)))} from where the track was thought"
        f" to be, {sigmas:.1f} sigmas of both together"
    )


def _km(metres: float) -> str:
    return f"{metres / 1e3:.3g} km"
