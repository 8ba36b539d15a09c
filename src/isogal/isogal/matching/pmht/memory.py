"""What `pmht` carries from batch to batch, how the error of the navigator goes on in between, and
what is known where it has been found elsewhere (docs/mathematics.md, sections 6.2 and 9)."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import Aided
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.models import DECEIVED, RARE
from isogal.matching.pmht.search import Diverged, FieldMemory, Past, ranked, resolved, spread_over

SAYS = math.log((1.0 - RARE) / RARE)
"""Log odds at which the bank is given up for what a search has found."""


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """Of a run. Errors are relative to the estimate of a navigator that has taken the last fix."""

    fields: Mapping[int, FieldMemory]
    """By their place in the list of fields."""
    diverged: Diverged
    untaken: Array
    """(7, 7) what it was before that fix."""
    taken: Array = field(default_factory=lambda: np.zeros(BATCH_STATES))
    """(7,) error that the last fix takes off its estimate."""

    @property
    def covariance(self) -> Array:
        """(7, 7) of that navigator."""
        return self.diverged.last.left

    def moved(self, by: Array) -> "Memory":
        """Return that of a navigator whose estimate has lost a further error (7,)."""
        last = self.diverged.last
        return replace(
            self._each(lambda bank: bank.moved(by)),
            diverged=self.diverged.with_last(replace(last, taken=last.taken + by)),
            taken=self.taken + by,
        )

    def propagated(
        self, before: Array, back: Array, prior: Array, time: float, aided: Aided | None = None
    ) -> "Memory":
        """Return it at the end of the next batch, at a time (s), before its readings.

        Parameters
        ----------
        before, prior : (7, 7) arrays
            The navigator's covariance at the last batch end after its fix, and at this one. What
            it has learnt from other aids makes every hypothesis as much narrower.
        back : (7, 7) array
            Error there per unit of error here.
        aided : Aided, optional
            What satellites have told of the error at that end.
        """
        told = prior if aided is None else aided.covariance
        forward, growth, learnt = steps(before, back, told)

        def followed(bank: Hypotheses) -> Hypotheses:
            bank = bank.carried(forward, growth)
            bank = bank if learnt is None else bank.carried(learnt, np.zeros_like(prior))
            return bank.aided(aided, prior)

        # of kilometres, what is not linear in them looks like growth
        lost = any(one.bank is None for one in self.fields.values())
        passed = Past(forward, np.zeros_like(prior) if lost else growth, prior, time)
        if aided is not None:
            passed = replace(passed, taken=-aided.jump)
        diverged = self.diverged.with_last(replace(self.diverged.last, left=before))
        return Memory(self._each(followed).fields, diverged.later(passed), prior)

    def after(self, taken: Array, covariance: Array) -> "Memory":
        """Return that of a navigator from whose estimate a fix takes an error (7,), and which has
        a covariance (7, 7) then."""
        diverged, last = self.diverged, self.diverged.last
        if len(diverged.past) == 1 and last.rows is None:  # its place has just been found
            diverged = Diverged.before(covariance, last.time)
        else:
            diverged = diverged.with_last(replace(last, taken=last.taken + taken, left=covariance))
        return replace(
            self._each(lambda bank: bank.moved(taken)),
            diverged=diverged,
            taken=taken,
        )

    def _each(self, change: Callable[[Hypotheses], Hypotheses]) -> "Memory":
        fields = {
            index: one if one.bank is None else replace(one, bank=change(one.bank))
            for index, one in self.fields.items()
        }
        return replace(self, fields=fields)


def steps(before: Array, back: Array, told: Array) -> tuple[Array, Array, Array | None]:
    """Return (7, 7) what the dynamics make of an error, what joins its covariance, and what then
    makes that covariance the navigator's, `told`; None where it is that already. See
    `Memory.propagated`."""
    forward = np.asarray(np.linalg.inv(back), dtype=np.float64)
    dynamic = forward @ before @ forward.T
    growth, narrower = grown(dynamic, told)
    return forward, growth, _transport(dynamic + growth, told) if narrower else None


def grown(before: Array, after: Array) -> tuple[Array, bool]:
    """Return (7, 7) what has joined a covariance where it has grown, and whether it is narrower in
    some direction."""
    scale = np.sqrt(np.diag(after))
    unit = np.outer(scale, scale)
    values, vectors = np.linalg.eigh((after - before) / unit)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T * unit, bool(values[0] < -1e-9)


def _transport(a: Array, b: Array) -> Array:
    """Return the symmetric T with T a T = b in units of the 1-sigmas of b: the optimal map from
    N(0, a) to N(0, b) (Gelbrich 1990)."""
    scale = np.sqrt(np.diag(b))
    values, vectors = np.linalg.eigh(a / scale / scale[:, None])
    root = np.sqrt(np.maximum(values, 1e-300))
    half = (vectors * root) @ vectors.T
    inverse = (vectors / root) @ vectors.T
    values, vectors = np.linalg.eigh(half @ (b / scale / scale[:, None]) @ half)
    middle = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(inverse @ middle @ inverse * scale[:, None] / scale)


def decided(memory: Memory, first: int, field_map: AnyMap) -> tuple[Memory, bool]:
    """Return the memory, with hypotheses at the place that has been found where that is certain,
    and whether it is."""
    diverged, lead = memory.diverged, memory.fields[first]
    search, found = diverged.search, diverged.found
    if search is None or found is None or not resolved(found):
        return memory, False
    if lead.bank is not None and search.log_odds < SAYS:
        return memory, False
    # those that a search began with may not have held the place: have all cells it there?
    _, there = ranked(diverged, lead, field_map, found.moments()[0])
    if there < RARE:
        return replace(memory, diverged=replace(diverged, search=None, look=-math.inf)), False
    return _at_place(memory, found), True


def undeceived(memory: Memory, first: int) -> tuple[Memory, bool]:
    """Return the memory, with hypotheses where the map says the navigator is where it is certain
    that satellites are wrong, and whether it is."""
    bank = memory.fields[first].bank
    if bank is None or not bank.faults[DECEIVED] > 1.0 - RARE:
        return memory, False
    alone = bank.part(bank.models.family[bank.which] == DECEIVED)
    return (_at_place(memory, alone), True) if resolved(alone) else (memory, False)


def _at_place(memory: Memory, found: Hypotheses) -> Memory:
    """Return the memory of a navigator that is where hypotheses have it; of the models nothing is
    known but what was before the first reading."""
    fields = {
        index: replace(
            one, bank=spread_over(found, one.models).reduced(np.eye(2, one.states.count))
        )
        for index, one in memory.fields.items()
    }
    diverged = Diverged.before(memory.covariance, memory.diverged.past[-1].time)
    return replace(memory, fields=fields, diverged=diverged)
