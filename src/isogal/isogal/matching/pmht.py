"""`pmht`: probabilistic multi-hypothesis map matching with an exact batch likelihood; the default matcher.

It keeps the paper's idea, a batch of scans matched at once by probabilities over many hypotheses under the kinematic constraint, and
replaces what made it inexact:

- the kinematic constraint is the navigator's own track: the unknown is its error at the batch end (position and velocity), and what
  tilt and heading add within the batch is integrated out (`batching`, `likelihood`);
- the likelihood carries the map's error with its correlation along the track, an unknown bias and the map's rounding (`likelihood`);
- the posterior's moments come from annealed importance sampling, so they are right where it is not Gaussian (`sampler`);
- separate hypotheses stay separate: an ambiguous batch publishes nothing, its hypotheses go on to the next batch and are dropped by
  evidence (`hypotheses`);
- readings that stick out are left out, and a batch that does not agree with the map gives no fix (`screening`);
- a wide prior is searched on a grid (`acquisition`); a navigator whose own covariance cannot be right is searched for over tens of km
  and told so (`Fix.reset`);
- what is published is the information of the measurements alone (`information`).
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.channels import ChannelMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.variability import feature_variability
from isogal.matching.chi_square import survival
from isogal.matching.contours import contour_candidates
from isogal.matching.hypotheses import Update, update
from isogal.matching.information import likelihood_information, measurement_only
from isogal.matching.interfaces import LOST_SIGMA, Batch, Fix, declined
from isogal.matching.likelihood import BatchLikelihood, NoiseModel, uneven
from isogal.matching.local import unusable
from isogal.matching.mixture import Mixture
from isogal.matching.noise_estimation import NoiseEstimate
from isogal.matching.registry import check_options
from isogal.matching.sampler import Sampling
from isogal.matching.screening import outliers, smooth_misfit
from isogal.matching.vector import first_channel
from isogal.scenario import Matcher as MatcherSettings

Array = NDArray[np.float64]

_EXPLAINED = 4.0
"""Variance factor that a noise model wrong by two in sigma explains."""
_FAR_BETTER = 8.0
"""Log evidence by which a place elsewhere must beat the best one near the navigator: the wide prior itself already counts against it."""


class Settings(BaseModel):
    """Options of `pmht` (`matcher.options` of a scenario)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    context: int | None = Field(
        None, ge=0, description="older scans whose residuals predict the map error; null = batch_length"
    )
    samples: int = Field(512, ge=64, le=65536, description="points per round of the sampler")
    hypotheses: int = Field(256, ge=1, le=1000, description="hypotheses kept at most")
    confidence: float = Field(
        0.999, gt=0.5, lt=1.0, description="probability a hypothesis needs before it is published"
    )
    outlier_gate: float = Field(4.5, gt=0.0, description="1-sigma beyond which a reading is left out")
    significance: float = Field(1e-4, gt=0.0, lt=0.5, description="p-value under which a batch counts as inconsistent")
    tolerance: float = Field(2.0, ge=1.0, description="misfit per degree of freedom that is never called inconsistent")
    largest_misfit: float = Field(
        9.0, gt=1.0, description="misfit per degree of freedom above which no fix is published"
    )


@dataclass(frozen=True, slots=True)
class Scale:
    """Variance of unit weight over the last batches, held at 1 by a prior until the residuals clearly say more."""

    misfit: float = 60.0
    freedom: float = 60.0

    @property
    def factor(self) -> float:
        """Variance to multiply R by, >= 1."""
        ratio = self.misfit / self.freedom
        return ratio if ratio > 1.0 + 4.0 * math.sqrt(2.0 / self.freedom) else 1.0

    def seen(self, misfit: float, freedom: float) -> "Scale":
        """Add the chi-square of a batch, forgetting over some ten batches."""
        return Scale(0.9 * self.misfit + misfit, 0.9 * self.freedom + freedom)


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What one run's matcher knows from its earlier batches."""

    time: float
    prior: Array
    """(4, 4) the navigator's covariance at that time, after the fix if one was published."""
    belief: Mixture | None
    """Hypotheses about the navigator's error at that time; None = the navigator's own prior is all there is."""
    suspicion: int = 0
    """Inconsistent batches in a row."""
    excluded: frozenset[float] = frozenset()
    """Stamps of readings left out."""
    noise: NoiseEstimate | None = None
    """Running estimate of the map's error, where it is not given."""
    scale: Scale = Scale()
    """Running estimate of how much larger the residuals' variance is than assumed."""


