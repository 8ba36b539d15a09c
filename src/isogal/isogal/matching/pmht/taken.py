"""Whether the navigator is the one that the matcher's memory is about."""

import numpy as np

from isogal.arrays import Array
from isogal.matching.pmht.constants import CONSTANTS


def has_taken(error: Array, now: Array) -> bool:
    """Whether a navigator whose covariance was `now` (4, 4) at a batch's end can be the one that
    was to have `error` (4, 4) there once it had taken the fix. It is not while the fix is under
    way, nor where it has made another correction of it, as one does that is in doubt about a gap
    in its inertial data."""
    factor = np.linalg.cholesky(error)
    least, most = CONSTANTS.taken_fix_variance_ratio
    ratio = np.linalg.eigvalsh(np.linalg.solve(factor, np.linalg.solve(factor, now).T))
    return bool(least < ratio[0] and ratio[-1] < most)
