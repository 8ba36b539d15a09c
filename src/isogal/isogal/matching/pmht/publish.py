"""Stage 6 of `pmht`: the fix of a batch, and what is remembered of it.

docs/mathematics.md, sections 6.8 and 7.
"""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.quantities import GRAVITY
from isogal.maps.variability import feature_variability
from isogal.matching.channels import first_channel
from isogal.matching.information import likelihood_information, measurement_only, shares
from isogal.matching.interfaces import Batch, Candidates, Fix, Information, declined
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.clustering import pieces
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.contours import contour_candidates
from isogal.matching.pmht.filtered import as_points
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.hypotheses import Update
from isogal.matching.pmht.memory import Memory, VarianceFactor
from isogal.matching.pmht.prepare import unknown_bias
from isogal.matching.pmht.sensor_bias import BiasEstimate
from isogal.matching.pmht.state import State


def publish(state: State) -> tuple[Fix, Memory]:
    """Return the fix that the verdict allows, or why there is none, and the memory after it."""
    fix, memory = _published(state)
    error = _gravity_error(state, memory)
    return (fix if error is None else replace(fix, map_error=error)), memory


def _gravity_error(state: State, memory: Memory) -> tuple[float, float] | None:
    """Return sigma (m/s²) and correlation length (m) of the map's error, where readings have shown
    them and it is a map of gravity."""
    learnt = memory.map_error
    if learnt is None or not learnt.batches or state.field_map.quantity not in GRAVITY:
        return None
    noise = learnt.model(state.settings.noise)
    return noise.map_sigma, noise.correlation_length


def _published(state: State) -> tuple[Fix, Memory]:
    """Return fix and memory of `publish`, the fix without what it says of gravity."""
    verdict = state.verdict
    assert verdict is not None
    if state.posterior is None:
        return declined(state.batch, verdict.reason or ""), _unmatched(state)
    memory = _remembered(state)
    measured = _measured_bias(state)
    figures = _figures(state, memory.variance_factor.value, measured)
    if verdict.reason is not None:
        fix = declined(state.batch, verdict.reason, **figures)
        return replace(fix, reset=verdict.lost), memory
    information = likelihood_information(*state.with_attitude())
    if not information.matrix.any():
        reason = "the batch tells nothing that the navigator does not know"
        return declined(state.batch, reason, **figures), memory
    best = state.best
    bias, unbiased = _simplified(state, measured)
    return _fix(state, information, figures), replace(
        memory,
        hypotheses=_shape(best, best.mixture.covariance[0]),
        taken=best.mixture.covariance[0],
        disagreements=0,
        bias=bias,
        unbiased=memory.unbiased or unbiased,
    )


def _simplified(state: State, bias: BiasEstimate | None) -> tuple[BiasEstimate | None, bool]:
    """Return the bias without what nobody has told of and readings do not show, and whether
    nothing of it is left.
    """
    settings, batch = state.settings, state.batch
    told = settings.noise.bias_sigma > 0.0 or batch.bias_walk > 0.0
    told = told or batch.delay_sigma > 0.0 or batch.parameters is not None
    if bias is None or told or not settings.adaptive:
        return bias, False
    before = unknown_bias(batch, state.field_map, settings).covariance
    simple = bias.simplified((math.sqrt(before[0, 0]), math.sqrt(before[1, 1])))
    return simple, simple is None


def _measured_bias(state: State) -> BiasEstimate | None:
    """Return the readings' bias after the batch, for a navigator that takes its fix."""
    if state.bias is None:
        return None
    mean, covariance, _ = state.with_attitude()
    return state.bias.measured(state.batch, state.best.likelihood, mean, covariance)


def _fix(state: State, information: Information, figures: dict[str, float]) -> Fix:
    batch, best = state.batch, state.best
    mean, covariance = best.mixture.mean[0], best.mixture.covariance[0]
    error, error_covariance = measurement_only(mean, covariance, batch.prior)
    north, east = metres_per_radian(batch.end[0])
    each, first = first_channel(batch, state.field_map)  # each scan once

    def shown() -> Candidates:
        return contour_candidates(as_points(each, first, mean), first, mean, covariance)

    fix = Fix(
        time=float(batch.time[-1]),
        latitude=float(batch.end[0] - error[0] / north),
        longitude=float(batch.end[1] - error[1] / east),
        covariance=error_covariance,
        shown=shown,
        diagnostics=figures,
        information=information,
    )
    return _of_each_scan(fix, state, each, mean) if state.settings.each_scan else fix


