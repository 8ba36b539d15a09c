"""From a posterior back to what the measurements alone said, so that nothing counts twice.

Information of the measurements = posterior information - prior information. It is negative in a
direction in which the posterior is wider than the prior: of two places that fit, a prior between
them knew neither. A navigator that is Gaussian has the posterior's mean and covariance only if it
is given that, too (moment matching; Minka 2001, UAI, "Expectation propagation for approximate
Bayesian inference", where such terms have negative variances). A position fix with a covariance
cannot say it: there, those directions say nothing (docs/mathematics.md, section 7).
"""

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.matching.interfaces import Batch, Information
from isogal.matrices import symmetric

UNINFORMED = 1e-4
"""Least information of a direction of a position fix, in units of the prior's."""
LEAST_CHANGE = 0.01
"""Change of the variance ratio, in some direction, that a batch needs to say anything."""
LARGEST_RATIO = 4.0
"""Variance ratio at most: a posterior is taken to be at most twice as wide as the prior."""


def likelihood_information(mean: Array, covariance: Array, prior: Array) -> Information:
    """Return the Gaussian likelihood, perhaps with negative information, that turns the prior N(0,
    prior) into N(mean, covariance).

    Zero where no direction says anything. A posterior is taken to be at most twice as wide as the
    prior.

    Parameters
    ----------
    mean : (n,) array
    covariance, prior : (n, n) arrays
        Positive definite.
    """
    factor, ratio, vectors = relative(covariance, prior)
    if (np.abs(ratio - 1.0) < LEAST_CHANGE).all():
        return Information(np.zeros_like(mean), np.zeros_like(prior))
    back = np.linalg.solve(factor.T, vectors)
    ratio = np.minimum(ratio, LARGEST_RATIO)
    matrix = (back * (1.0 / ratio - 1.0)) @ back.T
    coordinate = vectors.T @ np.linalg.solve(factor, mean)
    return Information(back @ (coordinate / ratio), symmetric(matrix))


def shares(information: Information, prior: Array, backward: Array) -> tuple[Information, ...]:
    """Return n equal shares of information about the error x at a batch end, for n earlier scans
    (docs/mathematics.md, section 7.4).

    Parameters
    ----------
    prior : (k, k) array
        Of x, before any of them.
    backward : (n, k, k) array
        Error at each scan per unit of x.

    Returns
    -------
    tuple of Information
        Each about the error at its scan, relative to the estimate there of a navigator that has
        taken the ones before.
    """
    count = len(backward)
    taken = np.arange(count)[:, None, None] / count
    mean = np.linalg.solve(
        np.eye(len(prior)) + taken * (prior @ information.matrix),
        taken * (prior @ information.vector)[:, None],
    )
    left = information.vector[:, None] - information.matrix @ mean
    forward = np.linalg.inv(backward)
    back = forward.swapaxes(1, 2)
    matrix = symmetric(back @ information.matrix @ forward) / count
    vector = (back @ left)[..., 0] / count
    return tuple(Information(*one) for one in zip(vector, matrix, strict=True))


def position_information(
    batch: Batch, latitude: float, longitude: float, covariance: Array
) -> Information:
    """Return what a position at a batch's last scan says about xi.

    Parameters
    ----------
    batch : Batch
    latitude, longitude : float
        rad.
    covariance : (2, 2) array
        m², north and east.
    """
    seen = -horizontal_difference(latitude, longitude, *batch.end)
    vector, matrix = np.zeros(4), np.zeros((4, 4))
    matrix[:2, :2] = np.linalg.inv(covariance)
    vector[:2] = matrix[:2, :2] @ seen
    return Information(vector, matrix)


def informed(prior: Array, information: Information) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) of the first n numbers x ~ N(0, prior) that
    information is about."""
    n = len(prior)
    vector, matrix = information.vector[:n], information.matrix[:n, :n]
    # (P⁻¹ + M)⁻¹ without inverting P, whose velocity part may be tiny
    covariance = np.linalg.solve(np.eye(n) + prior @ matrix, prior)
    covariance = symmetric(covariance)
    return np.asarray(covariance @ vector), covariance


def positive_part(information: Information, scale: Array) -> Information:
    """Return information without the directions in which it is negative, in units (n,) of x."""
    values, vectors = np.linalg.eigh(information.matrix * scale * scale[:, None])
    kept = vectors[:, values > 0.0]
    back = kept / scale[:, None]
    matrix = (back * values[values > 0.0]) @ back.T
    return Information(back @ (kept.T @ (scale * information.vector)), matrix)


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
    factor, ratio, vectors = relative(covariance[:2, :2], prior[:2, :2])
    axes = factor @ vectors
    told = 1.0 - ratio > UNINFORMED
    weight = np.where(told, 1.0 / ratio - 1.0, UNINFORMED)
    coordinate = vectors.T @ np.linalg.solve(factor, mean[:2])
    error = axes @ np.where(told, coordinate / (ratio * weight), 0.0)
    return error, symmetric((axes / weight) @ axes.T)


def relative(covariance: Array, prior: Array) -> tuple[Array, Array, Array]:
    """Return (n, n) the Cholesky factor of a covariance `prior`, and eigenvalues and vectors of
    another one in its units; raises LinAlgError where `prior` is not positive definite."""
    factor = np.asarray(np.linalg.cholesky(prior))
    inner = np.linalg.solve(factor, np.linalg.solve(factor, covariance).T)
    values, vectors = np.linalg.eigh(inner)
    return factor, np.maximum(values, 1e-12), np.asarray(vectors)
