"""From a posterior back to what the measurements alone said (no double counting: SCIENCE 3).

Information of the measurements = posterior information - prior information, in the directions in which the posterior is narrower
than the prior; in the others the measurements say nothing.
"""

import numpy as np
from numpy.typing import NDArray

from isogal.matching.interfaces import Information

Array = NDArray[np.float64]

_NOTHING = 1.0 - 1e-4
"""A variance ratio posterior / prior above this counts as no information in that direction."""


def likelihood_information(mean: Array, covariance: Array, prior: Array) -> Information:
    """Return the Gaussian likelihood that turns the prior N(0, prior) into N(mean, covariance).

    Parameters
    ----------
    mean : (n,) array
    covariance, prior : (n, n) arrays
        Positive definite.
    """
    _, ratio, vectors = _relative(covariance, prior)
    factor = np.linalg.cholesky(prior)
    informed = ratio < _NOTHING
    back = np.linalg.solve(factor.T, vectors[:, informed])  # whitened directions as rows of information
    coordinate = np.linalg.solve(factor, mean) @ vectors[:, informed]
    weight = 1.0 / ratio[informed] - 1.0
    return Information(vector=back @ (coordinate / ratio[informed]), matrix=(back * weight) @ back.T)


def measurement_only(mean: Array, covariance: Array, prior: Array) -> tuple[Array, Array]:
    """Return the position fix (mean, covariance) that turns the prior's position marginal into the posterior's.

    Parameters
    ----------
    mean : (4,) array
        Posterior mean of xi.
    covariance, prior : (4, 4) arrays

    Returns
    -------
    (2,), (2, 2) arrays
        Position error (m) according to the measurements alone, and its covariance (m²); a direction without information
        has ten thousand times the prior's variance.
    """
    factor, ratio, vectors = _relative(covariance[:2, :2], prior[:2, :2])
    informed = ratio < _NOTHING
    coordinate = np.linalg.solve(factor, mean[:2]) @ vectors
    weight = np.where(informed, 1.0 / ratio - 1.0, 1e-4)
    z = np.where(informed, coordinate / (ratio * weight), 0.0)
    axes = factor @ vectors
    return axes @ z, (axes / weight) @ axes.T


def _relative(covariance: Array, prior: Array) -> tuple[Array, Array, Array]:
    """Return the prior's Cholesky factor, and eigenvalues and vectors of the posterior covariance in prior units."""
    factor = np.asarray(np.linalg.cholesky(prior), dtype=np.float64)
    whitened = np.linalg.solve(factor, np.linalg.solve(factor, covariance).T)
    values, vectors = np.linalg.eigh(0.5 * (whitened + whitened.T))
    return factor, np.maximum(values, 1e-12), np.asarray(vectors, dtype=np.float64)
