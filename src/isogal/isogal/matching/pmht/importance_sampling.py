"""Posterior of the navigator's error by annealed importance sampling with a mixture proposal.

Each round draws a fixed set of quasi-random points from the proposal, weighs them with prior times
likelihood^beta over proposal, and refits the proposal to them; beta is the largest that leaves a
given effective sample size and reaches 1 within a few rounds (adaptive multiple importance
sampling with tempering; Cappé et al. 2008, Stat. Comput. 18:447; Chopin & Papaspiliopoulos 2020,
ch. 17). Moments come from the last round, at beta = 1, so they are those of the exact posterior up
to sampling error, Gaussian or not. The points are the same at every call: the result is a
deterministic function of prior and likelihood.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, Self, TypeVar

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.matching.pmht.clustering import fit
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.quasi_random import normal, sobol

DIMENSIONS = 4


@dataclass(frozen=True, slots=True)
class Sampling:
    """Settings of the sampler."""

    samples: int = 1024
    """Points a round."""
    first: int = 1
    """Times as many in the first round: what that overlooks the others do not find."""
    tempering: float = 0.12
    """Effective sample size, as a share of the points, that beta is chosen for."""
    accept: float = 0.35
    """Effective sample size at beta = 1 that ends the rounds."""
    rounds: int = 12
    """At most."""
    hypotheses: int = 6
    """Mixture components at most."""
    inflation: float = 1.2
    """Covariance of the proposal over that of the samples: heavier tails than the target's."""


@dataclass(frozen=True, slots=True, eq=False)
class Posterior:
    """What the sampler found."""

    mixture: Mixture
    """A Gaussian for each well separated hypothesis, heaviest first."""
    log_evidence: float
    """Log of the mean likelihood under the prior (without the likelihood's own constant)."""
    effective: float
    """Effective sample size of the last round, as a share of its points."""
    beta: float
    """Temper reached; below 1 the posterior is not resolved."""
    rounds: int
    samples: Array
    """(S, 4) of the last round."""
    weight: Array
    """(S,) sums to 1."""


@lru_cache(maxsize=8)
def _points(count: int) -> Array:
    """Return (count, 1 + 4) fixed quasi-random points: one uniform coordinate, four standard
    normal ones.
    """
    points = sobol(count, 1 + DIMENSIONS, 20230101)
    points[:, 1:] = normal(points[:, 1:])
    points.setflags(write=False)
    return points


class Likelihood(Protocol):
    """What the sampler needs of a likelihood."""

    def log(self, xi: Array) -> Array:
        """(S, 4) -> (S,); -inf where impossible."""
        ...

    def with_nuisance_at(self, xi: Array) -> Self:
        """Return the likelihood with its small linearised part taken at xi (4,)."""
        ...


L = TypeVar("L", bound=Likelihood)


def sample(
    likelihood: L, prior: Mixture, settings: Sampling, proposal: Mixture | None = None
) -> tuple[Posterior | None, L]:
    """Return the posterior of x (4,) under a mixture prior, and the likelihood linearised at its
    mean.

    None instead of a posterior where no sample has any likelihood.

    Parameters
    ----------
    likelihood : Likelihood
    prior : Mixture
    settings : Sampling
    proposal : Mixture, optional
        Where to look; the evidence is then that of these places alone. Default: everywhere the
        prior allows.
    """
    floor = 1e-4 * np.sqrt(np.diag(prior.moments()[1]))
    # a place of little weight may turn out to be the one
    start = current = (prior if proposal is None else proposal).levelled()
    result: Posterior | None = None
    for number in range(1, settings.rounds + 1):
        # a share of the first proposal bounds the weights of what the refitted mixture may have
        # lost
        wide = current if number == 1 else _blend(current.widened(settings.inflation), start, 0.03)
        x = wide.draw(_points(settings.samples * (settings.first if number == 1 else 1)))
        values = likelihood.log(x)
        base = prior.log_density(x) - wide.log_density(x)
        beta, weight, effective, log_mean = _temper(values, base, settings.tempering)
        if math.isnan(effective):
            return result, likelihood
        mixture, _ = fit(x, weight, settings.hypotheses, floor if beta < 1.0 else 1e-2 * floor)
        result = Posterior(mixture, log_mean, effective, beta, number, x, weight)
        if beta == 1.0 and effective >= settings.accept and number > 1:
            break
        current = mixture
        likelihood = likelihood.with_nuisance_at(mixture.mean[0])
    return result, likelihood


def _blend(main: Mixture, other: Mixture, share: float) -> Mixture:
    return Mixture(
        np.concatenate([(1.0 - share) * main.weight, share * other.weight]),
        np.concatenate([main.mean, other.mean]),
        np.concatenate([main.covariance, other.covariance]),
    )


@kernel
def _weigh(likelihood, base, beta, weight):  # type: ignore[no-untyped-def]
    """Write normalised weights; return (effective share of the samples, log of the mean
    weight).
    """
    count = likelihood.shape[0]
    largest = -np.inf
    for s in range(count):
        if likelihood[s] > -np.inf:
            largest = max(largest, beta * likelihood[s] + base[s])
    if not math.isfinite(largest):
        return math.nan, -np.inf
    total = square = 0.0
    for s in range(count):
        w = math.exp(beta * likelihood[s] + base[s] - largest) if likelihood[s] > -np.inf else 0.0
        weight[s] = w
        total += w
        square += w * w
    for s in range(count):
        weight[s] /= total
    return total * total / square / count, largest + math.log(total / count)


@kernel
def _temper(likelihood, base, target):  # type: ignore[no-untyped-def]
    """Return the largest beta <= 1 that leaves the target effective share, with weights, share and
    log mean weight there.
    """
    weight = np.empty(likelihood.shape[0])
    effective, log_mean = _weigh(likelihood, base, 1.0, weight)
    if not effective < target:  # also NaN: no sample is possible
        return 1.0, weight, effective, log_mean
    low, high = 0.0, 1.0
    for _ in range(18):
        middle = math.sqrt(low * high) if low > 0.0 else 0.1 * high
        effective, log_mean = _weigh(likelihood, base, middle, weight)
        if effective < target:
            high = middle
        else:
            low = middle
    effective, log_mean = _weigh(likelihood, base, low, weight)
    return low, weight, effective, log_mean
