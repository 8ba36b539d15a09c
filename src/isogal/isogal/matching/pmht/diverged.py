"""Whether the navigator is somewhere else: the readings of the last hour, hypotheses about places
anywhere, and their odds against the bank (docs/mathematics.md, section 9)."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import LOST_COVARIANCE
from isogal.matching.pmht.memory import DIVERGED_LOG_ODDS, Diverged, FieldMemory, Memory
from isogal.matching.pmht.models import NONE, few
from isogal.matching.pmht.places import carried, pruned, resolved, spread_over
from isogal.matching.pmht.rows import Rows, scans_of, usual_noise
from isogal.matching.pmht.search import Past, Search, places, unaided

SEARCH_SHARES = np.array([0.1, 0.3, 0.9])
"""Sigmas of the map's error by which places are searched for, in units of the largest."""
BEGINS, SAYS, GIVES_UP = -2.0, math.log(99.0), -5.0
"""Log odds at which hypotheses about a diverged navigator are carried along, at which it is told
so (a probability of 0.99), and at which they are dropped."""
SOON, EVERY, LATER, HOUR = 20, 60, 180, 3600.0
"""New readings to the next look: where another place was likelier than the navigator's own, else
within the first hour, else; and s that they go back."""
PLACES = 600
"""Hypotheses about a diverged navigator, at most."""


def remembered(
    diverged: Diverged, rows: Rows, forward: Array, evidence: float, time: float
) -> Diverged:
    """Return it with the new readings of a batch that ends at a time (s); `forward` (7, 7) error
    there per unit of error at the last batch end, `evidence` their log evidence by the bank."""
    nothing = np.zeros(BATCH_STATES)
    past = (*diverged.past, Past(rows, forward, nothing, evidence, time, diverged.start))
    return replace(diverged, past=past, wait=diverged.wait - scans_of(rows))


def pursued(
    diverged: Diverged, lead: FieldMemory, rows: Rows, field_map: AnyMap, evidence: float
) -> Diverged:
    """Return it after what has been found has taken new readings, or after a search where there is
    nothing and it is time for it; `evidence` is that of the bank."""
    found, grid = diverged.found, field_map.grid
    if found is None:
        return _searched(diverged, lead, field_map)
    found = found.split(grid, rows).observed(grid, rows)
    if not len(found):
        return replace(diverged, found=None)
    log_odds = diverged.log_odds + found.log_evidence - evidence
    if lead.bank is not None and log_odds < GIVES_UP:
        return replace(diverged, found=None)
    return replace(
        diverged, found=pruned(found, PLACES, rows.place[-1]).normalised(), log_odds=log_odds
    )


def _searched(diverged: Diverged, lead: FieldMemory, field_map: AnyMap) -> Diverged:
    search, lost = diverged.search, lead.bank is None
    if search is None:
        if not lost and diverged.wait > 0:
            return diverged
        diverged = replace(diverged, wait=EVERY if diverged.whole else LATER)
        if not lost and not _in_doubt(lead, diverged.past[-1].rows):
            return diverged
    rows, to_end, off = unaided(diverged.past)
    if search is None:
        models, prior = few(lead.models, SEARCH_SHARES), diverged.start
        if lost:
            begun, _ = places(rows, field_map, models, prior, prior)
        else:
            own = np.asarray(np.linalg.solve(to_end, -off), dtype=np.float64)
            least = BEGINS - DIVERGED_LOG_ODDS
            wide = prior + LOST_COVARIANCE
            begun, gain = places(rows, field_map, models, prior, wide, own, least)
            diverged = replace(diverged, wait=SOON if gain > 0.0 else diverged.wait)
        search = None if begun is None else Search(begun)
    else:
        search = search.continued(rows, field_map.grid, PLACES)
    if search is None or search.done < len(rows.level):
        return replace(diverged, search=search)
    log_odds = DIVERGED_LOG_ODDS + search.hypotheses.log_evidence
    log_odds -= sum(one.evidence for one in diverged.past)
    found = None
    if lost or log_odds > BEGINS:
        found = carried(search.hypotheses.normalised(), to_end, off)
    return replace(diverged, search=None, found=found, log_odds=log_odds)


def _in_doubt(lead: FieldMemory, rows: Rows) -> bool:
    """Whether readings and map differ by what a wrong place could explain: the map's error is
    larger than the noise, or something else is wrong."""
    bank = lead.bank
    assert bank is not None
    return bool(bank.map_error[0] > usual_noise(rows) or bank.faults[NONE] < 0.5)


def decided(memory: Memory, first: int) -> tuple[Memory, bool]:
    """Return the memory, with hypotheses at the place that has been found where that is certain,
    and whether the navigator is to be told that it has diverged."""
    diverged, bank = memory.diverged, memory.fields[first].bank
    found = diverged.found
    if found is None or not resolved(found) or (bank is not None and diverged.log_odds < SAYS):
        return memory, False
    fields = {
        index: replace(
            one, bank=spread_over(found, one.models).reduced(np.eye(2, one.states.count))
        )
        for index, one in memory.fields.items()
    }
    after = Diverged(diverged.start)
    return replace(memory, fields=fields, diverged=after), bank is not None


def after_fix(diverged: Diverged, taken: Array, covariance: Array) -> Diverged:
    """Return it after a fix that takes an error (7,) off the navigator's estimate, and leaves a
    covariance (7, 7)."""
    past, start, found = diverged.past, diverged.start, diverged.found
    whole = diverged.whole
    if past:
        past = (*past[:-1], replace(past[-1], taken=taken, left=covariance))
        while diverged.search is None and past[-1].time - past[0].time > HOUR:
            start, past, whole = past[0].left, past[1:], False
    else:
        start = covariance
    found = None if found is None else found.moved(taken)
    return replace(diverged, past=past, start=start, whole=whole, found=found)


def probability(diverged: Diverged) -> float:
    """Return that of what has been found."""
    return float(np.exp(-np.logaddexp(0.0, -diverged.log_odds)))
