"""Stage 5 of `pmht`: whether a batch gives a fix, and if not, why.

docs/mathematics.md, sections 6.5, 8.3 and 8.5.
"""

import math

import numpy as np

from isogal.maps.channels import channels_of
from isogal.matching.interfaces import LOST_COVARIANCE, LOST_SIGMA
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.elsewhere import look_elsewhere
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.last_hour import LastHour
from isogal.matching.pmht.learn import learn_from
from isogal.matching.pmht.map_error import MapErrorEstimate
from isogal.matching.pmht.prepare import unknown_bias
from isogal.matching.pmht.state import State, Verdict, evidence, rematch


def assess(state: State) -> State:
    """Return the state with its verdict."""
    if not state.agrees:
        return _assess_disagreement(state)
    if not state.best.resolved:
        reason = "the posterior could not be resolved"
        return state.decided(Verdict(reason, hypotheses=state.prior))
    best = state.best.mixture
    if best.weight[0] < state.settings.options.confidence:
        reason = (
            f"ambiguous: {len(best)} places fit, the best with probability {best.weight[0]:.3f}"
        )
        return state.decided(Verdict(reason, hypotheses=best))
    return state.decided(Verdict(residual=state.consistency()))


def _assess_disagreement(state: State) -> State:
    """Return the verdict on a batch that does not agree with the map where the prior allows.

    Three explanations are compared by their evidence. The readings have an untold bias: then it
    is estimated from now on. Or the navigator is elsewhere: its own covariance is wrong, and is
    widened, so that the next batches search as from any uncertain start and its errors keep the
    correlations that the filter gives them; where it may be either, a bias is allowed for in the
    search. Or neither: then the noise is larger than assumed, which is learnt and goes into the
    fix's covariance, or the map is wrong altogether.
    """
    options, batch = state.settings.options, state.batch
    misfit = state.agreement().ratio
    reason = f"readings and map do not agree (misfit {misfit:.1f} per degree of freedom)"
    declined = state.decided(Verdict(reason, hypotheses=state.prior, unexplained=True))
    before = state.memory.disagreements if state.memory else 0
    if before < CONSTANTS.disagreements_tolerated and misfit > options.largest_misfit:
        return declined
    here, there, biased = _explanations(state, _explaining(state, misfit))
    far = CONSTANTS.elsewhere_log_evidence
    bias = unknown_bias(batch, state.field_map, state.settings)
    if biased > max(here + far, there + CONSTANTS.bias_log_evidence):
        return state.decided(Verdict(reason, biased=True, bias=bias))
    if there > here + far and _lost_on_any_map(state):
        reason += f"; navigator lost, searching within {LOST_SIGMA[0] / 1000.0:.0f} km (1-sigma)"
        either = state.bias is not None or biased > max(here, there - far)
        return state.decided(Verdict(reason, lost=True, bias=bias if either else None))
    return declined if misfit > options.largest_misfit else _with_larger_noise(state, reason)


def _explaining(state: State, misfit: float) -> float:
    """Return the variance factor of the noise that explanations are judged with: of several
    channels as much as explains all readings where the navigator believes to be.

    One batch has many readings of them, and a place elsewhere, the best of all, takes up by chance
    some of what noise worse than told leaves: with less the navigator would be sent away.
    """
    if state.batch.channel is None:
        return min(misfit, CONSTANTS.explained_variance_factor)
    every = rematch(state, outlier=np.zeros_like(state.outlier))
    return misfit if every.posterior is None else max(every.agreement().ratio, misfit)


def _explanations(state: State, inflation: float) -> tuple[float, float, float]:
    """Return the log evidence of the navigator's own place, of one elsewhere, and of its own
    place with a bias of the readings.

    All are judged on the same readings, with noise as large as a wrong assumption could explain:
    a likelihood that is too sure of itself would find some far place better by chance.
    """
    every = np.zeros_like(state.outlier)
    lost = Mixture.gaussian(np.zeros(4), state.batch.prior + LOST_COVARIANCE[:4, :4])
    there = rematch(state, outlier=every, prior=lost, inflation=inflation)
    here = rematch(state, outlier=every, inflation=inflation)
    biased = -math.inf
    if state.bias is None and len(channels_of(state.field_map)) == 1:
        bias = unknown_bias(state.batch, state.field_map, state.settings).at_end(state.batch)
        with_bias = rematch(state, outlier=every, inflation=inflation, bias=bias)
        biased = evidence(with_bias.posterior)
    return evidence(here.posterior), evidence(there.posterior), biased


def _lost_on_any_map(state: State) -> bool:
    """Return whether the readings say that the navigator is elsewhere also to somebody who thinks
    it possible that the map's error is another than told.

    A map that is much worse than told fits nowhere; with the noise that a moderately wrong
    assumption explains, some place of the many far away fits a little less badly.
    """
    batch, field_map = state.batch, state.field_map
    if batch.channel is not None:
        return True
    unknown = MapErrorEstimate.unknown(batch, field_map).coarse_prior
    prior = unknown.or_rather(state.settings.noise.map_sigma, CONSTANTS.told_probability)
    look = look_elsewhere(LastHour.of_batch(batch, channels_of(field_map)[0], prior), least=2)
    return look is not None and look.log_evidence > CONSTANTS.lost_on_any_map_log_evidence


def _with_larger_noise(state: State, reason: str) -> State:
    """Return the verdict on a batch that nothing but larger noise explains: it may give a fix,
    with a covariance that says so.
    """
    state = learn_from(state)
    left = state.consistency()
    if left.rejects(state.settings):
        wider = rematch(state, inflation=left.ratio)
        state = state if wider.posterior is None else wider
    best = state.best
    if not best.resolved or best.mixture.weight[0] < state.settings.options.confidence:
        return state.decided(Verdict(reason, hypotheses=state.prior, residual=left))
    return state.decided(Verdict(residual=left))
