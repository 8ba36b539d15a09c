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
from isogal.matching.pmht.models import largest


def with_needed(bank: Hypotheses, errors: int) -> Hypotheses:
    """Return a bank with the models that are needed, and without others; of hypotheses whose
    first states beside the navigator's are so many map errors."""
    models, total = bank.models, bank.of_models
    near = total > largest(total, models.group) - NEGLIGIBLE
    larger, smaller = _missing(near, models.group)
    those = bank.part(near[bank.which])
    left_out = ~np.isfinite(total)
    one_up = _of_neighbour(those, np.flatnonzero(larger[those.which]), 1, errors, left_out)
    one_down = _of_neighbour(those, np.flatnonzero(smaller[those.which]), -1, errors, left_out)
    return joined([those, one_up, one_down])


def _missing(near: Booleans, group: Integers) -> tuple[Booleans, Booleans]:
    """Return (M,) of which models that are near (M,) the neighbour of the next larger sigma is
    not, and begins with what they know; the same of the next smaller one, but where a model on
    its other side gives it a beginning."""
    alike = group[1:] == group[:-1]
    larger, smaller = np.zeros_like(near), np.zeros_like(near)
    larger[:-1] = near[:-1] & ~near[1:] & alike
    smaller[1:] = near[1:] & ~near[:-1] & alike
    smaller[2:] &= ~larger[:-2]
    return larger, smaller


def _of_neighbour(
    bank: Hypotheses, index: Integers, step: int, count: int, left_out: Booleans
) -> Hypotheses:
    """Return some hypotheses as of the model one further: the same map error is another number of
    1-sigmas. Less probable by LIGHT where that model has been there, and is negligible."""
    models, those = bank.models, bank.part(index)
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
    less = np.where(left_out[new], 0.0, LIGHT)
    return replace(
        those,
        which=new,
        log_weight=those.log_weight + prior[new] - prior[old] - less,
        mean=those.mean * unit,
        covariance=covariance,
    )
