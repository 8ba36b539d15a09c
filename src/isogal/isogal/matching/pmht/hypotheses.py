"""Update of several hypotheses about the navigator's error by one batch.

Each hypothesis is a Gaussian prior of its own: the batch gives it a posterior, perhaps in several
pieces, and its evidence; weights go with evidence, negligible pieces are dropped, pieces that have
come to the same place are joined. Hypotheses that overlap are one prior; those that do not are
never sampled together, since a sampler does not come across a light one far from the others.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Integers
from isogal.matching.pmht.acquisition import acquire, search_share
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture, largest_sigma, overlapping
from isogal.matching.pmht.importance_sampling import Posterior, Sampling, sample
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.nearly_linear import nearly_linear
from isogal.matching.quasi_random import standard_normal


@dataclass(frozen=True, slots=True, eq=False)
class Update:
    """What a batch makes of the hypotheses."""

    mixture: Mixture
    """Heaviest first."""
    log_evidence: float
    """Of the batch, without the likelihood's own constant."""
    likelihood: BatchLikelihood
    """Linearised at the heaviest hypothesis."""
    misfit: float
    """Chi-square of the new readings there; of a place known to a cell only, with what the map may
    change within it."""
    resolved: bool
    """Whether the heaviest hypothesis was sampled at full likelihood with enough samples."""
    effective: float
    """Effective share of the samples of the heaviest hypothesis."""
    rounds: int
    drawn: tuple[Array, Array] | None = None
    """(S, 4) samples of the posterior and (S,) their weights, where all hypotheses were sampled
    together."""


def update(
    likelihood: BatchLikelihood, prior: Mixture, sampling: Sampling, most: int
) -> Update | None:
    """Return the posterior of all hypotheses, or None where none of them lies on the map.

    Parameters
    ----------
    prior : Mixture
    sampling : Sampling
        For a single hypothesis; many share the points.
    most : int
        Hypotheses at most.
    """
    groups = _groups(prior)
    pieces: list[_Piece] = []
    if len(groups) > CONSTANTS.sampled_hypotheses:
        prior, pieces = _screened(likelihood, prior)
        groups = _groups(prior)
    samples = _points(sampling.samples, len(groups))
    share = sampling if samples == sampling.samples else replace(sampling, samples=samples)
    effort, later = _Effort(likelihood), []
    for group in groups:
        if effort.spent:
            later.append(group)
        else:
            pieces += _update_group(likelihood, prior.part(group), share, most, effort)
    if later:
        pieces += _screened(likelihood, prior.part(np.concatenate(later)), 0)[1]
    return _joined(pieces, most) if pieces else None


class _Effort:
    """What an update has taken so far, by the readings looked up in the map. Once it is too much
    the hypotheses that are left, the least likely ones, are told apart by a few points each: the
    next batches may bring them forward."""

    def __init__(self, likelihood: BatchLikelihood) -> None:
        self._rows = len(likelihood.rows)
        new = likelihood.new_count
        self._round = new * new // CONSTANTS.readings_squared_of_point
        self._left = search_share(likelihood) * CONSTANTS.update_look_ups

    @property
    def spent(self) -> bool:
        """Whether it is too much."""
        return self._left < 0.0

    def add(self, points: int, rounds: int = 1) -> None:
        """Take note of rounds with so many points each."""
        self._left -= rounds * (points + self._round) * self._rows

    def sample(
        self, likelihood: BatchLikelihood, prior: Mixture, sampling: Sampling, *proposal: Mixture
    ) -> tuple[Posterior | None, BatchLikelihood]:
        """Return what `importance_sampling.sample` does."""
        result = sample(likelihood, prior, sampling, *proposal)
        rounds = 1 if result[0] is None else result[0].rounds
        self.add(sampling.samples, rounds + sampling.first - 1)
        return result


