"""Readings of several fields: one matcher for each, one after the other, about one navigator.

Readings of two fields are independent given where the vehicle was, so that what one says is the
prior of the other: each matcher keeps the noise, map error and bias of its own field, and is
given what the navigator will be after the fixes of those before it, with the hypotheses that
these leave open. What comes of them all is one fix, of the measurements alone
(docs/mathematics.md, section 8.9).

The first matcher's batch ends are everybody's: that of the field with the least time between its
fixes. What watches a matcher (`monitoring`) watches all of them as one that has the first one's
readings and the fixes of all."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, runtime_checkable

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.channels import AnyMap
from isogal.matching.information import measurement_only, position_information, replaced
from isogal.matching.interfaces import Batch, Beside, Fix, Information, Matcher
from isogal.matching.monitoring import Insight, Monitored
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.map_error import MapErrorPrior
from isogal.matching.pmht.past_batches import error_before, seen_from
from isogal.matrices import symmetric
from isogal.scenario import Scenario


@runtime_checkable
class Sharing(Protocol):
    """A matcher that has hypotheses about the navigator, and can be given those of another. Its
    memory has them as `hypotheses`."""

    def carrying(self, memory: Any, hypotheses: Mixture | None) -> Any:
        """Return a memory with other hypotheses about the end of the last batch."""
        ...

    def given(self, memory: Any, batch: Batch, hypotheses: Mixture | None) -> Any:
        """Return a memory with hypotheses about the end of a batch that is still to be matched."""
        ...

    def after_others(self, memory: Any, taken: Array, covariance: Array) -> Any:
        """Return the memory after a batch of a navigator that has then taken fixes of others as
        well: a mean error (n,) off its estimate, which leaves a covariance (n, n).
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class JointMemory:
    """What is carried from batch to batch."""

    memories: tuple[Any, ...]
    """Of the matcher of each field."""
    hypotheses: Mixture | None = None
    """About the navigator's error at the end of the last batch, after its fix; None = the
    navigator's own prior."""


@dataclass(frozen=True)
class JointMatcher:
    """Matchers of several fields as one. `matchers` and `names` are in the order of the fields;
    batches are those of field `lead`, with the others' beside them."""

    matchers: tuple[Matcher, ...]
    names: tuple[str, ...]
    lead: int

    @property
    def first(self) -> Matcher:
        """The matcher of the field whose batch ends are everybody's."""
        return self.matchers[self.lead]

    @property
    def name(self) -> str:
        """Of the first matcher."""
        return self.first.name

    @property
    def context(self) -> int:
        """Of the first matcher."""
        return self.first.context

    @property
    def takes_channels(self) -> bool:
        """Of the first matcher."""
        return self.first.takes_channels

    def match(
        self, batch: Batch, field_map: AnyMap, memory: JointMemory | None
    ) -> tuple[Fix, JointMemory]:
        """Match one batch; see `interfaces.Matcher`."""
        step = _Step(self, batch, memory or JointMemory((None,) * len(self.matchers)))
        step.take_first(field_map)
        for beside in batch.beside:
            step.take(beside)
        return replace(step.fix(), map_error=step.map_error), step.remembered()

    # What monitors ask (`monitoring.Monitored`): of the first field, but what the readings say of
    # all of them.

    def insight(self, memory: JointMemory | None) -> Insight:
        """Say what the matchers have come to believe."""
        whole = memory or JointMemory((None,) * len(self.matchers))
        each = [
            matcher.insight(one)
            for matcher, one in zip(self.matchers, whole.memories, strict=True)
            if isinstance(matcher, Monitored)
        ]
        untold = any(one.untold for one in each)
        return Insight(
            sum(one.log_evidence for one in each),
            max((x for one in each if (x := one.map_error_doubt) is not None), default=None),
            self.map_error_prior(whole, self.lead) if untold else None,
            whole.hypotheses,
            told_doubt=max(one.told_doubt for one in each),
            untold=untold,
        )

    def sceptic(
        self, batch: Batch, before: Any, after: JointMemory, variance: float, confidence: float
    ) -> tuple[Any, Any]:
        """See `monitoring.Monitored`; of the first matcher alone."""
        earlier = None if before is None else before.memories[self.lead]
        later = after.memories[self.lead]
        return self._watched.sceptic(batch, earlier, later, variance, confidence)

    def with_hypotheses(self, memory: JointMemory, of: JointMemory) -> JointMemory:
        """Return a memory with the hypotheses of another."""
        return replace(memory, hypotheses=of.hypotheses)

    def without_hypotheses(self, memory: JointMemory | None) -> JointMemory | None:
        """Return a memory that takes the navigator's own covariance for its prior."""
        return None if memory is None else replace(memory, hypotheses=None)

    def likelihood(
        self, batch: Batch, field_map: AnyMap, memory: JointMemory, place: tuple[Array, Array]
    ) -> BatchLikelihood:
        """See `monitoring.Monitored`; of the first field's readings."""
        return self._watched.likelihood(batch, field_map, memory.memories[self.lead], place)

    def map_error_prior(self, memory: JointMemory, field: int) -> MapErrorPrior | None:
        """See `pmht.other_fields.SeveralFields`."""
        estimate = getattr(memory.memories[field], "map_error", None)
        return None if estimate is None else estimate.coarse_prior

    @property
    def _watched(self) -> Monitored:
        first = self.first
        assert isinstance(first, Monitored)
        return first


