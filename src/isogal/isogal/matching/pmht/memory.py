"""What `pmht` carries from batch to batch, and how the navigator's error goes on between them
(docs/mathematics.md, section 6.2)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.interfaces import Aided
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.models import Models
from isogal.matching.pmht.rows import Epoch
from isogal.matching.pmht.search import Past, Search
from isogal.matching.pmht.states import States

HOUR = 3600.0
"""s that a search goes back."""
EVERY, LATER = 200.0, HOUR / 2.0
"""s from one look for other places to the next, and where it has found the navigator where it
believes to be. Later looks find later a navigator that has diverged, earlier ones take as long
as the fixes."""


@dataclass(frozen=True, slots=True, eq=False)
class FieldMemory:
    """Of one field."""

    states: States
    models: Models
    bank: Hypotheses | None
    """About the navigator as it is; None = its place is searched for."""
    epoch: Epoch | None = None
    specified: float = 0.0
    """1-sigma of the map's error as specified, map's unit; 0 = it is not."""


@dataclass(frozen=True, slots=True, eq=False)
class Diverged:
    """About a navigator that may be anywhere, by the readings of the first field."""

    start: Array
    """(7, 7) covariance of the navigator before the first of `past`."""
    past: tuple[Past, ...]
    """Batches of the last hour, and those that a search has not come to."""
    look: float
    """s, when it is time for the next look."""
    whole: bool = True
    """Whether they are all since the navigator's place was known."""
    search: Search | None = None
    """None = nothing is likely enough to be followed up."""

    @classmethod
    def before(cls, prior: Array, time: float) -> "Diverged":
        """Return that of a navigator of covariance (7, 7) of whose readings before a time (s)
        nothing is asked."""
        same, nothing = np.eye(BATCH_STATES), np.zeros_like(prior)
        return cls(prior, (Past.of(same, nothing, prior, time),), time + EVERY)

    @property
    def found(self) -> Hypotheses | None:
        """What a search has found that has come to the last batch; None = nothing has."""
        done = self.search is not None and self.search.done == len(self.past)
        return self.search.hypotheses if self.search is not None and done else None

    def later(self, passed: Past) -> "Diverged":
        """Return it with another batch, and without those that nothing asks for any more."""
        past, start, search, whole = (*self.past, passed), self.start, self.search, self.whole
        while passed.time - past[0].time > HOUR and (search is None or search.done > 1):
            start, past, whole = past[0].left, past[1:], False
            search = None if search is None else replace(search, done=search.done - 1)
        return replace(self, past=past, start=start, whole=whole, search=search)

    @property
    def last(self) -> Past:
        """The last batch."""
        return self.past[-1]

    def with_last(self, last: Past) -> "Diverged":
        """Return it with another last batch."""
        return replace(self, past=(*self.past[:-1], last))


@dataclass(frozen=True, slots=True, eq=False)
class Memory:
    """Of a run. Errors are relative to the estimate of a navigator that has taken the last fix."""

    fields: Mapping[int, FieldMemory]
    """By their place in the list of fields."""
    covariance: Array
    """(7, 7) of that navigator."""
    diverged: Diverged
    untaken: Array
    """(7, 7) what it was before that fix."""
    taken: Array = field(default_factory=lambda: np.zeros(BATCH_STATES))
    """(7,) error that the last fix takes off its estimate."""

    @classmethod
    def before(cls, prior: Array, time: float) -> "Memory":
        """Return that before the readings of a first batch, which ends at a time (s), of a
        navigator of covariance (7, 7)."""
        return cls({}, prior, Diverged.before(prior, time), prior)

    @property
    def time(self) -> float:
        """s, end of the last batch."""
        return self.diverged.last.time

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
        before, back, prior
            See `steps`.
        aided : Aided, optional
            What satellites have told of the error at that end.
        """
        alone, narrowing = steps(before, back, prior if aided is None else aided.covariance)
        if any(one.bank is None for one in self.fields.values()):
            # of kilometres, what is not linear in them looks like growth
            alone = alone._replace(growth=np.zeros_like(prior))
        diverged = self.diverged.with_last(replace(self.diverged.last, left=before))
        passed = Past.of(*alone, prior, time)
        if aided is not None:
            passed = replace(passed, taken=-aided.jump)
        return replace(
            self._each(lambda bank: bank.carried(*narrowing).aided(aided, prior)),
            covariance=prior,
            untaken=prior,
            diverged=diverged.later(passed),
            taken=np.zeros(BATCH_STATES),
        )

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
            covariance=covariance,
            diverged=diverged,
            taken=taken,
        )

    def _each(self, change: Callable[[Hypotheses], Hypotheses]) -> "Memory":
        fields = {
            index: one if one.bank is None else replace(one, bank=change(one.bank))
            for index, one in self.fields.items()
        }
        return replace(self, fields=fields)


class Step(NamedTuple):
    """An error x becomes `forward` x, and `growth` joins its covariance."""

    forward: Array
    """(7, 7)."""
    growth: Array
    """(7, 7)."""


def steps(before: Array, back: Array, prior: Array) -> tuple[Step, Step]:
    """Return what the dynamics do, and the same with what the navigator has learnt from other
    aids, which makes every hypothesis as much narrower as the navigator.

    Parameters
    ----------
    before, prior : (7, 7) arrays
        The navigator's covariance at the last batch end after its fix, and at this one.
    back : (7, 7) array
        Error there per unit of error here.
    """
    forward = np.asarray(np.linalg.inv(back), dtype=np.float64)
    dynamic = forward @ before @ forward.T
    growth, narrower = grown(dynamic, prior)
    alone = Step(forward, growth)
    if not narrower:
        return alone, alone
    scale = np.sqrt(np.diag(prior))
    unit = np.outer(scale, scale)
    learnt = _transport((dynamic + growth) / unit, prior / unit) * scale[:, None] / scale
    return alone, Step(learnt @ forward, learnt @ growth @ learnt.T)


def grown(before: Array, after: Array) -> tuple[Array, bool]:
    """Return (7, 7) what has joined a covariance where it has grown, and whether it is narrower in
    some direction."""
    scale = np.sqrt(np.diag(after))
    unit = np.outer(scale, scale)
    values, vectors = np.linalg.eigh((after - before) / unit)
    return (vectors * np.maximum(values, 0.0)) @ vectors.T * unit, bool(values[0] < -1e-9)


def _transport(a: Array, b: Array) -> Array:
    """Return the symmetric T with T a T = b: the optimal map from N(0, a) to N(0, b) (Gelbrich
    1990)."""
    values, vectors = np.linalg.eigh(a)
    root = np.sqrt(np.maximum(values, 1e-300))
    half = (vectors * root) @ vectors.T
    inverse = (vectors / root) @ vectors.T
    values, vectors = np.linalg.eigh(half @ b @ half)
    middle = (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
    return np.asarray(inverse @ middle @ inverse)
