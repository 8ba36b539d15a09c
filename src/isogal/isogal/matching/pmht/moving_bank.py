"""Which models a bank needs: a moving bank (Maybeck & Hentz 1987, JGCD 10:90).

Models that differ by the sigma of the map's error only are neighbours. One that is negligible
beside the best of them is left out where no neighbour needs it, and begins with what that knows
where one does. A negligible neighbour of a smaller sigma begins anew after each reading: it has
followed too narrow a place, and were never probable again with that one. One of a larger sigma
keeps its places, which are wider (docs/mathematics.md, section 6.4).
"""

from dataclasses import replace

import numpy as np

from isogal.arrays import Booleans, Integers
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.pmht.hypotheses import NEGLIGIBLE, Hypotheses, joined
from isogal.matching.pmht.models import largest


def with_needed(bank: Hypotheses, errors: int) -> Hypotheses:
    """Return a bank with the models that are needed, and without others; of hypotheses whose
    first states beside the navigator's are so many map errors."""
    models, total = bank.models, bank.of_models
    near = total > largest(total, models.group) - NEGLIGIBLE
    larger, smaller = neighbours(near, models.group)
    there = np.isfinite(total)
    those = bank.part((near | larger & there)[bank.which])
    from_below = np.r_[(larger & ~there)[1:], False]
    from_above = np.r_[False, (smaller & ~larger)[:-1]]
    one_up = _of_neighbour(those, (near & from_below)[those.which], 1, errors, there)
    one_down = _of_neighbour(those, (near & from_above)[those.which], -1, errors, there)
    return joined([those, one_up, one_down])


def neighbours(near: Booleans, group: Integers) -> tuple[Booleans, Booleans]:
    """Return (M,) which models are not near (M,), but are the next of a larger sigma to one that
    is, and the same of a smaller sigma."""
    alike = group[1:] == group[:-1]
    larger = np.r_[False, near[:-1] & alike] & ~near
    smaller = np.r_[near[1:] & alike, False] & ~near
    return larger, smaller


def _of_neighbour(
    bank: Hypotheses, which: Booleans, step: int, count: int, there: Booleans
) -> Hypotheses:
    """Return some hypotheses as of the model one further: the same map error is another number of
    1-sigmas. Where that model is there, it is negligible, and begins as such."""
    models, those = bank.models, bank.part(which)
    old, new = those.which, those.which + step
    sigma, prior = models.sigma, models.log_prior
    errors = np.arange(BATCH_STATES, BATCH_STATES + count)
    unit = np.ones_like(those.mean)
    exact = sigma[new] == 0.0
    unit[:, errors] = np.where(exact, 0.0, sigma[old] / np.where(exact, 1.0, sigma[new]))[:, None]
    covariance = those.covariance * unit[:, :, None] * unit[:, None, :]
    from_exact = np.flatnonzero(sigma[old] == 0.0)
    initial = models.initial[new[from_exact], :count]
    covariance[from_exact[:, None], errors, errors] = initial**2
    less = np.where(there[new], NEGLIGIBLE, 0.0)
    return replace(
        those,
        which=new,
        log_weight=those.log_weight + prior[new] - prior[old] - less,
        mean=those.mean * unit,
        covariance=covariance,
    )
