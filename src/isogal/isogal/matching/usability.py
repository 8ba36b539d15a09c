"""Whether a batch can be used, which every matcher asks first."""

import numpy as np

from isogal.matching.interfaces import Batch
from isogal.matrices import lower

_FINITE = (
    "latitude",
    "longitude",
    "velocity",
    "by_error",
    "covariance",
)


def unusable(batch: Batch) -> str | None:
    """Why no matcher can use a batch, in one line; None where it can."""
    if len(batch) < 2:
        return f"a batch needs at least 2 scans, has {len(batch)}"
    steps = np.diff(batch.time)
    if not (
        (steps > 0.0) if batch.rows_per_scan == 1 else (steps >= 0.0)
    ).all():  # rows of several channels or beams share a stamp
        return "the stamps of the scans do not increase"
    for name in _FINITE:
        if not np.isfinite(getattr(batch, name)).all():
            return f"{name} of the navigator is not finite"
    sigma = batch.sigma[np.isfinite(batch.reading)]
    if not (np.isfinite(sigma) & (sigma > 0.0)).all():
        return "sigma of a reading is not positive"
    if np.isnan(lower(np.ascontiguousarray(batch.covariance))[-1, -1]):
        return "the navigator's covariance is not positive definite"
    return None


def too_few(batch: Batch, usable: int, minimum: int) -> str | None:
    """Why too few scans can be used, in one line; None where they are enough."""
    if usable >= minimum:
        return None
    read = int(np.isfinite(batch.reading).sum())
    if read < minimum:
        return f"only {read} of {len(batch)} scans have a reading ({minimum} needed)"
    return f"only {usable} of {read} readings have the map around them ({minimum} needed)"
