"""Posterior of a narrow prior, over which the map is all but linear (docs/mathematics.md, section
6.9).

Gauss-Newton steps lead to the mode, and the linear problem there has a Gaussian posterior. Points
of that Gaussian, as few as have its moments exactly, are weighted by exact over linear likelihood:
importance sampling whose weights are all the same where the map is linear, so that its result is
then free of sampling noise. Where weights differ much, or residuals anywhere in the prior are far
from linear, there is no result, and the samplers of other priors take over.
"""

import math
from functools import lru_cache

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.matching.pmht.clustering import moments
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.importance_sampling import Posterior
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.likelihood_kernels import log_likelihood, mode, whitened
from isogal.matching.quasi_random import standard_normal
from isogal.matrices import inverse_of_lower, lower


def nearly_linear(
    likelihood: BatchLikelihood, mean: Array, covariance: Array
) -> tuple[Posterior, BatchLikelihood] | None:
    """Return the posterior and the likelihood linearised at its mean; None where the problem is
    not nearly linear.

    Parameters
    ----------
    mean, covariance : (4,), (4, 4) arrays
        Prior.
    """
    c = CONSTANTS
    root: Array = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    place, readings = likelihood.grid, likelihood.readings
    drift = likelihood.nuisance_position, likelihood.nuisance_reading, likelihood.whitening
    found, z, slope, precision, reduction = mode(
        place, readings, *drift, mean, root, c.newton_steps, c.newton_tolerance
    )
    if not found or not _linear_over_prior(
        place, readings, reduction, mean, root, z, slope, c.linear_reach_sigma, c.linear_tolerance
    ):
        return None
    points = _points(c.linear_points)
    x, weight, evidence, effective = _weighed(
        place, readings, reduction, mean, root, z, precision, points
    )
    if not effective >= c.linear_effective_share:
        return None
    centre, spread = moments(x, weight)
    posterior = Posterior(Mixture.gaussian(centre, spread), evidence, effective, 1.0, 1, x, weight)
    return posterior, likelihood.with_nuisance_at(centre)


@kernel
def _linear_over_prior(  # type: ignore[no-untyped-def]
    grid, readings, reduction, mean, root, mode, slope, reach, tolerance
):
    """Whether residuals change as they should at a wrong place, on the axes of the prior and of
    its position: then there is one mode.

    Arguments as `likelihood_kernels.mode` takes and returns them; the root is a lower triangle.
    `reach` in 1-sigmas.
    """
    axes = np.eye(4)
    # the position's axes; velocity goes along as the prior has it
    north, cross, east = root[0, 0], root[1, 0], root[1, 1]
    angle = 0.5 * math.atan2(2.0 * cross * east, north * north + cross * cross - east * east)
    axes[0, 0], axes[0, 1] = math.cos(angle), math.sin(angle)
    axes[1, 0], axes[1, 1] = -axes[0, 1], axes[0, 0]
    places = np.zeros((9, 4))  # less the mode, which is the last one
    x = np.empty((9, 4))
    for s in range(9):
        for i in range(4):
            if s < 8:
                places[s, i] = (reach if s < 4 else -reach) * axes[s % 4, i] - mode[i]
        for i in range(4):
            x[s, i] = mean[i]
            for j in range(i + 1):
                x[s, i] += root[i, j] * (mode[j] + places[s, j])
    residual = whitened(grid, readings, reduction, x)
    for s in range(8):
        off, large = 0.0, 1.0
        for k in range(residual.shape[0]):
            expected = 0.0
            for j in range(4):
                expected += slope[k, j] * places[s, j]
            off += (residual[k, s] - residual[k, 8] - expected) ** 2
            large += expected * expected
        if not off < tolerance * tolerance * large:
            return False
    return True


@kernel
def _weighed(  # type: ignore[no-untyped-def]
    grid, readings, reduction, mean, root, mode, precision, points
):
    """Return errors x (S, 4) at points (S, 4) of the linear problem's posterior, their weights
    (S,), the log of the evidence, and the effective share; NaN where any is off the map.

    Arguments as `likelihood_kernels.mode` takes and returns them; the root is a lower triangle.
    """
    count = points.shape[0]
    factor = lower(precision)
    spread = inverse_of_lower(factor)  # transposed, a square root of the covariance
    prior, x = np.zeros(count), np.empty((count, 4))
    z = np.empty(4)
    for s in range(count):
        for i in range(4):
            z[i] = mode[i]
            for j in range(i, 4):
                z[i] += spread[j, i] * points[s, j]
            # prior density over that of the points
            prior[s] += 0.5 * (points[s, i] * points[s, i] - z[i] * z[i])
        for i in range(4):
            x[s, i] = mean[i]
            for j in range(i + 1):
                x[s, i] += root[i, j] * z[j]
    weight = log_likelihood(grid, readings, reduction, x) + prior
    top = weight.max()
    if not math.isfinite(weight.min()):
        return x, weight, np.nan, np.nan
    total = square = 0.0
    for s in range(count):
        weight[s] = math.exp(weight[s] - top)
        total += weight[s]
        square += weight[s] * weight[s]
    evidence = top + math.log(total / count)
    for i in range(4):
        evidence -= math.log(factor[i, i])
    for s in range(count):
        weight[s] /= total
    return x, weight, evidence, total * total / square / count


@lru_cache(maxsize=4)
def _points(count: int) -> Array:
    """Return (count, 4) standard normal points with mean zero and unit covariance exactly;
    read-only.
    """
    half = standard_normal(count // 2, 4)
    points = np.concatenate([half, -half])
    factor = np.linalg.cholesky(points.T @ points / len(points))
    points = np.ascontiguousarray(np.linalg.solve(factor, points.T).T)
    points.setflags(write=False)
    return points