class _Step:
    """One batch end: what the matchers say, one after the other."""

    def __init__(self, joint: JointMatcher, batch: Batch, memory: JointMemory) -> None:
        self._joint, self._batch = joint, batch
        self._memories = list(memory.memories)
        self._hypotheses = memory.hypotheses
        self._prior = joint_prior(batch)
        size = len(self._prior)
        self._widening: Array | None = None
        self._vector, self._matrix = np.zeros(size), np.zeros((size, size))
        self._after: dict[int, Array] = {}
        """By field: the mean error (n,) by all fixes up to its own."""
        self._mean, self._covariance = np.zeros(size), self._prior
        self._fixes: dict[int, Fix] = {}
        self.map_error: tuple[float, float] | None = None

    def take_first(self, field_map: AnyMap) -> None:
        """Match the batch of the first field."""
        index = self._joint.lead
        memory = self._memories[index]
        if isinstance(self._joint.first, Sharing) and memory is not None:
            memory = self._joint.first.carrying(memory, self._hypotheses)
        fix, after = self._joint.first.match(replace(self._batch, beside=()), field_map, memory)
        self._note(index, fix, memory, after)

    def take(self, beside: Beside) -> None:
        """Match what another field has read meanwhile."""
        matcher, before = self._joint.matchers[beside.field], self._memories[beside.field]
        batch, memory = beside.batch, before
        if self._taken:
            batch = _seen(batch, self._mean, self._covariance)
        if isinstance(matcher, Sharing):
            if self._taken and before is not None:
                earlier = _earlier(beside.batch, batch, self._mean)
                memory = matcher.after_others(before, *earlier)
            memory = matcher.given(memory, batch, self._hypotheses)
        fix, after = matcher.match(batch, beside.field_map, memory)
        if fix.reset and any(one.published for one in self._fixes.values()):
            # the navigator has just been found where it believes to be: these readings are wrong
            reason = "disagrees with the other fields"
            self._fixes[beside.field] = replace(fix, reset=False, reason=reason)
            return
        self._note(beside.field, fix, memory, after)

    @property
    def _taken(self) -> bool:
        """Whether any fix has changed the navigator."""
        return self._widening is not None or any(one.published for one in self._fixes.values())

    def _note(self, index: int, fix: Fix, before: Any, after: Any) -> None:
        """Take what a matcher has said, as the navigator will."""
        self._fixes[index], self._memories[index] = fix, after
        self.map_error = self.map_error or fix.map_error
        if isinstance(self._joint.matchers[index], Sharing) and after is not before:
            self._hypotheses = after.hypotheses
        if fix.widening is not None:
            self._widen(fix.widening)
        if fix.published:
            told = _information(fix, self._batch, self._mean)
            self._inform(told)
        self._after[index] = self._mean

    def _widen(self, widening: Array) -> None:
        size = len(self._prior)
        part = widening[:size, :size]
        self._covariance = self._covariance + part
        self._widening = widening if self._widening is None else self._widening + widening

    def _inform(self, told: Information) -> None:
        """Take information about the error after what has been taken already."""
        size, known = len(self._prior), len(told.vector)
        vector, matrix = np.zeros(size), np.zeros((size, size))
        vector[:known], matrix[:known, :known] = told.vector, told.matrix
        before = self._covariance
        # (P⁻¹ + M)⁻¹ without inverting P, whose velocity part may be tiny
        covariance = np.linalg.solve(np.eye(size) + before @ matrix, before)
        self._mean = self._mean + covariance @ vector
        self._covariance = symmetric(covariance)
        # about the error before anything was taken
        self._vector = self._vector + vector + matrix @ (self._mean - covariance @ vector)
        self._matrix = self._matrix + matrix

    def remembered(self) -> JointMemory:
        """Return the memory after the batch, of a navigator that has taken all fixes."""
        for index, mean in self._after.items():
            matcher, moved = self._joint.matchers[index], self._mean - mean
            if isinstance(matcher, Sharing) and moved.any():
                told = matcher.after_others(self._memories[index], moved, self._covariance)
                self._memories[index] = told
        return JointMemory(tuple(self._memories), self._hypotheses)

    def fix(self) -> Fix:
        """Return what all of them say, but for the map's error."""
        published = [index for index, one in self._fixes.items() if one.published]
        reset = any(one.reset for one in self._fixes.values())
        figures, first = self._figures(), self._fixes[self._joint.lead]
        if len(self._fixes) == 1:
            return first
        if not published:
            return replace(first, reason=self._reasons(), reset=reset, diagnostics=figures)
        shown = first if first.published else self._fixes[published[0]]
        if published == [self._joint.lead] and reset == first.reset:
            return replace(first, diagnostics=figures)
        wide = self._prior
        if self._widening is not None:
            wide = wide + self._widening[: len(wide), : len(wide)]
        whole = replace(shown, time=first.time, reason=None, reset=reset, diagnostics=figures)
        whole = replaced(whole, self._mean, self._covariance, wide)
        if self._widening is None:
            whole = replace(whole, information=Information(self._vector, symmetric(self._matrix)))
        error, _ = measurement_only(self._mean[:4], self._covariance[:4, :4], wide[:4, :4])
        latitude, longitude = self._batch.end
        north, east = metres_per_radian(latitude)
        return replace(
            whole,
            latitude=float(latitude - error[0] / north),
            longitude=float(longitude - error[1] / east),
        )

    def _reasons(self) -> str:
        names = self._joint.names
        return "; ".join(f"{names[index]}: {one.reason}" for index, one in self._fixes.items())

    def _figures(self) -> dict[str, float]:
        """Return the first one's figures, and the others' with the name of their field."""
        figures: dict[str, float] = {}
        for index, one in self._fixes.items():
            prefix = "" if index == self._joint.lead else f"{self._joint.names[index]}."
            figures |= {f"{prefix}{name}": value for name, value in one.diagnostics.items()}
        return figures


