"""From a batch of a rigid track to a fix; of several fields, from their batches side by side."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
from isogal.matching.information import likelihood_information, measurement_only, positive_part
from isogal.matching.interfaces import Batch, Fix, Information, declined
from isogal.matching.pmht.settings import Settings
from isogal.matching.usability import too_few, unusable
from isogal.matrices import symmetric
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.integrated.continued_map import ContinuedMap, continued
from isogal.tracks.integrated.estimates import figures, outliers
from isogal.tracks.integrated.jackknife import jackknife_excess
from isogal.tracks.integrated.noise_models import NoiseModels, Told, noise_models
from isogal.tracks.integrated.readings import Readings, readings_of
from isogal.tracks.integrated.search import ShiftPosterior, search_fields

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

    log_weight: tuple[Array | None, ...] = ()
    """Of each field the log prior of the noise models for the next batch; None = nothing
    learnt."""
    posterior: ShiftPosterior | None = None
    """Of the last batch, for display; None = there is none."""
    maps: tuple[ContinuedMap, ...] = ()
    """Of the last batch, for each field."""


@dataclass(frozen=True, slots=True, eq=False)
class _OneField:
    """A field in a batch."""

    index: int
    """In the list of fields."""
    readings: Readings
    models: NoiseModels


@dataclass(frozen=True)
class IntegratedMatcher:
    """Matches rigid batches, with the noise integrated out."""

    told: Told
    name: str = "pmht"
    context: int = 0
    takes_channels: bool = False
    others: tuple[tuple[str, Told], ...] = ()
    """Name of each field beside the batch's own, and what is told of its errors."""

    @classmethod
    def from_settings(cls, matcher: MatcherSettings) -> "IntegratedMatcher":
        """Build it from a scenario's matcher section; raises InputError on a bad option.

        What the section does not say itself counts as not told."""
        settings, said = Settings.of(matcher), matcher.model_fields_set
        length = settings.length
        return cls(
            Told(
                sigma=settings.map_sigma if "map_sigma" in said else None,
                correlation_length=length if "map_correlation_length" in said else None,
                offset_sigma=settings.bias_sigma if "bias_sigma" in said else None,
                trust=settings.options.trust,
            )
        )

    def beside(self, others: Sequence[tuple[str, "IntegratedMatcher"]]) -> "IntegratedMatcher":
        """Return the matcher of several fields: this one's, and named ones that a batch has
        `beside` it, in this order and with the same rows."""
        return replace(self, others=tuple((name, one.told) for name, one in others))

    def match(
        self, batch: Batch, field_map: FieldMap, memory: Memory | None
    ) -> tuple[Fix, Memory]:
        """Match one batch; see `interfaces.Matcher`."""
        memory = memory or Memory()
        nothing = replace(memory, posterior=None)
        if reason := unusable(batch):
            return declined(batch, reason), nothing
        each = [(self.told, batch, field_map)]
        each += [
            (told, one.batch, one.field_map)
            for (_, told), one in zip(self.others, batch.beside, strict=True)
        ]
        maps = tuple(
            _continued(*one, memory.maps[i] if memory.maps else None) for i, one in enumerate(each)
        )
        nothing = replace(nothing, maps=maps)
        fields, reasons = [], []
        for index, ((told, seen, _), continued_map) in enumerate(zip(each, maps, strict=True)):
            readings = readings_of(seen, continued_map)
            reasons.append(too_few(seen, readings.count, FEWEST_READINGS))
            if not reasons[-1]:
                models = _models(told, readings, memory, index)
                fields.append(_OneField(index, readings, models))
        if not fields:
            return declined(batch, reasons[0] or "no readings"), nothing
        posteriors, left_out = _posteriors(fields, batch.prior[:2, :2])
        excess, first = jackknife_excess(*posteriors), posteriors[0]
        numbers = self._figures(fields, posteriors, left_out)
        numbers["widened"] = float(np.sqrt(np.trace(excess) / np.trace(first.moments[1])))
        if first.probability < CONFIDENCE:
            reason = (
                f"ambiguous: {first.places} places fit, the best with probability"
                f" {first.probability:.2f}; longer batches or a narrower prior may tell them"
                " apart"
            )
            return declined(batch, reason, **numbers), replace(nothing, posterior=first)
        fix = _fix(batch, first, excess, numbers)
        learnt: list[Array | None] = list(memory.log_weight or (None,) * len(each))
        for one, posterior in zip(fields, posteriors, strict=True):
            learnt[one.index] = _remembered(posterior)
        return fix, Memory(tuple(learnt), first, maps)

    def _figures(
        self,
        fields: Sequence[_OneField],
        posteriors: Sequence[ShiftPosterior],
        left_out: Sequence[int],
    ) -> dict[str, float]:
        """Return what readings say of errors, those of other fields with their names."""
        numbers: dict[str, float] = {}
        for one, posterior, count in zip(fields, posteriors, left_out, strict=True):
            prefix = f"{self.others[one.index - 1][0]}." if one.index else ""
            left = float(count + one.readings.off_map)
            named = {**figures(posterior), "readings_left_out": left}
            numbers |= {f"{prefix}{name}": value for name, value in named.items()}
        return numbers


