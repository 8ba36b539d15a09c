"""`pmht`: probabilistic multi-hypothesis map matching with an exact batch likelihood; the default
matcher.

It keeps the paper's idea, a batch of scans matched at once by probabilities over many hypotheses
under the kinematic constraint, and replaces what made it inexact:

- the kinematic constraint is the navigator's own track: the unknown is its error at the batch end
  (position and velocity), and what tilt and heading add within the batch is integrated out
  (`batching`, `likelihood`);
- the likelihood carries the map's error with its correlation along the track and the map's
  rounding (`likelihood`); an unknown bias of the readings and its drift are estimated along
  (`bias`);
- the posterior's moments come from annealed importance sampling, so they are right where it is not
  Gaussian (`sampler`);
- a wide posterior that is not Gaussian goes on to the next batch in its own shape
  (`mixture.pieces`);
- separate hypotheses stay separate: an ambiguous batch publishes nothing, its hypotheses go on to
  the next batch and are dropped by evidence (`hypotheses`);
- readings that stick out are left out, and a batch that does not agree with the map gives no fix
  (`screening`);
- a wide prior is searched on a grid (`acquisition`); a navigator whose own covariance cannot be
  right is searched for over tens of km and told so (`Fix.reset`);
- what is published is the information of the measurements alone (`information`).
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array, Booleans
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.channels import ChannelMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.variability import feature_variability
from isogal.matching.channels import first_channel
from isogal.matching.information import likelihood_information, measurement_only
from isogal.matching.interfaces import LOST_COVARIANCE, LOST_SIGMA, Batch, Fix, declined
from isogal.matching.local import unusable
from isogal.matching.pmht.contours import contour_candidates
from isogal.matching.pmht.gaussian_mixture import Mixture, pieces
from isogal.matching.pmht.hypotheses import Update, update
from isogal.matching.pmht.importance_sampling import Sampling
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.map_error import NoiseEstimate, differs, field_scale
from isogal.matching.pmht.matched import Matched, evidence, likelihood_of, misfits, spikes, without
from isogal.matching.pmht.memory import Memory, Scale, prior_of
from isogal.matching.pmht.noise_model import NoiseModel, uneven
from isogal.matching.pmht.sensor_bias import BiasEstimate, LinearBias
from isogal.matching.registry import check_options
from isogal.scenario import Matcher as MatcherSettings

_EXPLAINED = 4.0
"""Variance factor that a noise model wrong by two in sigma explains."""
_FAR_BETTER = 8.0
"""Log evidence by which a place elsewhere must beat the best one near the navigator: the wide
prior itself already counts against it."""
_BETTER = 3.0
"""Log evidence by which a bias of the readings must beat a place elsewhere."""
_UNKNOWN_BIAS = 0.5
"""1-sigma of a bias that nobody has told anything about, as a share of the map's standard
deviation."""
_STRAY = 0.01
"""Probability of a reading that sticks out."""
_SHAPED = (100.0, 1000.0)
"""m, 1-sigma of a posterior whose shape is carried to the next batch: a narrower one is Gaussian,
a wider one is searched by pieces."""
_CUTS = 3
"""Times that it is cut in halves."""
_SHAPELY = -0.05
"""Log density per sample by which the pieces must describe it better than one Gaussian. Of a
Gaussian they are 0.1 worse; slight departures are carried, too, since they add up from batch to
batch."""
_REFINEMENTS = 6
"""Times at most that a map's own error is taken anew where the readings turn out to be."""


