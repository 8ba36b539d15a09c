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
from isogal.compiled import kernel
from isogal.earth.frames import horizontal_difference
from isogal.matching.interfaces import Batch, Information
from isogal.matrices import eigen, inverse_of_lower, lower, product, product_transposed, symmetric

UNINFORMED_RATIO = 1.0 - 1e-4
"""Variance ratio posterior / prior above which a direction of a position fix says nothing."""
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
    found = _likelihood(*map(np.ascontiguousarray, (mean, covariance, prior)))
    if not np.isfinite(found[1][0, 0]):
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    return Information(*found)


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
    place = (mean[:2], covariance[:2, :2], prior[:2, :2])
    error, spread = _measured(*map(np.ascontiguousarray, place))
    if not np.isfinite(spread[0, 0]):
        raise np.linalg.LinAlgError("Matrix is not positive definite")
    return error, spread


@kernel
def _relative(covariance: Array, prior: Array) -> tuple[Array, Array, Array]:
    """Return the inverse of the prior's Cholesky factor, and eigenvalues and vectors of the
    posterior covariance in prior units."""
    whitening = inverse_of_lower(lower(prior))
    values, vectors = eigen(product_transposed(product(whitening, covariance), whitening))
    for k in range(values.shape[0]):
        values[k] = max(values[k], 1e-12)
    return whitening, values, vectors


@kernel
def _likelihood(mean: Array, covariance: Array, prior: Array) -> tuple[Array, Array]:
    """Return vector (n,) and matrix (n, n) of `likelihood_information`."""
    n = mean.shape[0]
    whitening, ratio, vectors = _relative(covariance, prior)
    back, vector, matrix = np.zeros((n, n)), np.zeros(n), np.zeros((n, n))
    informative = False
    for k in range(n):
        informative = informative or not abs(ratio[k] - 1.0) < LEAST_CHANGE
    for k in range(n if informative else 0):
        size, coordinate = min(ratio[k], LARGEST_RATIO), 0.0
        for j in range(n):
            for i in range(n):
                back[i, k] += whitening[j, i] * vectors[j, k]
                coordinate += vectors[j, k] * whitening[j, i] * mean[i]
        for i in range(n):
            vector[i] += back[i, k] * coordinate / size
            for j in range(n):
                matrix[i, j] += back[i, k] * (1.0 / size - 1.0) * back[j, k]
    return vector, matrix


@kernel
def _measured(mean: Array, covariance: Array, prior: Array) -> tuple[Array, Array]:
    """Return position error (2,) and covariance (2, 2) of `measurement_only`."""
    n = mean.shape[0]
    whitening, ratio, vectors = _relative(covariance, prior)
    axes = product(lower(prior), vectors)
    error, spread = np.zeros(n), np.zeros((n, n))
    for k in range(n):
        weight, z = 1e-4, 0.0
        if not ratio[k] >= UNINFORMED_RATIO:
            weight = 1.0 / ratio[k] - 1.0
            for j in range(n):
                for i in range(n):
                    z += vectors[j, k] * whitening[j, i] * mean[i]
            z /= ratio[k] * weight
        for i in range(n):
            error[i] += axes[i, k] * z
            for j in range(n):
                spread[i, j] += axes[i, k] * axes[j, k] / weight
    return error, spread