def _continued(
    told: Told, batch: Batch, field_map: FieldMap, last: ContinuedMap | None
) -> ContinuedMap:
    """Return the map around a batch continued; the last one's where that is the same."""
    reach = _MAP_REACH * math.sqrt(float(np.diag(batch.prior)[:2].max()))
    if last is not None and last.original is field_map and last.reach >= reach:
        return last
    return continued(field_map, reach, told.sigma or 0.0)


def _models(told: Told, readings: Readings, memory: Memory, index: int) -> NoiseModels:
    """Return the noise models of a field, with the prior that was learnt."""
    continued_map = readings.map
    own = not isinstance(continued_map.field.sigma, float)
    scalar = continued_map.field.sigma
    if isinstance(scalar, float) and scalar > (told.sigma or 0.0):
        told = replace(told, sigma=scalar)
    if readings.own_lengths and told.correlation_length is None:
        told = replace(told, correlation_length=continued_map.field.correlation_length)
    models = noise_models(told, own, continued_map.spread)
    learnt = memory.log_weight[index] if memory.log_weight else None
    if learnt is not None and learnt.shape == models.log_prior.shape:
        models = replace(models, log_prior=learnt)
    return models


def _posteriors(
    fields: Sequence[_OneField], prior: Array
) -> tuple[tuple[ShiftPosterior, ...], list[int]]:
    """Return the posterior as each field has it, without outliers, and how many of its readings
    were left out."""
    readings = [one.readings for one in fields]
    models = [one.models for one in fields]
    most = [_MOST_OUTLIERS * len(one) for one in readings]
    posteriors = search_fields(list(zip(readings, models, strict=True)), prior)
    for _ in range(_ROUNDS):
        found = False
        for i, posterior in enumerate(posteriors):
            bad = outliers(posterior)
            if bad.any() and bad.sum() <= most[i]:
                readings[i], found = readings[i].without(bad), True
        if not found:
            break
        posteriors = search_fields(list(zip(readings, models, strict=True)), prior)
    left = zip(fields, readings, strict=True)
    return posteriors, [one.readings.count - now.count for one, now in left]


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
    return _with_excess(fix, excess)


def _with_excess(fix: Fix, excess: Array) -> Fix:
    """Return the fix with more covariance (2, 2) about the same place."""
    if not excess.any() or fix.information is None:
        return fix
    full = np.zeros((4, 4))
    full[:2, :2] = excess
    # (M⁻¹ + E)⁻¹, and the vector that keeps M⁻¹ vector, where M may be singular; directions
    # without information stay without
    size = np.sqrt(1.0 / np.maximum(np.abs(np.diag(fix.information.matrix)), 1e-300))
    told = positive_part(fix.information, size)
    spread = np.eye(4) + told.matrix @ full
    matrix, vector = (
        np.asarray(np.linalg.solve(spread, part), dtype=np.float64)
        for part in (told.matrix, told.vector)
    )
    information = Information(vector, symmetric(matrix))
    return replace(fix, covariance=fix.covariance + excess, information=information)