class Settings(BaseModel):
    """Options of `pmht` (`matcher.options` of a scenario)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    context: int | None = Field(
        None,
        ge=0,
        description="older scans whose residuals predict the map error; null = batch_length",
    )
    samples: int = Field(512, ge=64, le=65536, description="points per round of the sampler")
    hypotheses: int = Field(2048, ge=1, le=10000, description="hypotheses kept at most")
    confidence: float = Field(
        0.999, gt=0.5, lt=1.0, description="probability a hypothesis needs before it is published"
    )
    outlier_gate: float = Field(
        4.5, gt=0.0, description="1-sigma beyond which a reading is left out"
    )
    significance: float = Field(
        1e-4, gt=0.0, lt=0.5, description="p-value under which a batch counts as inconsistent"
    )
    tolerance: float = Field(
        2.0, ge=1.0, description="misfit per degree of freedom that is never called inconsistent"
    )
    largest_misfit: float = Field(
        9.0, gt=1.0, description="misfit per degree of freedom above which no fix is published"
    )
    bias_drift_sigma: float | None = Field(
        None,
        ge=0.0,
        description=(
            "1-sigma of the readings' drift, map's unit per second; null = bias_sigma in three"
            " hours"
        ),
    )
    trust: float = Field(
        2.0,
        ge=1.0,
        le=100.0,
        description=(
            "factor within which a given map_sigma and correlation length are right (1-sigma); 1 ="
            " to the letter"
        ),
    )


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
        """Build it from a scenario's matcher section; raises InputError on an unknown or bad
        option."""
        settings: Settings = check_options("pmht", matcher.options, Settings)
        adaptive = matcher.map_sigma == "auto"
        noise = NoiseModel(
            map_sigma=0.0 if matcher.map_sigma == "auto" else float(matcher.map_sigma),
            correlation_length=matcher.map_correlation_length,
            bias_sigma=matcher.bias_sigma,
        )
        context = matcher.batch_length if settings.context is None else settings.context
        return cls(noise, adaptive, settings, context)

    def match(
        self, batch: Batch, field_map: FieldMap | ChannelMap, memory: Memory | None
    ) -> tuple[Fix, Memory | None]:
        """Match one batch; see `interfaces.Matcher`. Vector readings (`vector`) come with a map of
        several channels."""
        if reason := unusable(batch) or self._cannot(batch, field_map):
            return declined(batch, reason), memory
        excluded = memory.excluded if memory else frozenset()
        batch, bias = self._unbiased(without(batch, excluded), field_map, memory)
        estimate = self._estimate(batch, field_map, memory)
        noise = self.noise if estimate is None else estimate.model(self.noise)
        noise = noise if bias is None else replace(noise, bias_sigma=0.0)
        prior = prior_of(batch, memory)
        if np.isfinite(batch.reading[-batch.new :]).sum() < 3:
            return self._decline(
                batch, "fewer than three readings in the batch", memory, prior, bias
            )

        scale = memory.scale.factor if memory else 1.0
        every = likelihood_of(batch, field_map, noise, prior, scale)
        bad = spikes(every, prior, self.settings.outlier_gate + 2.0)
        result = self._update(every.without(bad), prior)
        if result is None:
            return self._decline(
                batch, "the search area lies outside the map", memory, prior, bias
            )
        if uneven(
            field_map
        ):  # now that the place is known, so is how wrong the map is there, which may move the place
            where = result.belief
            for _ in range(_REFINEMENTS):
                every = likelihood_of(batch, field_map, noise, where, scale)
                before, result = result, self._update(every.without(bad), prior) or result
                if before.belief.agrees(result.belief):
                    break
                # from now on averaged over all places so far: of those that take turns each is
                # possible
                where = Mixture.join([where, result.belief], np.array([0.5, 0.5]))
        sticking_out = misfits(
            every, result.belief, self.settings.outlier_gate
        )  # with everybody in, now that the place is known
        if not np.array_equal(bad, sticking_out):
            bad = sticking_out
            result = self._update(every.without(bad), prior) or result
        keep = Memory(
            time=float(batch.time[-1]),
            prior=batch.prior,
            belief=result.belief,
            suspicion=memory.suspicion if memory else 0,
            excluded=frozenset(t for t in excluded if t >= batch.time[0]),
            noise=estimate,
            bias=None if bias is None else bias.unmeasured(batch),
            scale=memory.scale if memory else Scale(),
            evidence=(memory.evidence if memory else 0.0)
            + evidence(result)
            + _strays(bad[every.first_new :], batch, field_map),
        )
        return self._decide(
            Matched(batch, field_map, prior, every, bad, result, bias, memory), keep
        )

    def _unbiased(
        self, batch: Batch, field_map: FieldMap | ChannelMap, memory: Memory | None
    ) -> tuple[Batch, LinearBias | None]:
        """Return the batch with what is known of the readings' bias in it; a bias of several
        channels is in the likelihood instead."""
        estimate = memory.bias if memory else None
        if len(channels_of(field_map)) > 1:
            return batch, None
        if estimate is None and (self.adaptive or self.noise.bias_sigma > 0.0):
            estimate = self._unknown_bias(batch, field_map)
        if estimate is None:
            return batch, None
        bias = estimate.at_end(batch)
        return bias.added_to(batch), bias

    def _unknown_bias(self, batch: Batch, field_map: FieldMap | ChannelMap) -> BiasEstimate:
        """Return the prior of the readings' bias: as told, else of somebody who knows nothing."""
        sigma, drift = self.noise.bias_sigma, self.settings.bias_drift_sigma
        sigma = sigma if sigma > 0.0 else _UNKNOWN_BIAS * field_scale(channels_of(field_map)[0])
        return BiasEstimate.unknown(
            float(batch.time[0]), sigma, sigma / 10800.0 if drift is None else drift
        )

    def _estimate(
        self, batch: Batch, field_map: FieldMap | ChannelMap, memory: Memory | None
    ) -> NoiseEstimate | None:
        """Return what is known about the map's error by now; None where that is not in
        question."""
        if memory is not None and memory.noise is not None:
            return memory.noise
        if self.adaptive:
            return NoiseEstimate.unknown(batch, channels_of(field_map)[0])
        several = len(channels_of(field_map)) > 1
        if (
            self.settings.trust == 1.0
            or self.noise.map_sigma == 0.0
            or several
            or uneven(field_map)
        ):
            return None
        return NoiseEstimate.told(self.noise, self.settings.trust)

    def _learn(
        self, at: Matched, estimate: NoiseEstimate | None
    ) -> tuple[Matched, NoiseEstimate | None]:
        """Add what the batch says about the map's error, and match again where that makes a
        difference."""
        if estimate is None:
            return at, None
        learnt = estimate.update(
            at.batch,
            at.result.likelihood,
            channels_of(at.field_map)[0],
            at.result.belief.mean[0],
        )
        model = learnt.model(self.noise)
        if not differs(estimate.model(self.noise), model):
            return at, learnt
        every = likelihood_of(
            at.batch,
            at.field_map,
            model if at.bias is None else replace(model, bias_sigma=0.0),
            at.result.belief,
        )
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
        return update(
            likelihood, prior, Sampling(samples=self.settings.samples), self.settings.hypotheses
        )

    def _decide(self, at: Matched, keep: Memory) -> tuple[Fix, Memory | None]:
        """Publish, or say why not."""
        if self._disagree(*at.agreement()):
            return self._inconsistent(at, keep, self._figures(at, keep.scale, keep.noise))
        # the map's error is learnt from batches that what was known before can explain: a wrong
        # place must not pass for a wrong map
        at, learnt = self._learn(at, keep.noise)
        figures = self._figures(at, keep.scale, learnt)
        keep = replace(keep, belief=at.result.belief)
        if not at.result.resolved:
            return declined(at.batch, "the posterior could not be resolved", **figures), replace(
                keep, belief=at.prior
            )
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

    def _figures(self, at: Matched, scale: Scale, noise: NoiseEstimate | None) -> dict[str, float]:
        """Return what the diagnostics say."""
        misfit, freedom, p_value = at.agreement()
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
            "feature_variability": float(
                feature_variability(channels_of(at.field_map)[0], *place)[0]
            ),
        }
        if noise is not None:
            figures |= noise.figures(self.noise)
        if at.bias is not None:
            figures |= at.bias.measured(
                at.batch, at.result.likelihood, *at.posterior()[:2]
            ).figures()
        return figures

    def _publish(self, at: Matched, figures: dict[str, float], keep: Memory) -> tuple[Fix, Memory]:
        batch, mean, covariance = (
            at.batch,
            at.result.belief.mean[0],
            at.result.belief.covariance[0],
        )
        information = likelihood_information(*at.posterior())
        position = measurement_only(mean, covariance, batch.prior)
        if not information.matrix.any():
            return declined(
                batch, "the batch tells nothing that the navigator does not know", **figures
            ), replace(keep, belief=None)
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
                [
                    each.latitude - moved[:, 0] / scan_north,
                    each.longitude - moved[:, 1] / scan_east,
                ],
                axis=-1,
            ),
            scan_covariance=scan_covariance,
        )
        if at.bias is not None:
            keep = replace(
                keep, bias=at.bias.measured(at.batch, at.result.likelihood, *at.posterior()[:2])
            )
        return fix, replace(keep, belief=_shape(at.result, covariance), suspicion=0)

    def _inconsistent(
        self, at: Matched, keep: Memory, figures: dict[str, float]
    ) -> tuple[Fix, Memory | None]:
        """Deal with a batch that does not agree with the map at the best place that the prior
        allows.

        Either the readings have a bias that nobody has told of: then it is estimated from now on.
        Or the navigator is elsewhere: a search over tens of km finds places with far more
        evidence. Then its own covariance is what is wrong, and it is told so: with that covariance
        grown, the next batches search as they do from any uncertain start, and the navigator's
        errors keep the correlations that the filter gives them. Where it may be either, a bias is
        allowed for in the search. Or nothing fits better: then the noise is larger than assumed,
        which is learnt and said in the fix's covariance, or the map is wrong altogether."""
        batch = at.batch
        misfit = figures["misfit"]
        reason = f"readings and map do not agree (misfit {misfit:.1f} per degree of freedom)"
        suspicion = keep.suspicion + 1
        if suspicion < 2 and misfit > self.settings.largest_misfit:
            return declined(batch, reason, **figures), replace(
                keep, belief=at.prior, suspicion=suspicion
            )
        covariance = batch.prior + LOST_COVARIANCE[:4, :4]
        # all are judged on the same readings, with noise as large as a wrong assumption could
        # explain: a likelihood that is too sure of itself would find some far place better by
        # chance
        judged = at.every.scaled(min(misfit, _EXPLAINED))
        found = self._update(judged, Mixture.gaussian(np.zeros(4), covariance))
        near = self._update(judged, at.prior)
        here, there = evidence(near), evidence(found)
        biased = self._evidence_of_bias(at, judged)
        if biased > max(here + _FAR_BETTER, there + _BETTER):
            start = at.memory or Memory(float(batch.time[0]), batch.prior, None)
            return self.match(
                batch, at.field_map, replace(start, bias=self._unknown_bias(batch, at.field_map))
            )
        if there > here + _FAR_BETTER:
            reason += (
                f"; navigator lost, searching within {LOST_SIGMA[0] / 1000.0:.0f} km (1-sigma)"
            )
            doubtful = at.bias is not None or biased > max(here, there - _FAR_BETTER)
            bias = self._unknown_bias(batch, at.field_map) if doubtful else None
            keep = replace(keep, belief=None, bias=bias, scale=Scale())
            return replace(declined(batch, reason, **figures), reset=True), keep
        if misfit > self.settings.largest_misfit:
            return declined(batch, reason, **figures), replace(
                keep, belief=at.prior, suspicion=suspicion
            )
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

    def _evidence_of_bias(self, at: Matched, judged: BatchLikelihood) -> float:
        """Return the log evidence of a navigator that is right, whose readings have a bias that
        nobody has told of."""
        if at.bias is not None or len(channels_of(at.field_map)) > 1:
            return -math.inf
        batch = self._unknown_bias(at.batch, at.field_map).at_end(at.batch).added_to(at.batch)
        biased = replace(
            judged,
            nuisance_position=batch.nuisance_position[judged.rows],
            nuisance_reading=batch.nuisance_reading[judged.rows],
        )
        return evidence(self._update(biased.with_nuisance_at(np.zeros(4)), at.prior))

    @staticmethod
    def _decline(
        batch: Batch, reason: str, memory: Memory | None, prior: Mixture, bias: LinearBias | None
    ) -> tuple[Fix, Memory]:
        carried = prior if memory is not None and memory.belief is not None else None
        keep = Memory(
            time=float(batch.time[-1]),
            prior=batch.prior,
            belief=carried,
            suspicion=memory.suspicion if memory else 0,
            excluded=memory.excluded if memory else frozenset(),
            noise=memory.noise if memory else None,
            bias=None if bias is None else bias.unmeasured(batch),
            scale=memory.scale if memory else Scale(),
            evidence=memory.evidence if memory else 0.0,
        )
        return declined(batch, reason), keep


