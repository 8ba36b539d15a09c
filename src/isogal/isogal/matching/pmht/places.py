"""What a search for places asks of hypotheses (docs/mathematics.md, section 9)."""

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.pmht.hypotheses import NEGLIGIBLE, Hypotheses
from isogal.matching.pmht.models import Models

WIDE_M, FEW = 500.0, 24
"""1-sigma of a place, along an axis, above which it is searched for and below which it is found;
and how many hypotheses stand for it at most."""


def pruned(them: Hypotheses, most: int, of_place: Array) -> Hypotheses:
    """Merge places (`Hypotheses.places`) and drop what is negligible, whatever its model; weights
    stay as they are."""
    kept = np.argsort(-them.log_weight)[:most]
    kept = kept[them.log_weight[kept] > them.log_weight[kept[0]] - NEGLIGIBLE]
    return them.part(kept[np.argsort(them.which[kept], kind="stable")]).merged(of_place)


def resolved(them: Hypotheses) -> bool:
    """Whether what is probable is one place."""
    covariance = them.moments()[1]
    return bool(covariance[0, 0] + covariance[1, 1] < 2.0 * WIDE_M**2)


def spread_over(them: Hypotheses, models: Models) -> Hypotheses:
    """Return the same places under other models, of which nothing is known yet."""
    them = pruned(them, FEW, np.eye(2, them.mean.shape[1]))
    count, m, n = len(them), len(models.sigma), BATCH_STATES
    base = Hypotheses.before(models, np.eye(n))
    covariance = np.tile(base.covariance, (count, 1, 1))
    covariance[:, :n, :n] = np.repeat(them.covariance[:, :n, :n], m, axis=0)
    mean = np.zeros((count * m, covariance.shape[1]))
    mean[:, :n] = np.repeat(them.mean[:, :n], m, axis=0)
    weight = (them.log_weight[:, None] + models.log_prior).ravel()
    return Hypotheses(models, np.tile(np.arange(m), count), weight, mean, covariance)
