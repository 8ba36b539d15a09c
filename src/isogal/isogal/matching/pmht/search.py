"""Hypotheses about a navigator that may be anywhere: where its start is specified as uncertain by
kilometres, or where the readings of the last hour say that it has diverged.

The best cells of a grid (`cells.py`) become hypotheses of few models, which follow the navigator
through the batches of the last hour; their odds against the bank say whether it is there.
docs/mathematics.md, section 9.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import LOST_COVARIANCE
from isogal.matching.pmht.cells import FEATURE_M, PLACES, Ranked, Seen
from isogal.matching.pmht.hypotheses import FLOOR, NEGLIGIBLE, Hypotheses, at_same_time
from isogal.matching.pmht.models import NONE, RARE, SIGMA_STEP, UNHEARD_OF, Models, few
from isogal.matching.pmht.rows import Epoch, Rows, parts_of, together, usual_noise
from isogal.matching.pmht.states import States

WORK = 10000
"""Readings times hypotheses of the usual number of states that a search goes through with one
batch, 0.15 s; with 8000 a place on a map of 3 mGal is found 2 minutes later than with 20000."""

WIDE_M, FEW = FEATURE_M / 4.0, 24
"""1-sigma of a place, along an axis, above which it is searched for and below which it is found;
and how many hypotheses stand for it at most."""
HOUR = 3600.0
"""s that a search goes back."""
EVERY, LATER = 200.0, HOUR / 2.0
"""s from one look for other places to the next, and where it has found the navigator where it
believes to be. Later looks find later a navigator that has diverged, earlier ones take as long
as the fixes."""
LIKELY = 0.5
"""Probability of the cells about a place from which on the readings of an hour speak for it."""
THIRD = np.array([1.0, -3.0, 3.0, -1.0])
"""What a third difference is of four readings."""
DIVERGED_LOG_ODDS = math.log(UNHEARD_OF)
"""Of a navigator that has diverged, before any reading."""


class FieldMemory(NamedTuple):
    """Of one field."""

    states: States
    models: Models
    shapes: tuple[Array, Array]
    """`Models.shapes`, found once."""
    bank: Hypotheses | None
    """About the navigator as it is; None = its place is searched for."""
    epoch: Epoch | None = None
    specified: float = 0.0
    """1-sigma of the map's error as specified, map's unit; 0 = it is not."""


class Past(NamedTuple):
    """What became of the navigator over a batch, and its new readings."""

    forward: Array
    """(7, 7) error at its end before its fix per unit of error at the last batch end."""
    growth: Array
    """(7, 7) what has joined the navigator's covariance."""
    left: Array
    """(7, 7) covariance of the navigator after its fix."""
    time: float
    """s, its end."""
    taken: Array = np.zeros(BATCH_STATES)
    """(7,) what its fix took off the error."""
    rows: Rows | None = None
    """None = there was no reading."""
    evidence: float = 0.0
    """Log evidence of its readings given those before, by the bank."""


def unaided(history: Sequence[Past], start: Array) -> tuple[Rows, Array, Array, Array]:
    """Return the readings of some batches as those of a navigator that has taken none of their
    fixes, per unit of its error x before the first of them; (n, 7, 7) the covariance that x has at
    each of them beside its place, what has joined it since being put into x; and (7, 7) and (7,)
    the error of the real navigator at the end, A x + b.

    Parameters
    ----------
    history : sequence of Past
    start : (7, 7) array
        Covariance of the navigator before the first of them.
    """
    n = BATCH_STATES
    forward, ahead = list[Array](), list[Array]()
    A, b = np.eye(n), np.zeros(n)
    for past in history:
        A, b = past.forward @ A, past.forward @ b
        forward.append(A)
        ahead.append(b)
        b = b - past.taken
    back = np.linalg.inv(forward)
    rest = start.copy()
    rest[:2], rest[:, :2] = 0.0, 0.0
    grown = np.stack([past.growth for past in history])
    since = rest + np.cumsum(back @ grown @ back.swapaxes(1, 2), axis=0)
    read = [(k, past.rows) for k, past in enumerate(history) if past.rows is not None]
    rows = together([one for _, one in read])
    each = np.concatenate([np.full(len(one.level), k) for k, one in read])
    of_place, of_reading = rows.place[:, :, :n], rows.reading[:, :n]
    error, to_first = np.stack(ahead)[each], np.stack(forward)[each]
    moved = np.einsum("tij,tj->ti", of_place, error)
    place, reading = rows.place.copy(), rows.reading.copy()
    place[:, :, :n] = of_place @ to_first
    reading[:, :n] = np.einsum("ti,tij->tj", of_reading, to_first)
    whole = rows._replace(
        latitude=rows.latitude - moved[:, 0] * rows.radian[:, 0],
        longitude=rows.longitude - moved[:, 1] * rows.radian[:, 1],
        level=rows.level - np.einsum("ti,ti->t", of_reading, error),
        place=place,
        reading=reading,
    )
    return whole, since[each], A, b