def _information(fix: Fix, batch: Batch, taken: Array) -> Information:
    """Return what a fix says of the error that is left of a batch's navigator once a mean error
    (n,) is taken off."""
    if fix.information is not None:
        return fix.information
    told = position_information(batch, fix.latitude, fix.longitude, fix.covariance)
    return Information(told.vector - told.matrix @ taken[:4], told.matrix)


def _seen(batch: Batch, shift: Array, covariance: Array) -> Batch:
    """Return a batch as a navigator would have it that has taken a mean error (n,) off its
    estimate, and has a covariance (n, n)."""
    if batch.attitude is not None:
        return seen_from(batch, shift, covariance)
    moved = batch.transition @ shift
    north, east = metres_per_radian(batch.latitude)
    return replace(
        batch,
        latitude=batch.latitude - moved[:, 0] / north,
        longitude=batch.longitude - moved[:, 1] / east,
        reading=batch.reading - batch.reading_jacobian @ shift,
        prior=covariance,
    )


def _earlier(batch: Batch, seen: Batch, shift: Array) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) of the error at the end of the batch before, after a
    fix with a mean error at this one's; `seen` is the batch after the fix."""
    elapsed = float(batch.time[-1] - batch.time[max(len(batch) - batch.new - 1, 0)])
    back, nuisance = seen.back(elapsed)
    covariance = back @ seen.prior @ back.T + nuisance @ nuisance.T
    by_error = batch.back(elapsed)[0] if batch.attitude is None else error_before(batch)
    return by_error @ shift, symmetric(covariance)


@dataclass(frozen=True, slots=True)
class Rhythm:
    """When batches end."""

    lead: int
    """The field whose batch ends are everybody's."""
    times: tuple[float, ...]
    """Of each field the time between its fixes if it were alone, s."""

    @classmethod
    def of(cls, scenarios: Sequence[Scenario]) -> "Rhythm":
        """Return that of fields, each with its scenario (`Scenario.each_field`)."""
        times = tuple(
            one.matcher.scans_between_fixes * one.gravimeter.interval for one in scenarios
        )
        return cls(int(np.argmin(times)), times)

    def marks(self, field: int, scenario: Scenario) -> int:
        """Return how many batch ends there are at most in a batch of a field."""
        if field == self.lead:
            return 0
        length = scenario.matcher.batch_length * scenario.gravimeter.interval
        return math.ceil(length / self.times[self.lead]) + 1
