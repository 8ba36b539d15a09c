"""What `pmht` carries from batch to batch."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.models import Models
from isogal.matching.pmht.rows import Epoch, States
from isogal.matching.pmht.search import Past, Search

FIRST = 60
"""Readings before the first look: a sixth of an hour."""
DIVERGED_LOG_ODDS = math.log(1e-3)
"""Of a navigator that has diverged, before any reading: one in a thousand."""


@dataclass(frozen=True, slots=True, eq=False)
class FieldMemory:
    """Of one field."""

    states: States
    models: Models
    bank: Hypotheses | None
    """About the navigator as it is; None = its place is searched for."""
    epoch: Epoch | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Diverged:
    """About a navigator that may be anywhere, by the readings of the first field."""

    start: Array
    """(7, 7) covariance of the navigator before the first of `past`."""
    past: tuple[Past, ...] = ()
    """Batches of the last hour."""
    whole: bool = True
    """Whether they are all since the navigator's place was known."""
    wait: int = FIRST
    """Readings to the next look."""
    search: Search | None = None
    """For places, on its way through the last hour."""
    found: Hypotheses | None = None
    """What it has found, carried along with the bank; None = there is nothing."""
    log_odds: float = DIVERGED_LOG_ODDS
    """Of what has been found against the bank."""


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """Of a run. Errors are relative to the estimate of a navigator that has taken the last fix."""

    fields: Mapping[int, FieldMemory]
    """By their place in the list of fields."""
    covariance: Array
    """(7, 7) of that navigator."""
    diverged: Diverged
    taken: Array = field(default_factory=lambda: np.zeros(BATCH_STATES))
    """(7,) error that the last fix takes off its estimate."""

    @classmethod
    def before(cls, prior: Array) -> "Memory":
        """Return that before the first batch, of a navigator of covariance (7, 7)."""
        return cls({}, prior, Diverged(prior))

    def moved(self, by: Array) -> "Memory":
        """Return that of a navigator whose estimate has lost a further error (7,)."""
        past = self.diverged.past
        if past:
            past = (*past[:-1], replace(past[-1], taken=past[-1].taken + by))
        found = self.diverged.found
        found = None if found is None else found.moved(by)
        return replace(
            self._each(lambda bank: bank.moved(by)),
            diverged=replace(self.diverged, past=past, found=found),
            taken=self.taken + by,
        )

    def propagated(self, before: Array, back: Array, prior: Array) -> "Memory":
        """Return it at the next batch end; parameters of `Hypotheses.propagated`."""
        found = self.diverged.found
        if found is not None:
            found = found.propagated(before, back, prior, aided=False)
        return replace(
            self._each(lambda bank: bank.propagated(before, back, prior)),
            covariance=prior,
            diverged=replace(self.diverged, found=found),
            taken=np.zeros(BATCH_STATES),
        )

    def _each(self, change: Callable[[Hypotheses], Hypotheses]) -> "Memory":
        fields = {
            index: one if one.bank is None else replace(one, bank=change(one.bank))
            for index, one in self.fields.items()
        }
        return replace(self, fields=fields)
