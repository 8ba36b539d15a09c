"""Error bars that do not rest on the noise models alone: the fix made again without each half of
the track.

Noise models are never quite right: errors of a map differ from place to place, are not Gaussian,
and depend on the field. How far the fix then really moves is seen by leaving out parts of the
track. One block at a time (the usual jackknife) shows how a peak moves, but not whether the peak
is the right one: with few left out the others still outvote the truth. So d = 4 of 8 blocks are
left out, in all 70 ways (delete-d jackknife: Shao & Wu 1989, Ann. Stat. 17(3):1176-1197); with
half left out, (8 - d) / d = 1, and the variance of the fixes is that of the fix itself. Where it
exceeds the posterior's, the excess is added to the covariance. Nothing makes a fix narrower.

The part of the likelihood that a block contributes is that of its innovations: with R = L L' and
w = L⁻¹ r, block b contributes -½ Σ w_t² - Σ log L_tt over its rows, given the blocks before it."""

from itertools import combinations

import numpy as np

from isogal.arrays import Array
from isogal.tracks.integrated.search import ShiftPosterior

BLOCKS = 8
LEFT_OUT = 4
_FEWEST = 16
"""Rows; with fewer the blocks are too small to say anything."""
_MODELS = 12
"""Likeliest noise models that are used."""


def jackknife_excess(*posteriors: ShiftPosterior) -> Array:
    """Return (2, 2) m², what must be added to the posterior's covariance; of several fields each
    without the halves of its own readings, whose errors are independent."""
    covariance = posteriors[0].moments[1]
    every = [_scatter(posterior) for posterior in posteriors]
    known = [scatter for scatter in every if scatter is not None]
    if not known:
        return np.zeros((2, 2))
    scatter = sum(known[1:], known[0])
    factor = np.linalg.cholesky(covariance)
    relative = np.linalg.solve(factor, np.linalg.solve(factor, scatter).T)
    values, vectors = np.linalg.eigh(0.5 * (relative + relative.T))
    axes = factor @ vectors
    return np.asarray((axes * np.maximum(values - 1.0, 0.0)) @ axes.T)


def _scatter(posterior: ShiftPosterior) -> Array | None:
    """Return (2, 2) m² the covariance of the fixes without halves of a field's readings; None
    where they are too few to say."""
    mean, _ = posterior.moments
    new = len(posterior.readings) - posterior.readings.first_new
    if new < _FEWEST:
        return None
    parts, weight = _block_likelihoods(posterior)
    total = parts.sum(axis=1)
    shifts = posterior.shifts
    means = []
    for left_out in combinations(range(BLOCKS), LEFT_OUT):
        rest = total - parts[:, list(left_out)].sum(axis=1) + weight[:, None]
        top = rest.max(axis=0)
        rest -= top
        log_density = top + np.log(np.exp(rest, out=rest).sum(axis=0)) + posterior.log_prior
        share = np.exp(log_density - log_density.max())
        means.append(share @ shifts / share.sum())
    apart = np.array(means) - mean
    return np.asarray(apart.T @ apart / len(apart) * (BLOCKS - LEFT_OUT) / LEFT_OUT)


def _block_likelihoods(posterior: ShiftPosterior) -> tuple[Array, Array]:
    """Return (M, blocks, S) contributions to the log-likelihood of the likeliest noise models,
    and (M,) their log prior probabilities."""
    models = posterior.models
    order = np.argsort(-posterior.by_model, axis=None, kind="stable")[:_MODELS]
    blocks = np.array_split(
        np.arange(posterior.readings.first_new, len(posterior.readings)), BLOCKS
    )
    parts, prior = [], []
    for index in order:
        i, j, k, b = np.unravel_index(index, posterior.by_model.shape)
        covariance = posterior.around.covariance(
            models.correlations[i],
            models.shapes[j],
            float(models.scales[k]),
            float(models.offsets[b]),
        )
        factor = np.linalg.cholesky(covariance)
        square = (np.linalg.inv(factor) @ posterior.residual) ** 2
        height = np.log(np.diag(factor))
        parts.append([-0.5 * square[rows].sum(axis=0) - height[rows].sum() for rows in blocks])
        prior.append(models.log_prior[i, j, k, b])
    return np.array(parts), np.array(prior)