def _update_group(
    likelihood: BatchLikelihood, prior: Mixture, sampling: Sampling, most: int, effort: _Effort
) -> list["_Piece"]:
    """Return what the batch makes of hypotheses that overlap, whose weights need not add up to
    1.
    """
    total = float(prior.weight.sum())
    if len(prior) > 1 and total > 0.0:
        own = replace(prior, weight=prior.weight / total)
        if largest_sigma(own.moments()[1]) < CONSTANTS.very_wide_prior_m:
            # as one prior, whose posterior is split again only where it has separate modes
            posterior, linearised = effort.sample(
                likelihood,
                own,
                replace(sampling, samples=CONSTANTS.more_samples * sampling.samples),
            )
            if posterior is not None and _resolved(posterior):
                joint = _piece(posterior, linearised)
                return [replace(joint, log_weight=joint.log_weight + math.log(total))]
    pieces: list[_Piece] = []
    if len(prior) > CONSTANTS.sampled_hypotheses:
        prior, pieces = _screened(likelihood, prior)
    share = replace(sampling, samples=_points(sampling.samples, len(prior)))
    for k, weight in enumerate(prior.weight):
        if effort.spent:
            left = prior.part(np.arange(k, len(prior)))
            return [*pieces, *_screened(likelihood, left, 0)[1]]
        if weight > 0.0:
            one = prior.mean[k], prior.covariance[k]
            piece = _update_one(likelihood, *one, share, most, effort)
            if piece is not None:
                pieces.append(replace(piece, log_weight=piece.log_weight + math.log(weight)))
    return pieces


def _groups(prior: Mixture) -> list[Integers]:
    """Return the indices of hypotheses that overlap, in one chain or another: tiles of one ridge,
    pieces of one peak.

    Two overlap where the sampler would not call them separate modes (`clustering`) along
    the line between them.
    """
    if len(prior) == 1:
        return [np.arange(1)]
    group = overlapping(prior.mean, prior.covariance, CONSTANTS.mode_separation)
    return [np.flatnonzero(group == number) for number in range(int(group.max()) + 1)]


def _merged(tiles: Mixture) -> Mixture:
    """Return a Gaussian for each group: one about all would overlook places far away that are less
    likely.
    """
    weight, mean, covariance = [], [], []
    for group in _groups(tiles):
        part = tiles.part(group)
        weight.append(float(part.weight.sum()))
        centre, spread = replace(part, weight=part.weight / weight[-1]).moments()
        mean.append(centre)
        covariance.append(spread)
    return Mixture(np.array(weight), np.array(mean), np.array(covariance))


def _screened(
    likelihood: BatchLikelihood, prior: Mixture, most: int = CONSTANTS.sampled_hypotheses
) -> tuple[Mixture, list["_Piece"]]:
    """Return the most likely of many hypotheses, by a few points of each, so many at most, and
    what the points make of the others.

    A posterior of few points is taken to be as wide as their effective number can vouch for: with
    one, as wide as the prior.
    """
    count = int(search_share(likelihood) * CONSTANTS.screening_samples)
    points = standard_normal(count, prior.mean.shape[1])
    x = prior.mean[:, None] + points @ np.linalg.cholesky(prior.covariance).transpose(0, 2, 1)
    value = likelihood.log(x.reshape(-1, x.shape[-1])).reshape(x.shape[:2])
    top = value.max(axis=1)
    alive = np.flatnonzero(np.isfinite(top) & (prior.weight > 0.0))
    weight = np.exp(value[alive] - top[alive, None])
    log_weight = top[alive] + np.log(weight.mean(axis=1)) + np.log(prior.weight[alive])
    order = np.argsort(-log_weight, kind="stable")
    possible = order[
        log_weight[order]
        > log_weight.max(initial=-np.inf)
        + math.log(CONSTANTS.negligible_weight)
        - CONSTANTS.screening_slack_log_evidence
    ]
    likely, others = alive[possible[:most]], possible[most:]
    chosen = Mixture(prior.weight[likely], prior.mean[likely], prior.covariance[likely])
    if not others.size:
        return chosen, []
    w = weight[others] / weight[others].sum(axis=1, keepdims=True)
    mean = np.einsum("ks,ksi->ki", w, x[alive[others]])
    apart = x[alive[others]] - mean[:, None]
    few = np.minimum(1.0, 5.0 * (w**2).sum(axis=1))[:, None, None]
    covariance = (
        np.einsum("ks,ksi,ksj->kij", w, apart, apart) * (1.0 - few)
        + few * prior.covariance[alive[others]]
    )
    height = log_weight[others].max()
    shares = np.exp(log_weight[others] - height)
    mixture = Mixture(shares / shares.sum(), mean, covariance)
    misfit = -2.0 * float(top[alive[others]].max())
    return chosen, [
        _Piece(
            height + math.log(float(shares.sum())),
            mixture,
            likelihood,
            misfit,
            1.0,
            CONSTANTS.screening_samples,
            0,
        )
    ]


