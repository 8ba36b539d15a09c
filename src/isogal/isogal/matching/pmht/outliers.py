"""Stage 2 of `pmht`, and its second half after the update: readings that cannot be right.

docs/mathematics.md, sections 8.1 and 8.2.
"""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.compiled import kernel
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.noise_model import distances
from isogal.matching.pmht.state import State


def reject_outliers(state: State) -> State:
    """Return the state without the readings whose innovations stand out from their neighbours'.

    The place is not known yet: what a wrong place does to the innovations is smooth along the
    track, an outlier is not.
    """
    likelihood, prior = state.likelihood, state.prior
    mean, covariance = prior.moments()
    innovation, slope = likelihood.linearise(mean)
    if not np.isfinite(innovation).all():
        return state
    expected = residual_covariance(likelihood, mean, slope, covariance)
    reach = (slope @ covariance * slope).sum(axis=1)
    smooth = smooth_covariance(
        likelihood.readings.latitude,
        likelihood.readings.longitude,
        math.sqrt(float(reach.mean())),
        CONSTANTS.wrong_place_length_m,
    )
    channel = likelihood.readings.channel
    if channel.any():
        smooth *= channel[:, None] == channel
    expected += smooth
    gate = state.settings.options.outlier_gate + CONSTANTS.innovation_gate_excess_sigma
    found = outliers(innovation, expected, gate)
    return replace(state, outlier=found) if found.any() else state


def residual_outliers(likelihood: BatchLikelihood, posterior: Mixture, gate: float) -> Booleans:
    """Return (T,) which readings stand out at the best hypothesis, all readings being tested."""
    mean, covariance = posterior.mean[0], posterior.covariance[0]
    residual, slope = likelihood.linearise(mean)
    if not np.isfinite(residual).all():
        return np.zeros(len(residual), dtype=np.bool_)
    expected = residual_covariance(likelihood, mean, slope, covariance)
    return outliers(residual, expected, gate)


def residual_covariance(
    likelihood: BatchLikelihood, mean: Array, slope: Array, covariance: Array
) -> Array:
    """Return (T, T) the covariance of residuals linearised at a place: `slope` (T, 4), and mean
    (4,) and covariance (4, 4) of the navigator's error."""
    nuisance = likelihood.nuisance_at(mean)
    return likelihood.covariance + nuisance @ nuisance.T + slope @ covariance @ slope.T


def leave_one_out(residual: Array, covariance: Array) -> Array:
    """Return (T,) each residual's deviation from what the others predict for it, in its 1-sigma.

    For r ~ N(0, S): (S⁻¹ r)_i / sqrt((S⁻¹)_ii) (Rasmussen & Williams 2006, eqs. 5.10-5.12). 0 for
    all where S is singular to rounding: then none can be told from the others.
    """
    return np.asarray(_left_out(np.ascontiguousarray(covariance), residual))


def outliers(
    residual: Array,
    covariance: Array,
    gate: float,
    largest_share: float = CONSTANTS.largest_outlier_share,
) -> Booleans:
    """Return (T,) which residuals are outliers: the worst is taken out while it exceeds the gate.

    Parameters
    ----------
    residual : (T,) array
    covariance : (T, T) array
        Of the residuals, with everything smooth along the track in it.
    gate : float
        In 1-sigma.
    largest_share : float
        Of the residuals; with more of them none is taken out: then the model is wrong.
    """
    bad = np.zeros(len(residual), dtype=np.bool_)
    for _ in range(int(largest_share * len(residual)) + 1):
        keep = np.flatnonzero(~bad)
        if len(keep) < 3:
            break
        part = covariance if len(keep) == len(bad) else covariance[np.ix_(keep, keep)]
        deviation = np.abs(leave_one_out(residual[keep], part))
        worst = int(np.argmax(deviation))
        if deviation[worst] <= gate:
            return bad
        bad[keep[worst]] = True
    return np.zeros(len(residual), dtype=np.bool_)


@kernel
def smooth_covariance(latitude, longitude, sigma, length):  # type: ignore[no-untyped-def]
    """Return (T, T) sigma² exp(-d² / 2 length²) between places (T,) in rad, length in m.

    It stands for the map's values at a wrong place: smooth over the map's features.
    """
    out = distances(latitude, longitude)
    for i in range(out.shape[0]):
        for j in range(i + 1):
            out[i, j] = out[j, i] = sigma**2 * math.exp(-0.5 * (out[i, j] / length) ** 2)
    return out


@kernel(error_model="numpy")
def _left_out(covariance, residual):  # type: ignore[no-untyped-def]
    """Return `leave_one_out`."""
    count = residual.shape[0]
    upper = covariance.copy()  # becomes the Cholesky factor, transposed
    for a in range(count):
        row = upper[a]
        if not row[a] > 0.0:
            return np.zeros(count)
        scale = 1.0 / math.sqrt(row[a])
        for i in range(a, count):
            row[i] *= scale
        for b in range(a + 1, count):
            weight, other = row[b], upper[b]
            for i in range(b, count):
                other[i] -= weight * row[i]
    inverse = np.zeros((count, count))  # of the factor
    solved, diagonal = np.zeros(count), np.zeros(count)
    for a in range(count):
        row, white = inverse[a], 0.0
        row[a] = 1.0
        for b in range(a):
            weight, other = upper[b, a], inverse[b]
            for i in range(b + 1):
                row[i] -= weight * other[i]
        scale = 1.0 / upper[a, a]
        for i in range(a + 1):
            row[i] *= scale
            white += row[i] * residual[i]
        for i in range(a + 1):
            solved[i] += row[i] * white
            diagonal[i] += row[i] * row[i]
    for i in range(count):
        solved[i] /= math.sqrt(diagonal[i])
    return solved
