"""Stage 3 of `pmht`, the update: the posterior of the navigator's error from the batch.

docs/mathematics.md, sections 5.3, 6 and 8.2.
"""

import math
from dataclasses import replace

import numpy as np

from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.noise_model import uneven
from isogal.matching.pmht.outliers import residual_outliers
from isogal.matching.pmht.state import State, Verdict, evidence, or_before, rematch


def update_state(state: State) -> State:
    """Return the state with its posterior, and whether the batch agrees with the map."""
    first = rematch(state)
    if first.posterior is None:
        reason = "the search area lies outside the map"
        return state.decided(Verdict(reason, hypotheses=state.prior))
    state = _with_uneven_error(first) if uneven(state.field_map) else first
    gate = state.settings.options.outlier_gate
    # now that the place is known, outliers are those of the residuals, all readings tested
    outlier = residual_outliers(state.likelihood, state.best.mixture, gate)
    if not np.array_equal(outlier, state.outlier):
        state = or_before(rematch(state, outlier=outlier), state)
    return replace(
        state,
        agrees=not state.agreement().rejects(state.settings),
        log_evidence=evidence(state.posterior) + _evidence_of_outliers(state),
    )


def _evidence_of_outliers(state: State) -> float:
    """Return the log density of the new outliers: they may be anything that the map holds."""
    count = int(state.outlier[state.likelihood.first_new :].sum())
    if not count:
        return 0.0
    scale = max(state.first_map.scale, float(np.nanmedian(state.batch.sigma)))
    density = CONSTANTS.outlier_probability / (math.sqrt(2.0 * math.pi) * scale)
    return float(count) * math.log(density)


def _with_uneven_error(state: State) -> State:
    """Return the state with the error that the map has where the readings turn out to be.

    That may move the place, and with it the error, so it is repeated. The error is averaged over
    all places found so far: of places that alternate each is possible.
    """
    where = state.best.mixture
    for _ in range(CONSTANTS.refinements):
        before = state
        state = or_before(rematch(state, place=where), state)
        if before.best.mixture.agrees(state.best.mixture):
            break
        where = Mixture.join([where, state.best.mixture], np.array([0.5, 0.5]))
    return state
