"""Probabilistic data association of one scan's map candidates (paper eqs. s3-01, s3-02, s3-021 and
s32-1).

The paper leaves R_i(sigma), "the associated variance which is a function of the signal noise
variance", open. Here it is isotropic: the distance over which the map changes by one sigma at the
candidate, plus what a lattice of map points leaves unresolved,

    R_i = min(sigma² / |grad g_i|² + d² / 12, limit) I,

d the spacing of the lattice: a point stands for a cell of that width, whose uniform distribution
has the variance d² / 12 a side."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel


@kernel
def candidate_variance(sigma: float, gradient: Array, spacing: float, limit: float) -> Array:
    """Variance per axis of each candidate, the R_i(sigma) of paper eq. s3-01.

    Parameters
    ----------
    sigma : float
        1-sigma of the reading, map's unit.
    gradient : (n, 2) array
        The map's gradient at each candidate, unit/m.
    spacing : float
        Distance between neighbouring map points, m.
    limit : float
        Largest variance, m²: where the map is flat a candidate is as uncertain as the search
        window is wide.

    Returns
    -------
    (n,) array
        m².
    """
    variance = np.empty(gradient.shape[0])
    for i in range(variance.shape[0]):
        steepness = gradient[i, 0] * gradient[i, 0] + gradient[i, 1] * gradient[i, 1]
        # compared by product, so that a flat map (zero gradient) divides by nothing
        if sigma * sigma >= limit * steepness:
            variance[i] = limit
        else:
            variance[i] = min(sigma * sigma / steepness + spacing * spacing / 12.0, limit)
    return variance


@kernel
def association_weights(candidates: Array, centre: Array, variance: Array) -> Array:
    """Weights of paper eq. s3-01 with p(z_i | x) = N(z_i; x, variance_i I).

    With one variance for all candidates, R-bar of the scan, these are the weights of paper eq.
    s32-1.

    Parameters
    ----------
    candidates : (n, 2) array
        Positions z_i, m, n >= 1.
    centre : (2,) array
        The position x that they are compared with, m.
    variance : (n,) array
        Variance per axis of each, m².

    Returns
    -------
    (n,) array
        Sum 1. Far from all candidates it is the nearest (in sigmas) that takes the weight, not 0 /
        0.
    """
    n = candidates.shape[0]
    weights = np.empty(n)
    largest = -np.inf
    for i in range(n):
        north = candidates[i, 0] - centre[0]
        east = candidates[i, 1] - centre[1]
        weights[i] = -0.5 * (north * north + east * east) / variance[i] - math.log(variance[i])
        largest = max(largest, weights[i])
    total = 0.0
    for i in range(n):
        weights[i] = math.exp(weights[i] - largest)
        total += weights[i]
    for i in range(n):
        weights[i] /= total
    return weights


@kernel
def combine(candidates: Array, weights: Array, variance: Array) -> tuple[float, float, float]:
    """Weighted mean z-bar (paper eq. s3-02) and weighted variance R-bar (paper eq. s3-021).

    The spread of the candidates about their mean is not in R-bar; the paper leaves it out.

    Parameters
    ----------
    candidates : (n, 2) array
        m.
    weights : (n,) array
        Association weights.
    variance : (n,) array
        R_i per axis, m².

    Returns
    -------
    north, east, variance
        z-bar in m, R-bar in m² per axis.
    """
    north = east = total = combined = 0.0
    for i in range(weights.shape[0]):
        north += weights[i] * candidates[i, 0]
        east += weights[i] * candidates[i, 1]
        combined += weights[i] * variance[i]
        total += weights[i]
    return north / total, east / total, combined / total
