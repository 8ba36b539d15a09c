"""Which models a bank needs: a moving bank (Maybeck & Hentz 1987, JGCD 10:90).

Models that differ by the sigma of the map's error only are neighbours. One that is negligible
beside the best of them is left out until a neighbour needs it again, and begins with what that
knows.
"""

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.matching.pmht.models import Models


def best_of_groups(models: Models, log_weight: Array) -> Array:
    """Return (G,) the largest log weight of each group of models (M,)."""
    best = np.full(int(models.group[-1]) + 1, -np.inf)
    np.maximum.at(best, models.group, log_weight)
    return best


def needed(models: Models, log_weight: Array, negligible: float) -> Booleans:
    """Return (M,) which models are, of log weights (M,), -inf of those that are left out."""
    group = models.group
    near = log_weight > best_of_groups(models, log_weight)[group] - negligible
    alike = group[1:] == group[:-1]
    result = near.copy()
    result[1:] |= near[:-1] & alike
    result[:-1] |= near[1:] & alike
    return result


def nearest(models: Models, there: Booleans, missing: Integers) -> Integers:
    """Return for missing models (K,) the nearest of those that are there, of its group."""
    have = np.flatnonzero(there)
    apart = np.abs(missing[:, None] - have)
    apart = np.where(models.group[missing][:, None] == models.group[have], apart, len(there))
    return have[np.argmin(apart, axis=1)]
