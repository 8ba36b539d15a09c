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
from isogal.matching.matrices import inverse
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.importance_sampling import Posterior
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.quasi_random import standard_normal


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
    root: Array = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    found = likelihood.mode(mean, root, CONSTANTS.newton_steps, CONSTANTS.newton_tolerance)
    if found is None:
        return None
    z, slope, precision, likelihood = found
    if not _linear_over_prior(likelihood, mean, root, z, slope):
        return None
    factor = np.linalg.cholesky(precision)
    spread = inverse(factor).T  # its square is the covariance
    points = _points(CONSTANTS.linear_points)
    in_prior = z + points @ spread.T
    x = mean + in_prior @ root.T
    exact = likelihood.log(x) - 0.5 * (in_prior**2).sum(axis=1)
    apart = exact + 0.5 * (points**2).sum(axis=1)
    top = float(apart.max())
    if not math.isfinite(float(apart.min())):
        return None
    weight = np.exp(apart - top)
    effective = float(weight.sum() ** 2 / (weight @ weight)) / len(weight)
    if effective < CONSTANTS.linear_effective_share:
        return None
    # prior density over that of the points
    evidence = top + math.log(float(weight.mean())) - float(np.log(np.diag(factor)).sum())
    weight /= weight.sum()
    centre = weight @ x
    off = x - centre
    mixture = Mixture.gaussian(centre, (off * weight[:, None]).T @ off)
    posterior = Posterior(mixture, evidence, effective, 1.0, 1, x, weight)
    return posterior, likelihood.with_nuisance_at(centre)


def _linear_over_prior(
    likelihood: BatchLikelihood, mean: Array, root: Array, mode: Array, slope: Array
) -> bool:
    """Whether residuals change as they should at a wrong place, on the axes of the prior and of
    its position: then there is one mode.
    """
    reach = CONSTANTS.linear_reach_sigma
    # the position's axes; velocity goes along as the prior has it
    axes = np.linalg.svd(root[:2])[2]
    places = np.concatenate([reach * axes, -reach * axes])
    residual = likelihood.reduced_many(mean + np.concatenate([mode[None], places]) @ root.T)
    if not np.isfinite(residual).all():
        return False
    expected = (places - mode) @ slope.T
    off = ((residual[1:] - residual[0] - expected) ** 2).sum(axis=1)
    allowed = CONSTANTS.linear_tolerance**2 * (1.0 + (expected**2).sum(axis=1))
    return bool((off < allowed).all())


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