class Search(NamedTuple):
    """Hypotheses about a navigator that may be anywhere, on their way through the batches of the
    last hour."""

    hypotheses: Hypotheses
    """About its error at the end of the last batch that they have come to, before its fix; before
    the first one about that before it."""
    log_odds: float
    """Of them against the bank, by the readings of these batches."""
    done: int = 0
    """How many batches that are."""

    def later(self, history: Sequence[Past], field_map: AnyMap) -> "Search | None":
        """Return it after some more batches; None where no hypothesis is left on the map.

        Parameters
        ----------
        history : sequence of Past
            All batches.
        """
        them, log_odds, done, work = self.hypotheses, self.log_odds, self.done, 0.0
        share = at_same_time(them.mean.shape[1])
        most = round(PLACES * share)
        while done < len(history) and work < WORK:
            past = history[done]
            them = them.moved(history[done - 1].taken) if done else them
            them = them.carried(past.forward, past.growth)
            for part in [] if past.rows is None else parts_of(past.rows):
                work += len(them) * len(part.level) / share
                them = them.split(field_map, part, 2 * most).observed(field_map, part)
                if not len(them):
                    return None
                them = pruned(them, most, part.place[-1])
            log_odds += them.log_evidence - past.evidence
            them, done = them.normalised(), done + 1
        return Search(them, log_odds, done)


def pruned(them: Hypotheses, most: int, of_place: Array) -> Hypotheses:
    """Merge places (`Hypotheses.merged`) and drop what is negligible, whatever its model; weights
    stay as they are."""
    kept = np.argsort(-them.log_weight)[:most]
    kept = kept[them.log_weight[kept] > them.log_weight[kept[0]] - NEGLIGIBLE]
    return them.merged(kept[np.argsort(them.which[kept], kind="stable")], of_place)


def resolved(them: Hypotheses) -> bool:
    """Whether what is probable is one place."""
    covariance = them.moments()[1]
    return bool(covariance[0, 0] + covariance[1, 1] < 2.0 * WIDE_M**2)


class Diverged(NamedTuple):
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
        return cls(prior, (Past(same, nothing, prior, time),), time + EVERY)

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
            search = None if search is None else search._replace(done=search.done - 1)
        return self._replace(past=past, start=start, whole=whole, search=search)

    @property
    def last(self) -> Past:
        """The last batch."""
        return self.past[-1]

    def with_last(self, last: Past) -> "Diverged":
        """Return it with another last batch."""
        return self._replace(past=(*self.past[:-1], last))


def pursued(diverged: Diverged, lead: FieldMemory, field_map: AnyMap) -> Diverged:
    """Return it after the hypotheses about places have taken more readings, or after a look where
    there are none and it is time for one."""
    history, search = diverged.past, diverged.search
    rows, now, lost = history[-1].rows, history[-1].time, lead.bank is None
    if search is None:
        if lost and all(one.rows is None for one in history):
            return diverged
        if not lost and (now < diverged.look or rows is None or not _in_doubt(lead, rows)):
            return diverged
        begun, wait = _look(diverged, lead, field_map)
        diverged = diverged._replace(look=now + wait)
        if begun is None:
            return diverged
        search = Search(begun, DIVERGED_LOG_ODDS)
    search = search.later(history, field_map)
    if search is None or lost:
        return diverged._replace(search=search)
    if search.log_odds < DIVERGED_LOG_ODDS - FLOOR:
        return diverged._replace(search=None, look=now + LATER)
    worse = search.done == len(history) and search.log_odds < DIVERGED_LOG_ODDS
    return diverged._replace(search=None if worse else search)


