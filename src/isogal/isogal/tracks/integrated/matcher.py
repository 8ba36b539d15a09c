"""From a batch of a rigid track to a fix."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
from isogal.matching.information import likelihood_information, measurement_only
from isogal.matching.interfaces import Batch, Fix, declined
from isogal.matching.pmht.robust import with_excess
from isogal.matching.pmht.settings import Settings
from isogal.matching.usability import too_few, unusable
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.integrated.continued_map import ContinuedMap, continued
from isogal.tracks.integrated.estimates import figures, outliers
from isogal.tracks.integrated.jackknife import jackknife_excess
from isogal.tracks.integrated.noise_models import Told, noise_models
from isogal.tracks.integrated.readings import Readings, readings_of
from isogal.tracks.integrated.search import ShiftPosterior, search

CONFIDENCE = 0.9
"""Probability that the heaviest of several places needs; what the others have is in the
covariance."""
FEWEST_READINGS = 3
_MAP_REACH = 4.0
"""Prior 1-sigmas by which a map is continued."""
_REMEMBERED_SHARE = 0.8
"""Of the next batch's prior of noise models that comes from the batches before."""
_MOST_OUTLIERS = 0.1
"""Share of the rows that may be left out."""
_ROUNDS = 3
"""Times at most that outliers are looked for."""
RIGID = 25.0
"""m, by which the velocity error (1-sigma) may bend a batch that counts as rigid."""


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """What is carried from batch to batch."""

    log_weight: Array | None = None
    """Log prior of the noise models for the next batch; None = nothing learnt."""
    posterior: ShiftPosterior | None = None
    """Of the last batch, for display; None = there is none."""
    map: ContinuedMap | None = None
    """Of the last batch."""


@dataclass(frozen=True)
class IntegratedMatcher:
    """Matches rigid batches, with the noise integrated out."""

    told: Told
    name: str = "pmht"
    context: int = 0
    takes_channels: bool = False

    @classmethod
    def from_settings(cls, matcher: MatcherSettings) -> "IntegratedMatcher":
        """Build it from a scenario's matcher section; raises InputError on a bad option.

        What the section does not say itself counts as not told."""
        settings, said = Settings.of(matcher), matcher.model_fields_set
        noise = settings.noise
        known = "map_sigma" in said and not settings.adaptive
        length = noise.correlation_length
        return cls(
            Told(
                sigma=noise.map_sigma if known else None,
                correlation_length=length if "map_correlation_length" in said else None,
                offset_sigma=noise.bias_sigma if "bias_sigma" in said else None,
                trust=settings.options.trust,
            )
        )

    def match(
        self, batch: Batch, field_map: FieldMap, memory: Memory | None
    ) -> tuple[Fix, Memory]:
        """Match one batch; see `interfaces.Matcher`."""
        memory = memory or Memory()
        nothing = replace(memory, posterior=None)
        if reason := unusable(batch):
            return declined(batch, reason), nothing
        prior = batch.prior[:2, :2]
        continued_map = self._continued(batch, field_map, memory)
        nothing = replace(nothing, map=continued_map)
        readings = readings_of(batch, continued_map)
        if reason := too_few(batch, readings.count, FEWEST_READINGS):
            return declined(batch, reason), nothing
        posterior, left_out = self._posterior(readings, prior, memory)
        excess = jackknife_excess(posterior)
        numbers = {
            **figures(posterior),
            "readings_left_out": float(left_out + readings.off_map),
            "widened": float(np.sqrt(np.trace(excess) / np.trace(posterior.moments[1]))),
        }
        if posterior.probability < CONFIDENCE:
            reason = (
                f"ambiguous: {posterior.places} places fit, the best with probability"
                f" {posterior.probability:.2f}; longer batches or a narrower prior may tell them"
                " apart"
            )
            return declined(batch, reason, **numbers), replace(nothing, posterior=posterior)
        fix = _fix(batch, posterior, excess, numbers)
        return fix, Memory(_remembered(posterior), posterior, continued_map)

    def _continued(self, batch: Batch, field_map: FieldMap, memory: Memory) -> ContinuedMap:
        """Return the map around a batch continued; the last one's where that is the same."""
        reach = _MAP_REACH * math.sqrt(float(np.diag(batch.prior)[:2].max()))
        last = memory.map
        if last is not None and last.original is field_map and last.reach >= reach:
            return last
        return continued(field_map, reach, self.told.sigma or 0.0)

    def _posterior(
        self, readings: Readings, prior: Array, memory: Memory
    ) -> tuple[ShiftPosterior, int]:
        """Return the posterior without outliers, and how many readings were left out."""
        continued_map = readings.map
        own = not isinstance(continued_map.field.sigma, float)
        told, scalar = self.told, continued_map.field.sigma
        if isinstance(scalar, float) and scalar > (told.sigma or 0.0):
            told = replace(told, sigma=scalar)
        models = noise_models(told, own, continued_map.spread)
        if memory.log_weight is not None and memory.log_weight.shape == models.log_prior.shape:
            models = replace(models, log_prior=memory.log_weight)
        count, most = readings.count, _MOST_OUTLIERS * len(readings)
        posterior = search(readings, prior, models)
        for _ in range(_ROUNDS):
            bad = outliers(posterior)
            if not bad.any() or bad.sum() > most:
                break
            readings = readings.without(bad)
            posterior = search(readings, prior, models)
        return posterior, count - readings.count


def _remembered(posterior: ShiftPosterior) -> Array:
    """Return the log prior of the noise models for the next batch."""
    before = np.exp(posterior.models.log_prior - posterior.models.log_prior.max())
    mixed = (
        _REMEMBERED_SHARE * posterior.by_model + (1.0 - _REMEMBERED_SHARE) * before / before.sum()
    )
    return np.asarray(np.log(np.maximum(mixed, 1e-300)))


def _fix(batch: Batch, posterior: ShiftPosterior, excess: Array, numbers: dict[str, float]) -> Fix:
    """Return what the readings alone say, with the covariance widened."""
    place, spread = posterior.moments
    # velocity follows the position as far as the prior correlates them
    follow = np.linalg.solve(batch.prior[:2, :2], batch.prior[:2]).T
    mean = follow @ place
    covariance = batch.prior + follow @ (spread - batch.prior[:2, :2]) @ follow.T
    error, own = measurement_only(mean, covariance, batch.prior)
    information = likelihood_information(mean, covariance, batch.prior)
    if not information.matrix.any():
        reason = "the batch tells nothing that the navigator does not know"
        return declined(batch, reason, **numbers)
    north, east = metres_per_radian(batch.latitude[-1])
    fix = Fix(
        time=float(batch.time[-1]),
        latitude=float(batch.latitude[-1] - error[0] / north),
        longitude=float(batch.longitude[-1] - error[1] / east),
        covariance=own,
        diagnostics=numbers,
        information=information,
    )
    full: Any = np.zeros((4, 4))
    full[:2, :2] = excess
    widened = with_excess(fix, full, batch.new)
    return replace(widened, diagnostics=numbers)
