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
from isogal.matching.noise_estimation import NoiseEstimate, differs
from isogal.matching.pmht_memory import Memory, Scale, prior_of
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

_REFINEMENTS = 6
"""Times at most that a map's own error is taken anew where the readings turn out to be."""


class Settings(BaseModel):
    """Options of `pmht` (`matcher.options` of a scenario)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    context: int | None = Field(
        None, ge=0, description="older scans whose residuals predict the map error; null = batch_length"
    )
    samples: int = Field(512, ge=64, le=65536, description="points per round of the sampler")
    hypotheses: int = Field(2048, ge=1, le=10000, description="hypotheses kept at most")
    confidence: float = Field(
        0.999, gt=0.5, lt=1.0, description="probability a hypothesis needs before it is published"
    )
    outlier_gate: float = Field(4.5, gt=0.0, description="1-sigma beyond which a reading is left out")
    significance: float = Field(1e-4, gt=0.0, lt=0.5, description="p-value under which a batch counts as inconsistent")
    tolerance: float = Field(2.0, ge=1.0, description="misfit per degree of freedom that is never called inconsistent")
    largest_misfit: float = Field(
        9.0, gt=1.0, description="misfit per degree of freedom above which no fix is published"
    )
    trust: float = Field(
        2.0,
        ge=1.0,
        le=100.0,
        description="factor within which a given map_sigma and correlation length are right (1-sigma); 1 = to the letter",
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Matched:
    """A batch on its way through the matcher."""

    batch: Batch
    field_map: FieldMap | ChannelMap
    prior: Mixture
    every: BatchLikelihood
    """Of all readings."""
    bad: NDArray[np.bool_]
    """Rows of it that stick out at the best hypothesis and are left out."""
    result: Update

    @property
    def sticking_out(self) -> frozenset[float]:
        """Their stamps."""
        return frozenset(float(t) for t in self.batch.time[self.every.rows[self.bad]])

    def consistency(self) -> tuple[float, float, float]:
        """Return (misfit, degrees of freedom, p-value) of the new readings at the best hypothesis.

        The posterior mean has absorbed as many degrees of freedom as it has gained on the prior: n - tr(1 - posterior prior⁻¹).
        """
        absorbed = float(np.trace(np.eye(4) - np.linalg.solve(self.batch.prior, self.result.belief.covariance[0])))
        freedom = max(self.result.likelihood.new_count - min(max(absorbed, 0.0), 4.0), 1.0)
        return self.result.misfit, freedom, survival(self.result.misfit, freedom)


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
        estimate = self._estimate(batch, field_map, memory)
        noise = self.noise if estimate is None else estimate.model(self.noise)
        prior = prior_of(batch, memory)
        if np.isfinite(batch.reading[-batch.new :]).sum() < 3:
            return self._decline(batch, "fewer than three readings in the batch", memory, prior)

        scale = memory.scale.factor if memory else 1.0
        every = _likelihood(batch, field_map, noise, prior, scale)
        bad = _spikes(every, prior, self.settings.outlier_gate + 2.0)
        result = self._update(every.without(bad), prior)
        if result is None:
            return self._decline(batch, "the search area lies outside the map", memory, prior)
        if uneven(field_map):  # now that the place is known, so is how wrong the map is there, which may move the place
            where = result.belief
            for _ in range(_REFINEMENTS):
                every = _likelihood(batch, field_map, noise, where, scale)
                before, result = result, self._update(every.without(bad), prior) or result
                if before.belief.agrees(result.belief):
                    break
                # from now on averaged over all places so far: of those that take turns each is possible
                where = Mixture.join([where, result.belief], np.array([0.5, 0.5]))
        misfits = _misfits(
            every, result.belief, self.settings.outlier_gate
        )  # with everybody in, now that the place is known
        if not np.array_equal(bad, misfits):
            bad = misfits
            result = self._update(every.without(bad), prior) or result
        keep = Memory(
            time=float(batch.time[-1]),
            prior=batch.prior,
            belief=result.belief,
            suspicion=memory.suspicion if memory else 0,
            excluded=frozenset(t for t in excluded if t >= batch.time[0]),
            noise=estimate,
            scale=memory.scale if memory else Scale(),
        )
        return self._decide(_Matched(batch, field_map, prior, every, bad, result), keep)

    def _estimate(self, batch: Batch, field_map: FieldMap | ChannelMap, memory: Memory | None) -> NoiseEstimate | None:
        """Return what is known about the map's error by now; None where that is not in question."""
        if memory is not None and memory.noise is not None:
            return memory.noise
        if self.adaptive:
            return NoiseEstimate.unknown(batch, channels_of(field_map)[0])
        several = len(channels_of(field_map)) > 1
        if self.settings.trust == 1.0 or self.noise.map_sigma == 0.0 or several or uneven(field_map):
            return None
        return NoiseEstimate.told(self.noise, self.settings.trust)

    def _learn(self, at: "_Matched", estimate: NoiseEstimate | None) -> tuple["_Matched", NoiseEstimate | None]:
        """Add what the batch says about the map's error, and match again where that makes a difference."""
        if estimate is None:
            return at, None
        learnt = estimate.update(
            at.batch,
            at.result.likelihood,
            channels_of(at.field_map)[0],
            at.result.belief.mean[0],
            self.noise.bias_sigma,
        )
        model = learnt.model(self.noise)
        if not differs(estimate.model(self.noise), model):
            return at, learnt
        every = _likelihood(at.batch, at.field_map, model, at.result.belief)
        result = self._update(every.without(at.bad), at.prior)
        return (at if result is None else replace(at, every=every, result=result)), learnt

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

    def _decide(self, at: "_Matched", keep: Memory) -> tuple[Fix, Memory]:
        """Publish, or say why not."""
        misfit, freedom, p_value = at.consistency()
        if self._disagree(misfit, freedom, p_value):
            return self._inconsistent(at, keep, self._figures(at, keep.scale, keep.noise))
        # the map's error is learnt from batches that what was known before can explain: a wrong place must not pass for a wrong map
        at, learnt = self._learn(at, keep.noise)
        figures = self._figures(at, keep.scale, learnt)
        keep = replace(keep, belief=at.result.belief)
        if not at.result.resolved:
            return declined(at.batch, "the posterior could not be resolved", **figures), replace(keep, belief=at.prior)
        if at.result.belief.weight[0] < self.settings.confidence:
            count, best = len(at.result.belief), at.result.belief.weight[0]
            reason = f"ambiguous: {count} places fit, the best with probability {best:.3f}"
            return declined(at.batch, reason, **figures), keep
        # only now: what sticks out at a wrong place may be right
        misfit, freedom, _ = at.consistency()
        keep = replace(
            keep,
            noise=learnt,
            scale=keep.scale.seen(misfit * keep.scale.factor, freedom),
            excluded=keep.excluded | at.sticking_out,
        )
        return self._publish(at, figures, keep)

    def _disagree(self, misfit: float, freedom: float, p_value: float) -> bool:
        return p_value < self.settings.significance and misfit > self.settings.tolerance * freedom

    def _figures(self, at: "_Matched", scale: Scale, noise: NoiseEstimate | None) -> dict[str, float]:
        """Return what the diagnostics say."""
        misfit, freedom, p_value = at.consistency()
        place = at.batch.latitude[-1:], at.batch.longitude[-1:]
        figures = {
            "hypotheses": float(len(at.result.belief)),
            "probability": float(at.result.belief.weight[0]),
            "effective_samples": at.result.effective,
            "rounds": float(at.result.rounds),
            "misfit": misfit / freedom,
            "p_value": p_value,
            "noise_scale": scale.factor,
            "readings_left_out": float(len(at.sticking_out)),
            "feature_variability": float(feature_variability(channels_of(at.field_map)[0], *place)[0]),
        }
        return figures if noise is None else figures | noise.figures(self.noise)

    def _publish(self, at: "_Matched", figures: dict[str, float], keep: Memory) -> tuple[Fix, Memory]:
        batch, mean, covariance = at.batch, at.result.belief.mean[0], at.result.belief.covariance[0]
        information = likelihood_information(mean, covariance, batch.prior)
        position = measurement_only(mean, covariance, batch.prior)
        if not information.matrix.any():
            return declined(batch, "the batch tells nothing that the navigator does not know", **figures), replace(
                keep, belief=None
            )
        north, east = metres_per_radian(batch.latitude[-1])
        each, first = first_channel(batch, at.field_map)  # each scan once
        scans = slice(len(each) - each.new, None)
        moved = np.full((len(each), 2), np.nan)
        moved[scans] = each.transition[scans] @ mean
        scan_north, scan_east = metres_per_radian(each.latitude)
        scan_covariance = np.full((len(each), 2, 2), np.nan)
        scan_covariance[scans] = position[1] * each.new
        fix = Fix(
            time=float(batch.time[-1]),
            latitude=float(batch.latitude[-1] - position[0][0] / north),
            longitude=float(batch.longitude[-1] - position[0][1] / east),
            covariance=position[1],
            candidates=contour_candidates(each, first, mean, covariance),
            diagnostics=figures,
            information=information,
            scan_position=np.stack(
                [each.latitude - moved[:, 0] / scan_north, each.longitude - moved[:, 1] / scan_east], axis=-1
            ),
            scan_covariance=scan_covariance,
        )
        return fix, replace(keep, belief=None, suspicion=0)

    def _inconsistent(self, at: "_Matched", keep: Memory, figures: dict[str, float]) -> tuple[Fix, Memory]:
        """Deal with a batch that does not agree with the map at the best place that the prior allows.

        Either the navigator is elsewhere: a search over tens of km finds places with far more evidence. Then its own covariance is what is
        wrong, and it is told so: with that covariance grown, the next batches search as they do from any uncertain start, and the
        navigator's errors keep the correlations that the filter gives them. Or nothing fits better: then the noise is larger than
        assumed, which is learnt and said in the fix's covariance, or the map is wrong altogether.
        """
        batch = at.batch
        misfit = figures["misfit"]
        reason = f"readings and map do not agree (misfit {misfit:.1f} per degree of freedom)"
        suspicion = keep.suspicion + 1
        if suspicion < 2 and misfit > self.settings.largest_misfit:
            return declined(batch, reason, **figures), replace(keep, belief=at.prior, suspicion=suspicion)
        position, velocity, _ = LOST_SIGMA
        covariance = batch.prior + np.diag([position**2, position**2, velocity**2, velocity**2])
        # both places are judged on the same readings, with noise as large as a wrong assumption could explain: a likelihood that is
        # too sure of itself would find some far place better by chance
        judged = at.every.scaled(min(misfit, _EXPLAINED))
        found = self._update(judged, Mixture.gaussian(np.zeros(4), covariance))
        near = self._update(judged, at.prior)
        if found is not None and (near is None or found.log_evidence > near.log_evidence + _FAR_BETTER):
            reason += f"; navigator lost, searching within {position / 1000.0:.0f} km (1-sigma)"
            return replace(declined(batch, reason, **figures), reset=True), replace(keep, belief=None, scale=Scale())
        if misfit > self.settings.largest_misfit:
            return declined(batch, reason, **figures), replace(keep, belief=at.prior, suspicion=suspicion)
        again, learnt = self._learn(at, keep.noise)
        misfit, freedom, p_value = again.consistency()
        scale = keep.scale.seen(misfit * keep.scale.factor, freedom)
        if self._disagree(misfit, freedom, p_value):
            wider = self._update(again.result.likelihood.scaled(misfit / freedom), at.prior)
            again = again if wider is None else replace(again, result=wider)
        figures = self._figures(again, scale, learnt)
        if not again.result.resolved or again.result.belief.weight[0] < self.settings.confidence:
            return declined(batch, reason, **figures), replace(keep, belief=at.prior, scale=scale)
        return self._publish(again, figures, replace(keep, noise=learnt, scale=scale))

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
