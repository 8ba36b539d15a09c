"""Whether the navigator is somewhere else: the readings of the last hour, hypotheses about places
anywhere, and their odds against the bank (docs/mathematics.md, section 9)."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import LOST_COVARIANCE
from isogal.matching.pmht.cells import SURE, Ranked, Seen
from isogal.matching.pmht.hypotheses import FLOOR, Hypotheses
from isogal.matching.pmht.memory import EVERY, LATER, Diverged, FieldMemory, Memory
from isogal.matching.pmht.models import DECEIVED, NONE, SIGMA_STEP, few
from isogal.matching.pmht.rows import Rows, usual_noise
from isogal.matching.pmht.search import WIDE_M, Search, resolved, spread_over, unaided

DIVERGED_LOG_ODDS = math.log(1e-3)
"""Of a navigator that has diverged, before any reading: one in a thousand."""
SAYS = math.log(SURE / (1.0 - SURE))
"""Log odds at which the bank is given up for what a search has found."""


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
        diverged = replace(diverged, look=now + wait)
        if begun is None:
            return diverged
        search = Search(begun, DIVERGED_LOG_ODDS)
    search = search.later(history, field_map.grid)
    if search is None or lost:
        return replace(diverged, search=search)
    if search.log_odds < DIVERGED_LOG_ODDS - FLOOR:
        return replace(diverged, search=None, look=now + LATER)
    worse = search.done == len(history) and search.log_odds < DIVERGED_LOG_ODDS
    return replace(diverged, search=None if worse else search)


def _wide(diverged: Diverged, lost: bool) -> Array:
    """Return (7, 7) the covariance of an error that is searched for."""
    wide = diverged.start.copy()
    if not lost:
        n = BATCH_STATES if not diverged.whole else 2
        wide[:n, :n] += LOST_COVARIANCE[:n, :n]
    return wide


def _ranked(
    diverged: Diverged, lead: FieldMemory, field_map: AnyMap, now: Array
) -> tuple[Ranked, float]:
    """Return all cells by the readings of the last hour, and how probable those are where a
    navigator of an error (7,) at the end of the last batch, before its fix, would be."""
    rows, since, A, b = unaided(diverged.past, diverged.start)
    seen = Seen.of(rows, since, field_map, few(lead.models, usual_noise(rows)))
    cells = Ranked.of(seen, _wide(diverged, lead.bank is None)[:2, :2])
    begin = np.asarray(np.linalg.solve(A, now - b), dtype=np.float64)
    return cells, cells.share(begin[:2], 4.0 * WIDE_M)


def _look(
    diverged: Diverged, lead: FieldMemory, field_map: AnyMap
) -> tuple[Hypotheses | None, float]:
    """Return hypotheses about places where the readings fit, None where there are too many, or
    where they fit at the navigator's own as well; and how long it is to the next look (s)."""
    lost = lead.bank is None
    cells, own = _ranked(diverged, lead, field_map, np.zeros(BATCH_STATES))
    if not lost and own > 1.0 - SURE:
        return None, LATER if own > 0.5 else EVERY
    fine = cells.finer()
    return None if fine is None else fine.hypotheses(_wide(diverged, lost)), EVERY


def _in_doubt(lead: FieldMemory, rows: Rows) -> bool:
    """Whether readings and map differ by what a wrong place could explain: the map's error is
    larger than the noise and than specified, or something else is wrong."""
    bank = lead.bank
    assert bank is not None
    expected = max(usual_noise(rows), lead.specified * SIGMA_STEP)
    return bool(bank.map_error[0] > expected or bank.faults[NONE] < 0.5)


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
    _, there = _ranked(diverged, lead, field_map, found.moments()[0])
    if there < 1.0 - SURE:
        return replace(memory, diverged=replace(diverged, search=None, look=-math.inf)), False
    return _at_place(memory, found), True


def undeceived(memory: Memory, first: int) -> tuple[Memory, bool]:
    """Return the memory, with hypotheses where the map says the navigator is where it is certain
    that satellites are wrong, and whether it is."""
    bank = memory.fields[first].bank
    if bank is None or not bank.faults[DECEIVED] > SURE:
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


def probability(log_odds: float) -> float:
    """Return that of what has such log odds."""
    return float(np.exp(-np.logaddexp(0.0, -log_odds)))
