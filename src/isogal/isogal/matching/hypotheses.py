"""Update of several hypotheses about the navigator's error by one batch.

Each hypothesis is a Gaussian prior of its own: the batch gives it a posterior, perhaps in several pieces, and its evidence; weights go with
evidence, negligible pieces are dropped, pieces that have come to the same place are joined.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from isogal.matching.acquisition import acquire
from isogal.matching.likelihood import BatchLikelihood
from isogal.matching.mixture import Mixture
from isogal.matching.sampler import Posterior, Sampling, sample

Array = NDArray[np.float64]

WIDE = 600.0
"""m, 1-sigma of a prior beyond which it is given four times the points."""
SEARCH = 3000.0
"""m, 1-sigma beyond which a prior is searched on a grid at once, not only where sampling it has failed."""
NEGLIGIBLE = 1e-6
"""A hypothesis of less weight is dropped."""


@dataclass(frozen=True, slots=True, eq=False)
class Update:
    """What a batch makes of the hypotheses."""

    belief: Mixture
    """Heaviest first."""
    log_evidence: float
    """Of the batch, without the likelihood's own constant."""
    likelihood: BatchLikelihood
    """Linearised at the heaviest hypothesis."""
    resolved: bool
    """Whether the heaviest hypothesis was sampled at full likelihood with enough samples."""
    effective: float
    """Effective share of the samples of the heaviest hypothesis."""
    rounds: int


def update(likelihood: BatchLikelihood, prior: Mixture, sampling: Sampling, most: int) -> Update | None:
    """Return the posterior of all hypotheses, or None where none of them lies on the map.

    Parameters
    ----------
    prior : Mixture
    sampling : Sampling
        For a single hypothesis; many share the points.
    most : int
        Hypotheses at most.
    """
    pieces: list[_Piece] = []
    share = replace(sampling, samples=_points(sampling.samples, len(prior)))
    for weight, mean, covariance in zip(prior.weight, prior.mean, prior.covariance, strict=True):
        if weight > 0.0:
            piece = _update_one(likelihood, mean, covariance, share, most)
            if piece is not None:
                pieces.append(replace(piece, log_weight=piece.log_weight + math.log(weight)))
    if not pieces:
        return None
    heights = np.array([piece.log_weight for piece in pieces])
    top = float(heights.max())
    shares = np.exp(heights - top)
    best = pieces[int(np.argmax(heights))]
    return Update(
        belief=Mixture.join([piece.belief for piece in pieces], shares / shares.sum()).pruned(NEGLIGIBLE, most),
        log_evidence=top + math.log(float(shares.sum())),
        likelihood=best.likelihood,
        resolved=best.effective * best.samples >= 20.0,
        effective=best.effective,
        rounds=best.rounds,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Posterior of one hypothesis."""

    log_weight: float
    belief: Mixture
    likelihood: BatchLikelihood
    effective: float
    samples: int
    rounds: int


def _update_one(
    likelihood: BatchLikelihood, mean: Array, covariance: Array, sampling: Sampling, most: int
) -> _Piece | None:
    prior = Mixture.gaussian(mean, covariance)
    sigma = _largest_sigma(covariance)
    if sigma > WIDE:
        sampling = replace(sampling, samples=4 * sampling.samples)
    if sigma <= SEARCH:
        posterior, linearised = sample(likelihood, prior, sampling)
        if posterior is None or _resolved(posterior):
            return None if posterior is None else _piece(posterior, linearised)
    found = acquire(likelihood, mean, covariance, most)
    if found is None:
        return None
    tiles, evidence = found
    centre, spread = tiles.moments()
    if _largest_sigma(spread) < SEARCH:
        posterior, linearised = sample(likelihood, prior, sampling, Mixture.gaussian(centre, spread))
        if posterior is not None and _resolved(posterior):
            return _piece(posterior, linearised)
    return _Piece(evidence, tiles, likelihood.with_drift_at(tiles.mean[0]), 1.0, sampling.samples, 0)


def _resolved(posterior: Posterior) -> bool:
    return posterior.beta == 1.0 and posterior.effective * len(posterior.weight) >= 20.0


def _piece(posterior: Posterior, likelihood: BatchLikelihood) -> _Piece:
    return _Piece(
        posterior.log_evidence,
        posterior.mixture,
        likelihood,
        posterior.effective,
        len(posterior.weight),
        posterior.rounds,
    )


def _largest_sigma(covariance: Array) -> float:
    return math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))


def _points(samples: int, jobs: int) -> int:
    """Share the points among jobs: a power of two, as the quasi-random sequence likes it."""
    return max(128, min(samples, 2 ** int(math.log2(max(4 * samples // jobs, 1)))))
