"""A batch on its way through `pmht`: one immutable state that every stage takes and returns."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

from isogal.arrays import Array, Booleans
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.matching.chi_square import survival
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.attitude import with_attitude
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.hypotheses import Update, update
from isogal.matching.pmht.importance_sampling import Sampling
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.map_error import MapErrorEstimate
from isogal.matching.pmht.memory import Memory
from isogal.matching.pmht.noise_model import NoiseModel
from isogal.matching.pmht.sensor_bias import BiasEstimate, LinearBias
from isogal.matching.pmht.settings import Settings
from isogal.matrices import inverse


@dataclass(frozen=True, slots=True)
class ChiSquare:
    """A sum of squared normalised residuals."""

    value: float
    freedom: float

    @property
    def p_value(self) -> float:
        """Probability of a larger one if the model is right."""
        return survival(self.value, self.freedom)

    @property
    def ratio(self) -> float:
        """Per degree of freedom."""
        return self.value / self.freedom

    def rejects(self, settings: Settings) -> bool:
        """Whether it is too unlikely, and larger than any wrong noise model would make it."""
        options = settings.options
        return self.p_value < options.significance and self.ratio > options.tolerance


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What becomes of a batch, and why."""

    reason: str | None = None
    """None = its fix is published; else one line."""
    hypotheses: Mixture | None = None
    """That go on to the next batch where there is no fix; None = the navigator's own prior."""
    residual: ChiSquare | None = None
    """Of the new readings, for the variance factor; None = the batch says nothing about it."""
    unexplained: bool = False
    """Whether readings and map do not agree, and nothing explains it."""
    lost: bool = False
    """Whether the navigator's own covariance cannot be right: it is widened, and searched for."""
    biased: bool = False
    """Whether a bias of the readings explains them: the batch is matched once more, with it."""
    bias: BiasEstimate | None = None
    """What is believed of that bias from now on; of a lost navigator too, None = nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class State:
    """See the module. `posterior` is None where no hypothesis lies on the map."""

    batch: Batch
    """Without earlier outliers, and with the readings' bias among its nuisance parameters."""
    as_read: Batch
    """The same without what is believed of their bias."""
    field_map: AnyMap
    settings: Settings
    memory: Memory | None
    """Before the batch; None = it is the first."""
    prior: Mixture
    """Of the navigator's error xi at the batch end."""
    noise: NoiseModel
    bias: LinearBias | None
    """Of the readings, at the batch end."""
    map_error: MapErrorEstimate | None
    """Before the batch; None = it is not in question."""
    likelihood: BatchLikelihood
    """Of all readings, outliers included."""
    outlier: Booleans
    """(T,) rows of the likelihood that are left out."""
    posterior: Update | None = None
    learnt: MapErrorEstimate | None = None
    """`map_error` after the batch."""
    agrees: bool = True
    """Whether readings and prior agree with the map at the best hypothesis."""
    log_evidence: float = 0.0
    """Of the batch, as it was updated; outliers included."""
    variance_factor: float = 1.0
    """Of R, from earlier batches."""
    verdict: Verdict | None = None

    @property
    def best(self) -> Update:
        """The posterior, where there is one."""
        assert self.posterior is not None
        return self.posterior

    @property
    def first_map(self) -> FieldMap:
        """The map, or that of the first channel."""
        return channels_of(self.field_map)[0]

    @property
    def outlier_times(self) -> frozenset[float]:
        """Stamps of the outliers."""
        return frozenset(float(t) for t in self.batch.time[self.likelihood.rows[self.outlier]])

    def decided(self, verdict: Verdict) -> "State":
        """Return the state with a verdict, which ends its way."""
        return replace(self, verdict=verdict)

    def with_attitude(self) -> tuple[Array, Array, Array]:
        """Return posterior mean (n,), covariance and prior (n, n) at the best hypothesis; n = 7
        where the batch knows the attitude, else 4 (`attitude.with_attitude`).
        """
        best = self.best
        mean, covariance = best.mixture.mean[0], best.mixture.covariance[0]
        return with_attitude(self.batch, best.likelihood, mean, covariance)

    def consistency(self) -> ChiSquare:
        """Return the chi-square of the new readings at the best hypothesis.

        The posterior mean has absorbed as many degrees of freedom as it has gained on the prior,
        n - tr(1 - posterior prior⁻¹) (docs/mathematics.md, section 8.3).
        """
        left = float((inverse(self.batch.prior) * self.best.mixture.covariance[0]).sum())
        absorbed = min(max(4.0 - left, 0.0), 4.0)
        return ChiSquare(self.best.misfit, max(self.best.likelihood.new_count - absorbed, 1.0))

    def agreement(self) -> ChiSquare:
        """Return the chi-square of the new readings and the prior together.

        What a wrong place or a bias does to the readings goes where it can: into the residuals,
        or into a posterior far from the prior.
        """
        return _agreement(self.best, self.prior)