def _joined(pieces: list["_Piece"], most: int) -> Update:
    heights = np.array([piece.log_weight for piece in pieces])
    top = float(heights.max())
    shares = np.exp(heights - top)
    best = max(
        pieces, key=lambda piece: (piece.samples > CONSTANTS.screening_samples, piece.log_weight)
    )
    return Update(
        mixture=Mixture.join([piece.mixture for piece in pieces], shares / shares.sum()).pruned(
            CONSTANTS.negligible_weight, most
        ),
        log_evidence=top + math.log(float(shares.sum())),
        likelihood=best.likelihood,
        misfit=best.misfit,
        resolved=best.effective * best.samples >= CONSTANTS.least_effective_samples,
        effective=best.effective,
        rounds=best.rounds,
        drawn=best.drawn if len(pieces) == 1 else None,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Piece:
    """Posterior of one hypothesis."""

    log_weight: float
    mixture: Mixture
    likelihood: BatchLikelihood
    misfit: float
    effective: float
    samples: int
    rounds: int
    drawn: tuple[Array, Array] | None = None


def _update_one(
    likelihood: BatchLikelihood,
    mean: Array,
    covariance: Array,
    sampling: Sampling,
    most: int,
    effort: _Effort,
) -> _Piece | None:
    prior = Mixture.gaussian(mean, covariance)
    sigma = largest_sigma(covariance)
    if sigma <= CONSTANTS.linear_prior_m:
        least, _ = CONSTANTS.carried_shape_m
        linear = nearly_linear(likelihood, mean, covariance)
        effort.add(CONSTANTS.linear_points)
        # of a wider one the shape is carried on, for which it takes more points
        if linear is not None and largest_sigma(linear[0].mixture.covariance[0]) < least:
            return replace(_piece(*linear), drawn=None)
    wide = (
        replace(sampling, samples=CONSTANTS.more_samples * sampling.samples)
        if sigma > CONSTANTS.wide_prior_m
        else sampling
    )
    if sigma <= CONSTANTS.search_prior_m:
        very_wide = (
            replace(wide, first=CONSTANTS.more_samples)
            if sigma > CONSTANTS.very_wide_prior_m
            else wide
        )
        posterior, linearised = effort.sample(likelihood, prior, very_wide)
        if posterior is None or _resolved(posterior):
            return None if posterior is None else _piece(posterior, linearised)
    found = acquire(likelihood, mean, covariance, most)
    if found is None:
        return None
    tiles, evidence, misfit, asked = found
    effort.add(asked)
    if largest_sigma(tiles.moments()[1]) < CONSTANTS.search_prior_m:
        posterior, linearised = effort.sample(likelihood, prior, wide, _merged(tiles))
        if posterior is not None and _resolved(posterior):
            return _piece(posterior, linearised)
    return _Piece(
        evidence,
        tiles,
        likelihood.with_nuisance_at(tiles.mean[0]),
        misfit,
        1.0,
        sampling.samples,
        0,
    )


def _resolved(posterior: Posterior) -> bool:
    return (
        posterior.beta == 1.0
        and posterior.effective * len(posterior.weight) >= CONSTANTS.least_effective_samples
    )


def _piece(posterior: Posterior, likelihood: BatchLikelihood) -> _Piece:
    return _Piece(
        posterior.log_evidence,
        posterior.mixture,
        likelihood,
        likelihood.misfit(posterior.mixture.mean[0]),
        posterior.effective,
        len(posterior.weight),
        posterior.rounds,
        (posterior.samples, posterior.weight),
    )


def _points(samples: int, jobs: int) -> int:
    """Share the points among jobs: a power of two, as the quasi-random sequence likes it."""
    return max(
        CONSTANTS.fewest_samples,
        min(
            samples, 2 ** int(math.log2(max(CONSTANTS.more_samples * samples // max(jobs, 1), 1)))
        ),
    )