def _wide(diverged: Diverged, lost: bool) -> Array:
    """Return (7, 7) the covariance of an error that is searched for."""
    wide = diverged.start.copy()
    if not lost:
        n = BATCH_STATES if not diverged.whole else 2
        wide[:n, :n] += LOST_COVARIANCE[:n, :n]
    return wide


def probability_at(diverged: Diverged, lead: FieldMemory, field_map: AnyMap, now: Array) -> float:
    """Return how probable, by the readings of the last hour, large cells are where a navigator of
    an error (7,) at the end of the last batch, before its fix, would be."""
    seen, A, b = _seen(diverged, lead, field_map)
    return _share(seen, A, b, now, _wide(diverged, lead.bank is None))


def _seen(diverged: Diverged, lead: FieldMemory, field_map: AnyMap) -> tuple[Seen, Array, Array]:
    """Return what cells are ranked by, and A and b of `unaided`.

    Readings with a bias fit at many more places: they may have one where an hour of readings has
    not been enough."""
    rows, since, A, b = unaided(diverged.past, diverged.start)
    models = few(lead.models, usual_noise(rows), noisiest(rows), not diverged.whole)
    return Seen.of(rows, since, field_map, models), A, b


def noisiest(rows: Rows) -> float:
    """Return the largest factor of the noise's variance for which readings do not change too
    little from one to the next, whatever else they show: by the chi-square density of the mean
    square of third differences, which are not independent of each other."""
    least = math.inf
    for channel in np.unique(rows.channel):
        those = rows.channel == channel
        third = np.diff(rows.level[those], n=3)
        if len(third):
            variance = np.convolve(rows.noise[those], THIRD**2, "valid")
            freedom = len(third) / (np.correlate(THIRD, THIRD, "full") ** 2).sum() * 20.0**2
            fewest = 2.0 * float(gammaincinv(0.5 * freedom, UNHEARD_OF))
            least = min(least, freedom * float(np.mean(third**2 / variance)) / fewest)
    return least


def _share(seen: Seen, A: Array, b: Array, now: Array, wide: Array) -> float:
    cells = Ranked.of(seen, wide[:2, :2], FEATURE_M)
    begin = np.asarray(np.linalg.solve(A, now - b), dtype=np.float64)
    return cells.share(begin[:2], 4.0 * WIDE_M)


def _look(
    diverged: Diverged, lead: FieldMemory, field_map: AnyMap
) -> tuple[Hypotheses | None, float]:
    """Return hypotheses about places where the readings fit, None where there are too many, or
    where they fit at the navigator's own as well; and how long it is to the next look (s)."""
    lost = lead.bank is None
    wide = _wide(diverged, lost)
    seen, A, b = _seen(diverged, lead, field_map)
    if not lost:
        own = _share(seen, A, b, np.zeros(BATCH_STATES), wide)
        if own > RARE:
            return None, LATER if own > LIKELY else EVERY
    fine = Ranked.of(seen, wide[:2, :2], 0.5 * FEATURE_M).finer()
    return None if fine is None else fine.hypotheses(wide), EVERY


def _in_doubt(lead: FieldMemory, rows: Rows) -> bool:
    """Whether readings and map differ by what a wrong place could explain: the map's error is
    larger than the noise and than specified, or something else is wrong."""
    bank = lead.bank
    assert bank is not None
    expected = max(usual_noise(rows), lead.specified * SIGMA_STEP)
    return bool(bank.map_error[0] > expected or bank.faults[NONE] < 0.5)


def spread_over(them: Hypotheses, models: Models) -> Hypotheses:
    """Return the same places under other models, of which nothing is known yet."""
    them = pruned(them, FEW, np.eye(2, them.mean.shape[1]))
    count, m, n = len(them), len(models.sigma), BATCH_STATES
    mean, covariance = (
        np.repeat(a, m, axis=0) for a in (them.mean[:, :n], them.covariance[:, :n, :n])
    )
    weight = (them.log_weight[:, None] + models.log_prior).ravel()
    return Hypotheses.of(models, np.tile(np.arange(m), count), weight, mean, covariance)
