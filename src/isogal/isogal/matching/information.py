"""From a posterior back to what the measurements alone said (no double counting: SCIENCE 3).

Information of the measurements = posterior information - prior information. It is negative in a
direction in which the posterior is wider than the prior: of two places that fit, a prior between
them knew neither. A navigator that is Gaussian has the posterior's mean and covariance only if it
is told that, too (moment matching; Minka 2001, UAI, "Expectation propagation for approximate
Bayesian inference", where such terms have negative variances). A position fix with a covariance
cannot say it: there, those directions tell nothing."""

import numpy as np

from isogal.arrays import Array
from isogal.matching.interfaces import Batch, Information
from isogal.matching.pmht.likelihood import BatchLikelihood

_NOTHING = 1.0 - 1e-4
"""A variance ratio posterior / prior above this counts as no information in that direction of a
position fix."""
_SLIGHT = 0.01
"""Variance ratios this close to 1 in every direction tell nothing."""
_WIDEST = 4.0
"""Variance ratio at most."""


def likelihood_information(mean: Array, covariance: Array, prior: Array) -> Information:
    """Return the Gaussian likelihood, perhaps with negative information, that turns the prior N(0,
    prior) into N(mean, covariance).

    Zero where no direction tells anything. A posterior is taken to be at most twice as wide as the
    prior.

    Parameters
    ----------
    mean : (n,) array
    covariance, prior : (n, n) arrays
        Positive definite.
    """
    _, ratio, vectors = _relative(covariance, prior)
    if (np.abs(ratio - 1.0) < _SLIGHT).all():
        return Information(vector=np.zeros(len(mean)), matrix=np.zeros_like(prior))
    factor = np.linalg.cholesky(prior)
    ratio = np.minimum(ratio, _WIDEST)
    back = np.linalg.solve(factor.T, vectors)  # whitened directions as rows of information
    coordinate = np.linalg.solve(factor, mean) @ vectors
    return Information(
        vector=back @ (coordinate / ratio), matrix=(back * (1.0 / ratio - 1.0)) @ back.T
    )


def with_attitude(
    batch: Batch, likelihood: BatchLikelihood, mean: Array, covariance: Array
) -> tuple[Array, Array, Array]:
    """Return posterior mean (n,), covariance and prior (n, n) of the navigator's error; n = 7
    where the batch knows the attitude, else 4.

    Given xi ~ N(mean (4,), covariance (4, 4)) the navigator's drift is what the readings say of
    it, linearised at the mean. Without the attitude a navigator would go on believing it
    independent of what it has just learnt."""
    if batch.attitude is None:
        return mean, covariance, batch.prior
    by_xi, root = batch.attitude
    count = root.shape[1]
    drift, slope, spread = (array[:count] for array in likelihood.nuisance_given(mean))
    follow = by_xi + root @ slope
    full = np.concatenate([mean, by_xi @ mean + root @ drift])
    return (
        full,
        _joint(covariance, follow, root @ spread[:, :count] @ root.T),
        joint_prior(batch),
    )


def joint_prior(batch: Batch) -> Array:
    """Return the navigator's covariance (n, n) of its position, velocity and, where the batch
    knows it, attitude error; n = 7 or 4."""
    if batch.attitude is None:
        return batch.prior
    by_xi, root = batch.attitude
    return _joint(batch.prior, by_xi, root @ root.T)


def positive_part(matrix: Array, scale: Array) -> Array:
    """Return a symmetric matrix (n, n) without its negative part, each state being in units of its
    scale (n,)."""
    values, vectors = np.linalg.eigh(matrix / scale / scale[:, None])
    back = vectors * scale[:, None]
    return np.asarray((back * np.maximum(values, 0.0)) @ back.T, dtype=np.float64)


def _joint(covariance: Array, gain: Array, rest: Array) -> Array:
    """Return the covariance of (x, gain x + e), e ~ N(0, rest)."""
    cross = covariance @ gain.T
    whole = np.block([[covariance, cross], [cross.T, gain @ cross + rest]])
    return np.asarray(0.5 * (whole + whole.T) + 1e-14 * np.diag(np.diag(whole)))


def measurement_only(mean: Array, covariance: Array, prior: Array) -> tuple[Array, Array]:
    """Return the position fix (mean, covariance) that turns the prior's position marginal into the
    posterior's.

    Parameters
    ----------
    mean : (4,) array
        Posterior mean of xi.
    covariance, prior : (4, 4) arrays

    Returns
    -------
    (2,), (2, 2) arrays
        Position error (m) according to the measurements alone, and its covariance (m²); a
        direction without information has ten thousand times the prior's variance.
    """
    factor, ratio, vectors = _relative(covariance[:2, :2], prior[:2, :2])
    informed = ratio < _NOTHING
    coordinate = np.linalg.solve(factor, mean[:2]) @ vectors
    weight = np.where(informed, 1.0 / ratio - 1.0, 1e-4)
    z = np.where(informed, coordinate / (ratio * weight), 0.0)
    axes = factor @ vectors
    return axes @ z, (axes / weight) @ axes.T


def _relative(covariance: Array, prior: Array) -> tuple[Array, Array, Array]:
    """Return the prior's Cholesky factor, and eigenvalues and vectors of the posterior covariance
    in prior units."""
    factor = np.asarray(np.linalg.cholesky(prior), dtype=np.float64)
    whitened = np.linalg.solve(factor, np.linalg.solve(factor, covariance).T)
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    return factor, np.maximum(values, 1e-12), np.asarray(vectors, dtype=np.float64)