@lru_cache(maxsize=4)  # several ask it of the same posterior
def _agreement(best: Update, prior: Mixture) -> ChiSquare:
    tension = float(prior.distances(best.mixture.mean[0]).min())
    return ChiSquare(best.misfit + tension, float(max(best.likelihood.new_count, 1)))


def likelihood_of(
    batch: Batch,
    field_map: AnyMap,
    noise: NoiseModel,
    place: Mixture,
    variance_factor: float = 1.0,
) -> BatchLikelihood:
    """Return the likelihood of a batch believed to be at a place, with R times a factor."""
    likelihood = BatchLikelihood.of(batch, field_map, noise, place=place.moments())
    return likelihood.scaled(variance_factor) if variance_factor > 1.0 else likelihood


def rematch(
    state: State,
    *,
    noise: NoiseModel | None = None,
    place: Mixture | None = None,
    outlier: Booleans | None = None,
    prior: Mixture | None = None,
    inflation: float = 1.0,
    bias: LinearBias | None = None,
) -> State:
    """Match a batch under other assumptions than the state's; the only place that does.

    Parameters
    ----------
    noise : NoiseModel, optional
        Learnt from this batch, so the variance factor of earlier ones no longer applies.
    place : Mixture, optional
        Where the readings are believed to be, for a map error that differs from place to place.
    outlier : (T,) array of bool, optional
        Rows of the likelihood that are left out.
    prior : Mixture, optional
        Of xi.
    inflation : float
        Of R, for this match alone.
    bias : LinearBias, optional
        Of the readings, where the state has none; for this match alone.

    Returns
    -------
    State
        With likelihood, outliers and posterior of these assumptions. The posterior is None where
        no hypothesis lies on the map.
    """
    every = state.likelihood
    if noise is not None or place is not None:
        factor = state.variance_factor if noise is None else 1.0
        where = state.best.mixture if place is None else place
        every = likelihood_of(
            state.batch, state.field_map, state.noise if noise is None else noise, where, factor
        )
    outlier = state.outlier if outlier is None else outlier
    used = every.without(outlier)
    if inflation != 1.0:
        used = used.scaled(inflation)
    if bias is not None:
        used = used.with_nuisance_of(bias.added_to(state.batch))
    posterior = update(
        used,
        state.prior if prior is None else prior,
        Sampling(samples=state.settings.options.samples),
        state.settings.options.hypotheses,
    )
    return replace(state, likelihood=every, outlier=outlier, posterior=posterior)


def or_before(after: State, before: State) -> State:
    """Return the state after a match, with the posterior of the one before where there is none."""
    return after if after.posterior is not None else replace(after, posterior=before.posterior)


def evidence(posterior: Update | None) -> float:
    """Return the log evidence with the likelihood's constant, so that noise models compare; -inf
    where no hypothesis lies on the map.
    """
    if posterior is None:
        return -math.inf
    return posterior.log_evidence + posterior.likelihood.log_normaliser