def _strays(left_out: Booleans, batch: Batch, field_map: FieldMap | ChannelMap) -> float:
    """Return the log density of the readings that are left out: they may be anything that the map
    holds."""
    if not left_out.any():
        return 0.0
    scale = max(field_scale(channels_of(field_map)[0]), float(np.nanmedian(batch.sigma)))
    return float(left_out.sum()) * math.log(_STRAY / (math.sqrt(2.0 * math.pi) * scale))


def _shape(result: Update, covariance: Array) -> Mixture | None:
    """Return the posterior's shape as hypotheses about the navigator that has taken the fix; None
    where a Gaussian says it.

    In a flat field with a poor map the posterior is a ridge or has a shoulder, and the Gaussian
    that the navigator makes of it forgets the tail in which the truth may be (Gaussian sum:
    Sorenson & Alspach 1971, Automatica 7:465)."""
    sigma = math.sqrt(float(np.linalg.eigvalsh(covariance[:2, :2])[-1]))
    if result.drawn is None or len(result.belief) > 1 or not _SHAPED[0] < sigma < _SHAPED[1]:
        return None
    x, weight = result.drawn
    scale = np.sqrt(np.diag(covariance))
    shape, gaussian = (pieces(x, weight, scale, cuts) for cuts in (_CUTS, 0))
    gain = float(weight @ (shape.log_density(x) - gaussian.log_density(x)))
    if gain <= _SHAPELY:
        return None
    centre, spread = (
        shape.moments()
    )  # of a few hundred samples; as a whole it is what the navigator is told
    turn = np.linalg.cholesky(covariance) @ np.linalg.inv(np.linalg.cholesky(spread))
    return Mixture(shape.weight, (shape.mean - centre) @ turn.T, turn @ shape.covariance @ turn.T)