@dataclass(frozen=True)
class Pmht:
    """The default matcher. See the module; settings in `Settings`."""

    noise: NoiseModel
    adaptive: bool
    settings: Settings = field(default_factory=Settings)
    context: int = 30
    name: str = "pmht"

    @classmethod
    def from_settings(cls, matcher: MatcherSettings) -> "Pmht":
        """Build it from a scenario's matcher section; raises InputError on an unknown or bad option."""
        settings: Settings = check_options("pmht", matcher.options, Settings)
        adaptive = matcher.map_sigma == "auto"
        noise = NoiseModel(
            map_sigma=0.0 if matcher.map_sigma == "auto" else float(matcher.map_sigma),
            correlation_length=matcher.map_correlation_length,
            bias_sigma=matcher.bias_sigma,
        )
        context = matcher.batch_length if settings.context is None else settings.context
        return cls(noise, adaptive, settings, context)

    def match(self, batch: Batch, field_map: FieldMap | ChannelMap, memory: Memory | None) -> tuple[Fix, Memory | None]:
        """Match one batch; see `interfaces.Matcher`. Vector readings (`vector`) come with a map of several channels."""
        if reason := unusable(batch) or self._cannot(batch, field_map):
            return declined(batch, reason), memory
        excluded = memory.excluded if memory else frozenset()
        batch = _without(batch, excluded)
        estimate = (
            (memory.noise if memory and memory.noise else NoiseEstimate.start(batch, channels_of(field_map)[0]))
            if self.adaptive
            else None
        )
        noise = self.noise if estimate is None else estimate.model(self.noise)
        prior = self._prior(batch, memory)
        if np.isfinite(batch.reading[-batch.new :]).sum() < 3:
            return self._decline(batch, "fewer than three readings in the batch", memory, prior)

        scale = memory.scale.factor if memory else 1.0
        every = _likelihood(batch, field_map, noise, prior, scale)
        bad = _spikes(every, prior, self.settings.outlier_gate + 2.0)
        result = self._update(every.without(bad), prior)
        if result is None:
            return self._decline(batch, "the search area lies outside the map", memory, prior)
        if uneven(field_map):  # now that the place is known, so is how wrong the map is there
            every = _likelihood(batch, field_map, noise, result.belief, scale)
            result = self._update(every.without(bad), prior) or result
        misfits = _misfits(
            every, result.belief, self.settings.outlier_gate
        )  # with everybody in, now that the place is known
        if not np.array_equal(bad, misfits):
            bad = misfits
            result = self._update(every.without(bad), prior) or result
        if estimate is not None:
            updated = estimate.update(
                batch, result.likelihood, channels_of(field_map)[0], result.belief.mean[0], self.noise.bias_sigma
            )
            if estimate.differs(updated):
                every = _likelihood(batch, field_map, updated.model(self.noise), result.belief)
                result = self._update(every.without(bad), prior) or result
            estimate = updated
        keep = Memory(
            time=float(batch.time[-1]),
            prior=batch.prior,
            belief=result.belief,
            suspicion=memory.suspicion if memory else 0,
            excluded=frozenset(t for t in excluded if t >= batch.time[0]),
            noise=estimate,
            scale=memory.scale if memory else Scale(),
        )
        sticking_out = frozenset(float(t) for t in batch.time[every.rows[bad]])
        return self._decide(batch, field_map, result, every, prior, keep, sticking_out)

    def _cannot(self, batch: Batch, field_map: FieldMap | ChannelMap) -> str | None:
        """Why a batch of several channels cannot be matched, in one line."""
        channels = 1 if batch.channel is None else int(batch.channel.max()) + 1
        if channels > len(channels_of(field_map)):
            return f"the readings have {channels} channels, the map {len(channels_of(field_map))}"
        if self.adaptive and channels > 1:
            return "the map error of several channels is not estimated; give map_sigma"
        return None

    def _update(self, likelihood: BatchLikelihood, prior: Mixture) -> Update | None:
        return update(likelihood, prior, Sampling(samples=self.settings.samples), self.settings.hypotheses)

    @staticmethod
    def _prior(batch: Batch, memory: Memory | None) -> Mixture:
        """Return the belief about xi before the batch: carried hypotheses moved to the batch end, or the navigator's own prior."""
        if memory is None or memory.belief is None:
            return Mixture.gaussian(np.zeros(4), batch.prior)
        dt = float(batch.time[-1]) - memory.time
        transition = np.eye(4)
        transition[:2, 2:] = dt * np.eye(2)
        # What the navigator's covariance has grown by beyond that transition is process noise of any hypothesis about its error
        growth = batch.prior - transition @ memory.prior @ transition.T
        values, vectors = np.linalg.eigh(0.5 * (growth + growth.T))
        noise = (vectors * np.maximum(values, 0.0)) @ vectors.T + 1e-12 * np.diag(np.diag(batch.prior))
        return memory.belief.moved(np.zeros(4), transition, noise)

    def _decide(
        self,
        batch: Batch,
        field_map: FieldMap | ChannelMap,
        result: Update,
        every: BatchLikelihood,
        prior: Mixture,
        keep: Memory,
        sticking_out: frozenset[float],
    ) -> tuple[Fix, Memory]:
        """Publish, or say why not."""
        misfit, freedom, p_value = _consistency(result, batch.prior)
        figures = {
            "hypotheses": float(len(result.belief)),
            "probability": float(result.belief.weight[0]),
            "effective_samples": result.effective,
            "rounds": float(result.rounds),
            "misfit": misfit / freedom,
            "p_value": p_value,
            "noise_scale": keep.scale.factor,
            "readings_left_out": float(len(sticking_out)),
            "feature_variability": float(
                feature_variability(channels_of(field_map)[0], batch.latitude[-1:], batch.longitude[-1:])[0]
            ),
        }
        if keep.noise is not None:
            figures |= keep.noise.figures()
        if p_value < self.settings.significance and misfit > self.settings.tolerance * freedom:
            return self._inconsistent(batch, field_map, result, every, prior, keep, figures)
        if not result.resolved:
            return declined(batch, "the posterior could not be resolved", **figures), replace(keep, belief=prior)
        if result.belief.weight[0] < self.settings.confidence:
            reason = (
                f"ambiguous: {len(result.belief)} places fit, the best with probability {result.belief.weight[0]:.3f}"
            )
            return declined(batch, reason, **figures), keep
        # only now: what sticks out at a wrong place may be right
        keep = replace(
            keep,
            scale=keep.scale.seen(misfit * keep.scale.factor, freedom),
            excluded=keep.excluded | sticking_out,
        )
        return self._publish(batch, field_map, result.belief.mean[0], result.belief.covariance[0], figures, keep)

    def _publish(
        self,
        batch: Batch,
        field_map: FieldMap | ChannelMap,
        mean: Array,
        covariance: Array,
        figures: dict[str, float],
        keep: Memory,
    ) -> tuple[Fix, Memory]:
        information = likelihood_information(mean, covariance, batch.prior)
        position = measurement_only(mean, covariance, batch.prior)
        if not information.matrix.any():
            return declined(batch, "the batch tells nothing that the navigator does not know", **figures), replace(
                keep, belief=None
            )
        north, east = metres_per_radian(batch.latitude[-1])
        scans = slice(len(batch) - batch.new, None)
        moved = np.full((len(batch), 2), np.nan)
        moved[scans] = batch.transition[scans] @ mean
        scan_north, scan_east = metres_per_radian(batch.latitude)
        scan_covariance = np.full((len(batch), 2, 2), np.nan)
        scan_covariance[scans] = position[1] * batch.new
        fix = Fix(
            time=float(batch.time[-1]),
            latitude=float(batch.latitude[-1] - position[0][0] / north),
            longitude=float(batch.longitude[-1] - position[0][1] / east),
            covariance=position[1],
            candidates=contour_candidates(*first_channel(batch, field_map), mean, covariance),
            diagnostics=figures,
            information=information,
            scan_position=np.stack(
                [batch.latitude - moved[:, 0] / scan_north, batch.longitude - moved[:, 1] / scan_east], axis=-1
            ),
            scan_covariance=scan_covariance,
        )
        return fix, replace(keep, belief=None, suspicion=0)

    def _inconsistent(
        self,
        batch: Batch,
        field_map: FieldMap | ChannelMap,
        result: Update,
        every: BatchLikelihood,
        prior: Mixture,
        keep: Memory,
        figures: dict[str, float],
    ) -> tuple[Fix, Memory]:
        """Deal with a batch that does not agree with the map at the best place that the prior allows.

        Either the navigator is elsewhere: a search over tens of km finds places with far more evidence. Then its own covariance is what is
        wrong, and it is told so: with that covariance grown, the next batches search as they do from any uncertain start, and the
        navigator's errors keep the correlations that the filter gives them. Or nothing fits better: then the noise is larger than
        assumed, which the fix's covariance must say, or the map is wrong altogether.
        """
        misfit = figures["misfit"]
        reason = f"readings and map do not agree (misfit {misfit:.1f} per degree of freedom)"
        suspicion = keep.suspicion + 1
        if suspicion < 2 and misfit > self.settings.largest_misfit:
            return declined(batch, reason, **figures), replace(keep, belief=prior, suspicion=suspicion)
        position, velocity, _ = LOST_SIGMA
        covariance = batch.prior + np.diag([position**2, position**2, velocity**2, velocity**2])
        # both places are judged on the same readings, with noise as large as a wrong assumption could explain: a likelihood that is
        # too sure of itself would find some far place better by chance
        judged = every.scaled(min(misfit, _EXPLAINED))
        found = self._update(judged, Mixture.gaussian(np.zeros(4), covariance))
        near = self._update(judged, prior)
        if found is not None and (near is None or found.log_evidence > near.log_evidence + _FAR_BETTER):
            reason += f"; navigator lost, searching within {position / 1000.0:.0f} km (1-sigma)"
            return replace(declined(batch, reason, **figures), reset=True), replace(keep, belief=None, scale=Scale())
        scale = keep.scale.seen(
            misfit * keep.scale.factor * result.likelihood.new_count, float(result.likelihood.new_count)
        )
        if misfit > self.settings.largest_misfit:
            return declined(batch, reason, **figures), replace(keep, belief=prior, suspicion=suspicion)
        again = self._update(result.likelihood.scaled(misfit), prior)
        if again is None or not again.resolved or again.belief.weight[0] < self.settings.confidence:
            return declined(batch, reason, **figures), replace(keep, belief=prior, scale=scale)
        return self._publish(
            batch, field_map, again.belief.mean[0], again.belief.covariance[0], figures, replace(keep, scale=scale)
        )

    @staticmethod
    def _decline(batch: Batch, reason: str, memory: Memory | None, prior: Mixture) -> tuple[Fix, Memory]:
        carried = prior if memory is not None and memory.belief is not None else None
        keep = Memory(
            time=float(batch.time[-1]),
            prior=batch.prior,
            belief=carried,
            suspicion=memory.suspicion if memory else 0,
            excluded=memory.excluded if memory else frozenset(),
            noise=memory.noise if memory else None,
            scale=memory.scale if memory else Scale(),
        )
        return declined(batch, reason), keep


