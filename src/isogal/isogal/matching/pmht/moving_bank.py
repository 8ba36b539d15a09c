"""Which models a bank needs: a moving bank (Maybeck & Hentz 1987, JGCD 10:90).

Models that differ by the sigma of the map's error only are neighbours. One that is negligible
beside the best of them is left out where no neighbour needs it. Where one does, it begins anew
after each reading with what that knows: its own places are those that made it negligible
(docs/mathematics.md, section 6.4).
"""

from dataclasses import replace

import numpy as np

from isogal.arrays import Booleans, Integers
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.pmht.hypotheses import LIGHT, NEGLIGIBLE, Hypotheses, joined
from isogal.matching.pmht.models import Models, largest


def with_needed(bank: Hypotheses, errors: int) -> Hypotheses:
    """Return a bank with the models that are needed, and without others; of hypotheses whose
    first states beside the navigator's are so many map errors."""
    models, total = bank.models, bank.of_models
    near = total > largest(total, models.group) - NEGLIGIBLE
    those = bank.part(near[bank.which])
    missing = np.flatnonzero(beside(near, models.group))
    if not missing.size:
        return those
    pairs = zip(_nearest(models, near, missing).tolist(), missing.tolist(), strict=True)
    less = np.where(np.isfinite(total), LIGHT, 0.0)
    anew = [_of_another(those, old, new, errors, float(less[new])) for old, new in pairs]
    return joined([those, *anew])


def beside(near: Booleans, group: Integers) -> Booleans:
    """Return (M,) which models are neighbours of those that are near (M,), and are not."""
    alike = group[1:] == group[:-1]
    result = np.zeros(len(near), dtype=np.bool_)
    result[1:] |= near[:-1] & alike
    result[:-1] |= near[1:] & alike
    return result & ~near


def _nearest(models: Models, there: Booleans, missing: Integers) -> Integers:
    """Return for missing models (K,) the nearest of those that are there, of its group."""
    have = np.flatnonzero(there)
    apart = np.abs(missing[:, None] - have)
    apart = np.where(models.group[missing][:, None] == models.group[have], apart, len(there))
    return have[np.argmin(apart, axis=1)]


def _of_another(bank: Hypotheses, old: int, new: int, count: int, less: float) -> Hypotheses:
    """Return the hypotheses of one model as of another one of its group, less probable by a log:
    the same map error is another number of 1-sigmas."""
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
        log_weight=those.log_weight + prior[new] - prior[old] - less,
        mean=those.mean * unit,
        covariance=covariance,
    )
