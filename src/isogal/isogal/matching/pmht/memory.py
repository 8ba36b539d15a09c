"""What `pmht` carries from batch to batch, how the error of the navigator goes on in between, and
what is known where it has been found elsewhere (docs/mathematics.md, sections 6.2 and 9)."""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES, HEADING
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.models import DECEIVED, RARE
from isogal.matching.pmht.search import (
    Diverged,
    FieldMemory,
    Past,
    probability_at,
    resolved,
    spread_over,
)
from isogal.passage import Passage

SAME_ESTIMATE = 0.25
"""Squared distance, in 1-sigmas of the navigator, between the correction that a fix asked for and
the one that was made, up to which the fix counts as taken: half a 1-sigma."""
SAYS = math.log((1.0 - RARE) / RARE)
"""Log odds at which the bank is given up for what a search has found."""


class Memory(NamedTuple):
    """Of a run. Errors are relative to the estimate of a navigator that has taken the last fix."""

    fields: Mapping[int, FieldMemory]
    """By their place in the list of fields."""
    diverged: Diverged
    untaken: Array
    """(7, 7) what it was before that fix."""
    taken: Array = np.zeros(BATCH_STATES)
    """(7,) error that the last fix takes off its estimate."""
    slow: Array | None = None
    """Estimates of the slow errors of its sensors before that fix."""
    refused: int = 0
    """How many fixes in a row it has not taken."""

    @property
    def covariance(self) -> Array:
        """(7, 7) of that navigator."""
        return self.diverged.last.left

    def moved(self, by: Array) -> "Memory":
        """Return that of a navigator whose estimate has lost a further error (7,)."""
        last = self.diverged.last
        return self._each(lambda _, bank: bank.moved(by))._replace(
            diverged=self.diverged.with_last(last._replace(taken=last.taken + by)),
            taken=self.taken + by,
        )

    def propagated(self, batch: Batch) -> "Memory":
        """Return it at the end of the next batch, before its readings."""
        prior, before, memory = batch.covariance, self.covariance, self
        jump, passage = batch.history.correction, batch.history.passage
        refused, anew, first = False, False, max(len(batch) - batch.new - 1, 0)
        begin, back = self.diverged.last.time, batch.backward[first].copy()
        # the last batch ended before that where all scans are new, or one was not matched
        back[:2] -= (batch.time[first] - begin) * back[2:4]
        if passage is not None and not math.isclose(passage.begin, begin, abs_tol=1e-6):
            passage = None
        known = back @ prior @ back.T if passage is None else _of_error(passage.before)
        if jump is not None:
            off = -jump - self.taken
            if not _same(off, before):
                # the fix was not taken as it was: if not at all, the navigator knew what it had
                # known before; else, where it knows less than by the fix, it knew no more then;
                # where it knows more, several of its states have taken the fix, each by itself:
                # what it knows now, it knows from the same readings
                refused = _same(jump, self.untaken)
                more, narrower = grown(before, known)
                anew = narrower and not refused and not batch.history.aided
                before = self.untaken if refused else before + more
            memory = self.moved(off)
        forward = np.linalg.inv(back)
        if passage is None:
            passage = Passage.of_dynamics(begin, before, *steps(before, forward, prior))
        before, slow = _of_error(passage.before), self.slow
        growth = grown(forward @ before @ forward.T, _of_error(passage.after))[0]

        def followed(one: FieldMemory, bank: Hypotheses) -> Hypotheses:
            if anew and not one.states.slow:
                return Hypotheses.before(one.models, prior)
            return _passed(one, bank, passage, jump, slow).aided(passage, prior)

        # of kilometres, what is not linear in them looks like growth
        lost = any(one.bank is None for one in self.fields.values())
        time = float(batch.time[-1])
        passed = Past(forward, 0.0 * growth if lost else growth, prior, time, -passage.jump)
        last = memory.diverged.last._replace(left=before)
        diverged = memory.diverged.with_last(last).later(passed)
        fields = memory._each(followed).fields
        slow_now = passage.slow[1] if passage.slow.size else slow
        count = self.refused + 1 if refused else 0
        return Memory(fields, diverged, prior, slow=slow_now, refused=count)

    def after(self, taken: Array, covariance: Array) -> "Memory":
        """Return that of a navigator from whose estimate a fix takes an error (7,), and which has
        a covariance (7, 7) then."""
        memory = self.moved(taken)
        diverged, last = memory.diverged, memory.diverged.last
        if len(diverged.past) == 1 and last.rows is None:  # its place has just been found
            diverged = Diverged.before(covariance, last.time)
        else:
            diverged = diverged.with_last(last._replace(left=covariance))
        return memory._replace(diverged=diverged)

    def _each(self, change: Callable[[FieldMemory, Hypotheses], Hypotheses]) -> "Memory":
        fields = {
            index: one if one.bank is None else one._replace(bank=change(one, one.bank))
            for index, one in self.fields.items()
        }
        return self._replace(fields=fields)


def _passed(
    one: FieldMemory, bank: Hypotheses, passage: Passage, jump: Array | None, slow: Array | None
) -> Hypotheses:
    """Return a field's hypotheses at the end of a passage, where the navigator's estimate has
    jumped by so much (7,) at its beginning, and those of the slow errors were `slow` (n - 7,)
    before."""
    moving = one.states.moving[: len(passage.mean)]
    states = len(moving)
    mean, covariance = bank.mean.copy(), bank.covariance.copy()
    if slow is not None and states > BATCH_STATES:
        mean[:, moving[BATCH_STATES:]] += passage.slow[0] - slow
    if jump is not None:
        # the same heading error is one of another velocity now (docs/mathematics.md, section 3.17)
        for velocity, by in ((2, -jump[3]), (3, jump[2])):
            mean[:, velocity] += by * mean[:, HEADING]
            covariance[:, velocity] += by * covariance[:, HEADING]
            covariance[:, :, velocity] += by * covariance[:, :, HEADING]
    bank = replace(bank, mean=mean, covariance=covariance)
    return bank.passed(passage.part(states), moving)


def _of_error(covariance: Array) -> Array:
    """Return (7, 7) that of the navigator's error, without slow ones of its sensors."""
    return covariance[:BATCH_STATES, :BATCH_STATES]


def _same(off: Array, covariance: Array) -> bool:
    """Whether estimates that differ by so much (7,) are the same to a navigator."""
    return bool(off @ np.linalg.solve(covariance, off) <= SAME_ESTIMATE)


def steps(before: Array, forward: Array, told: Array) -> tuple[Array, Array]:
    """Return (7, 7) what has become of an error of covariance `before`, by the dynamics `forward`
    and by what other aids have told the navigator that has the covariance `told` then, which makes
    every hypothesis as much narrower; and what has joined its covariance."""
    dynamic = forward @ before @ forward.T
    growth, narrower = grown(dynamic, told)
    if not narrower:
        return forward, growth
    learnt = _transport(dynamic + growth, told)
    return learnt @ forward, learnt @ growth @ learnt.T


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
    there = probability_at(diverged, lead, field_map, found.moments()[0])
    if there < RARE:
        return memory._replace(diverged=diverged._replace(search=None, look=-math.inf)), False
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
        index: one._replace(
            bank=spread_over(found, one.models).reduced(np.eye(2, one.states.count))
        )
        for index, one in memory.fields.items()
    }
    diverged = Diverged.before(memory.covariance, memory.diverged.past[-1].time)
    return memory._replace(fields=fields, diverged=diverged)