def _likelihood(
    batch: Batch, field_map: FieldMap | ChannelMap, noise: NoiseModel, belief: Mixture, scale: float = 1.0
) -> BatchLikelihood:
    likelihood = BatchLikelihood.of(batch, field_map, noise, belief=belief.moments())
    return likelihood.scaled(scale) if scale > 1.0 else likelihood


def _without(batch: Batch, stamps: frozenset[float]) -> Batch:
    """Return the batch with the readings of the given stamps removed."""
    if not stamps:
        return batch
    drop = np.isin(batch.time, list(stamps))
    return replace(batch, reading=np.where(drop, np.nan, batch.reading))


def _spikes(likelihood: BatchLikelihood, prior: Mixture, gate: float) -> NDArray[np.bool_]:
    """Find spikes before the place is known: what a wrong place does to the residuals is smooth along the track."""
    mean, covariance = prior.moments()
    residual, slope = likelihood.linearise(mean)
    if not np.isfinite(residual).all():
        return np.zeros(len(residual), dtype=np.bool_)
    reach = slope @ covariance @ slope.T
    smooth = smooth_misfit(likelihood.latitude, likelihood.longitude, math.sqrt(float(np.diag(reach).mean())), 1500.0)
    smooth *= likelihood.channel[:, None] == likelihood.channel
    drift = likelihood.drift_at(mean)
    return outliers(residual, likelihood.covariance + drift @ drift.T + reach + smooth, gate)


def _misfits(likelihood: BatchLikelihood, belief: Mixture, gate: float) -> NDArray[np.bool_]:
    """Find readings that stick out at the best hypothesis."""
    mean, covariance = belief.mean[0], belief.covariance[0]
    residual, slope = likelihood.linearise(mean)
    if not np.isfinite(residual).all():
        return np.zeros(len(residual), dtype=np.bool_)
    drift = likelihood.drift_at(mean)
    return outliers(residual, likelihood.covariance + drift @ drift.T + slope @ covariance @ slope.T, gate)


def _consistency(result: Update, prior: Array) -> tuple[float, float, float]:
    """Return (misfit, degrees of freedom, p-value) of the new readings at the best hypothesis.

    The posterior mean has absorbed as many degrees of freedom as it has gained on the prior: n - tr(1 - posterior prior⁻¹).
    """
    misfit = result.likelihood.misfit(result.belief.mean[0])
    absorbed = float(np.trace(np.eye(4) - np.linalg.solve(prior, result.belief.covariance[0])))
    freedom = max(result.likelihood.new_count - min(max(absorbed, 0.0), 4.0), 1.0)
    return misfit, freedom, survival(misfit, freedom)
