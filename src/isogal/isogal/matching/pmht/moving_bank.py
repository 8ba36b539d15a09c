"""Which models a bank needs: a moving bank (Maybeck & Hentz 1987, JGCD 10:90).

Models that differ by the sigma of the map's error only are neighbours. One that is negligible
beside the best of them is left out until a neighbour needs it again, and begins with what that
knows (docs/mathematics.md, section 6.4).
"""

from dataclasses import replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.pmht.hypotheses import NEGLIGIBLE, Hypotheses, joined
from isogal.matching.pmht.models import Models, largest


def with_needed(bank: Hypotheses, errors: int) -> Hypotheses:
    """Return a bank with the models that are needed, and without others; of hypotheses whose
    first states beside the navigator's are so many map errors."""
    total = bank.of_models
    need, there = needed(bank.models, total), np.isfinite(total)
    those = bank if (need | ~there).all() else bank.part(need[bank.which])
    missing = np.flatnonzero(need & ~there)
    if not missing.size:
        return those
    nearest = _nearest(bank.models, need & there, missing)
    pairs = zip(nearest.tolist(), missing.tolist(), strict=True)
    return joined([those, *(_of_another(those, old, new, errors) for old, new in pairs)])


def needed(models: Models, log_weight: Array) -> Booleans:
    """Return (M,) which models are, of log weights (M,), -inf of those that are left out: those
    that are not negligible, and the neighbours of these."""
    group = models.group
    near = log_weight > largest(log_weight, group) - NEGLIGIBLE
    alike = group[1:] == group[:-1]
    result = near.copy()
    result[1:] |= near[:-1] & alike
    result[:-1] |= near[1:] & alike
    return result


def _nearest(models: Models, there: Booleans, missing: Integers) -> Integers:
    """Return for missing models (K,) the nearest of those that are there, of its group."""
    have = np.flatnonzero(there)
    apart = np.abs(missing[:, None] - have)
    apart = np.where(models.group[missing][:, None] == models.group[have], apart, len(there))
    return have[np.argmin(apart, axis=1)]


def _of_another(bank: Hypotheses, old: int, new: int, count: int) -> Hypotheses:
    """Return the hypotheses of one model as of another one of its group: the same map error is
    another number of 1-sigmas."""
    models, those = bank.models, bank.part(bank.which == old)
    sigma, prior = models.sigma, models.log_prior
    errors = np.arange(BATCH_STATES, BATCH_STATES + count)
    unit = np.ones(those.mean.shape[1])
    unit[errors] = sigma[old] / sigma[new] if sigma[new] > 0.0 else 0.0
    covariance = those.covariance * unit[:, None] * unit
    if sigma[old] == 0.0:
        covariance[:, errors, errors] = models.initial[new, :count] ** 2
    return replace(
        those,
        which=np.full(len(those), new),
        log_weight=those.log_weight + prior[new] - prior[old],
        mean=those.mean * unit,
        covariance=covariance,
    )
