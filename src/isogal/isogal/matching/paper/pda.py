"""Probabilistic data association of one scan's map candidates (paper eqs. s3-01, s3-02, s3-021 and
s32-1).

The paper leaves R_i(sigma), "the associated variance which is a function of the signal noise
variance", open. Here it is isotropic: the distance over which the map changes by one sigma at the
candidate, plus what a lattice of map points leaves unresolved,

    R_i = min(sigma² / |grad g_i|² + d² / 12, limit) I,

d the spacing of the lattice: a point stands for a cell of that width, whose uniform distribution
has the variance d² / 12 a side."""

import numpy as np

from isogal.arrays import Array


def candidate_variance(
    sigma: Array | float, gradient: Array, spacing: float, limit: Array | float
) -> Array:
    """Variance per axis of each candidate, the R_i(sigma) of paper eq. s3-01.

    Parameters
    ----------
    sigma : float, or array that broadcasts with (..., n)
        1-sigma of the reading, map's unit.
    gradient : (..., n, 2) array
        The map's gradient at each candidate, unit/m.
    spacing : float
        Distance between neighbouring map points, m.
    limit : float, or array that broadcasts with (..., n)
        Largest variance, m²: where the map is flat a candidate is as uncertain as the search
        window is wide.

    Returns
    -------
    (..., n) array
        m².
    """
    steepness = (gradient**2).sum(axis=-1)
    # compared by product, so that a flat map (zero gradient) divides by nothing
    steep = sigma**2 < limit * steepness
    across = sigma**2 / np.where(steep, steepness, 1.0) + spacing**2 / 12.0
    return np.where(steep, np.minimum(across, limit), limit)


def association_weights(candidates: Array, centre: Array, variance: Array) -> Array:
    """Weights of paper eq. s3-01 with p(z_i | x) = N(z_i; x, variance_i I), of one scan or of
    several.

    With one variance for all candidates, R-bar of the scan, these are the weights of paper eq.
    s32-1.

    Parameters
    ----------
    candidates : (..., n, 2) array
        Positions z_i, m, n >= 1.
    centre : (..., 2) array
        The position x that they are compared with, m.
    variance : (..., n) array
        Variance per axis of each, m²; infinite = there is no such candidate.

    Returns
    -------
    (..., n) array
        Sum 1. Far from all candidates it is the nearest (in sigmas) that takes the weight, not 0 /
        0.
    """
    square = ((candidates - centre[..., None, :]) ** 2).sum(axis=-1)
    log = -0.5 * square / variance - np.log(variance)
    weights = np.exp(log - log.max(axis=-1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=-1, keepdims=True))


def combine(candidates: Array, weights: Array, variance: Array) -> tuple[Array, Array]:
    """Weighted mean z-bar (paper eq. s3-02) and weighted variance R-bar (paper eq. s3-021).

    The spread of the candidates about their mean is not in R-bar; the paper leaves it out.

    Parameters
    ----------
    candidates : (..., n, 2) array
        m.
    weights : (..., n) array
        Association weights, sum 1.
    variance : (..., n) array
        R_i per axis, m².

    Returns
    -------
    (..., 2), (...) arrays
        z-bar in m, R-bar in m² per axis.
    """
    return (weights[..., None] * candidates).sum(axis=-2), (weights * variance).sum(axis=-1)