def _of_each_scan(fix: Fix, state: State, each: Batch, mean: Array) -> Fix:
    """Return the fix with what it says at each scan, for retrodiction."""
    batch, new = state.batch, slice(len(each) - each.new, None)
    moved = np.full((len(each), 2), np.nan)
    moved[new] = each.transition[new] @ mean
    north, east = metres_per_radian(each.latitude)
    covariance = np.full((len(each), 2, 2), np.nan)
    covariance[new] = fix.covariance * each.new
    parts: list[Information | None] = [None] * len(each)
    if each.backward is not None and fix.information is not None:
        parts[new] = shares(fix.information, joint_prior(batch), each.backward[new])
    places = [each.latitude - moved[:, 0] / north, each.longitude - moved[:, 1] / east]
    late = batch.end_place is not None  # says where the vehicle was, not where it is at the stamps
    return replace(
        fix,
        scan_position=None if late else np.stack(places, axis=-1),
        scan_covariance=None if late else covariance,
        scan_information=None if each.backward is None else tuple(parts),
    )


def _remembered(state: State) -> Memory:
    """Return the memory after a batch that was matched, as if it gave no fix."""
    batch, verdict, before = state.batch, state.verdict, state.memory
    assert verdict is not None
    published = verdict.reason is None
    outliers = frozenset(t for t in (before.outlier_times if before else ()) if t >= batch.time[0])
    factor = before.variance_factor if before else VarianceFactor()
    if verdict.residual is not None:
        residual = verdict.residual
        factor = factor.updated(residual.value * factor.value, residual.freedom)
    bias = None if state.bias is None else state.bias.unmeasured(batch)
    return Memory(
        time=float(batch.time[-1]),
        prior=batch.prior,
        hypotheses=None if published else verdict.hypotheses,
        disagreements=(before.disagreements if before else 0) + verdict.unexplained,
        # only where all agrees: what stands out at a wrong place may be right
        outlier_times=outliers | state.outlier_times if published and state.agrees else outliers,
        map_error=state.learnt if published else state.map_error,
        unbiased=before is not None and before.unbiased and verdict.bias is None,
        bias=verdict.bias if verdict.lost else bias,
        variance_factor=VarianceFactor() if verdict.lost else factor,
        log_evidence=(before.log_evidence if before else 0.0) + state.log_evidence,
    )


def _unmatched(state: State) -> Memory:
    """Return the memory after a batch that could not be matched."""
    batch, before = state.batch, state.memory or Memory.before(state.batch)
    alone = before.hypotheses is None and before.current is None
    return replace(
        before,
        time=float(batch.time[-1]),
        prior=batch.prior,
        hypotheses=None if alone else state.prior,
        current=None,
        taken=None if before.taken is None else batch.prior,
        bias=None if state.bias is None else state.bias.unmeasured(batch),
    )


def _figures(state: State, variance_factor: float, bias: BiasEstimate | None) -> dict[str, float]:
    """Return what the diagnostics say of a batch that was matched."""
    best, agreement = state.best, state.agreement()
    place = state.batch.latitude[-1:], state.batch.longitude[-1:]
    figures = {
        "hypotheses": float(len(best.mixture)),
        "probability": float(best.mixture.weight[0]),
        "effective_samples": best.effective,
        "rounds": float(best.rounds),
        "misfit": agreement.ratio,
        "p_value": agreement.p_value,
        "noise_scale": variance_factor,
        "readings_left_out": float(len(state.outlier_times)),
        "feature_variability": float(feature_variability(state.first_map, *place)[0]),
    }
    if state.learnt is not None:
        figures |= state.learnt.figures(state.settings.noise)
    if bias is not None:
        figures |= bias.figures()
    return figures


def _shape(best: Update, covariance: Array) -> Mixture | None:
    """Return the posterior's shape as hypotheses about the navigator that has taken the fix; None
    where a Gaussian says it.

    In a flat field with a poor map the posterior is a ridge or has a shoulder, and the Gaussian
    that the navigator makes of it forgets the tail in which the truth may be. So it is carried on
    as a sum of Gaussians (Sorenson & Alspach 1971, Automatica 7:465).
    """
    sigma = math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    least, most = CONSTANTS.carried_shape_m
    if best.drawn is None or len(best.mixture) > 1 or not least < sigma < most:
        return None
    x, weight = best.drawn
    scale = np.sqrt(np.diag(covariance))
    shape, gaussian = (pieces(x, weight, scale, cuts) for cuts in (CONSTANTS.shape_cuts, 0))
    gain = float(weight @ (shape.log_density(x) - gaussian.log_density(x)))
    if gain <= CONSTANTS.least_shape_gain_log:
        return None
    # the samples are a few hundred; as a whole the shape has the moments that were published
    centre, spread = shape.moments()
    turn = np.linalg.cholesky(covariance) @ np.linalg.inv(np.linalg.cholesky(spread))
    return Mixture(shape.weight, (shape.mean - centre) @ turn.T, turn @ shape.covariance @ turn.T)
