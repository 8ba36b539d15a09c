"""Whether the navigator is somewhere else: the readings of the last hour, hypotheses about places
anywhere, and their odds against the bank (docs/mathematics.md, section 9)."""

import math
from dataclasses import replace

import numpy as np

from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import LOST_COVARIANCE
from isogal.matching.pmht.memory import Diverged, FieldMemory, Memory
from isogal.matching.pmht.models import NONE, few
from isogal.matching.pmht.places import resolved, spread_over
from isogal.matching.pmht.rows import Rows, scans_of, usual_noise
from isogal.matching.pmht.search import SURE, Search, places, unaided

DIVERGED_LOG_ODDS = math.log(1e-3)
"""Of a navigator that has diverged, before any reading: one in a thousand."""
SAYS = math.log(SURE / (1.0 - SURE))
"""Log odds at which it is told so."""
EVERY = 20
"""New readings from one look to the next."""
PLACES = 600
"""Hypotheses about a diverged navigator, at most."""


def pursued(diverged: Diverged, lead: FieldMemory, field_map: AnyMap) -> Diverged:
    """Return it after the hypotheses about places have taken more readings, or after a look where
    there are none and it is time for one."""
    history, start, search = diverged.past, diverged.start, diverged.search
    rows, lost = history[-1].rows, lead.bank is None
    if rows is not None:
        diverged = replace(diverged, wait=diverged.wait - scans_of(rows))
    if search is None:
        if not lost:
            if diverged.wait > 0 or rows is None or not _in_doubt(lead, rows):
                return diverged
            diverged = replace(diverged, wait=EVERY)
        elif all(one.rows is None for one in history):
            return diverged
        seen, since, own = unaided(history, start)
        models = few(lead.models, usual_noise(seen))
        wide = start if lost else start + LOST_COVARIANCE
        begun, _ = places(seen, since, field_map, models, wide, None if lost else own)
        if begun is None:
            return diverged
        search = Search(begun, DIVERGED_LOG_ODDS)
    search = search.later(history, field_map.grid, PLACES)
    if search is not None and search.done == len(history) and not lost:
        search = search if search.log_odds > DIVERGED_LOG_ODDS else None
    return replace(diverged, search=search)


def _in_doubt(lead: FieldMemory, rows: Rows) -> bool:
    """Whether readings and map differ by what a wrong place could explain: the map's error is
    larger than the noise, or something else is wrong."""
    bank = lead.bank
    assert bank is not None
    return bool(bank.map_error[0] > usual_noise(rows) or bank.faults[NONE] < 0.5)


def decided(memory: Memory, first: int) -> tuple[Memory, bool]:
    """Return the memory, with hypotheses at the place that has been found where that is certain,
    and whether the navigator is to be told that it has diverged."""
    search, found = memory.diverged.search, memory.diverged.found
    known = memory.fields[first].bank is not None
    if search is None or found is None or not resolved(found):
        return memory, False
    if known and search.log_odds < SAYS:
        return memory, False
    fields = {
        index: replace(one, bank=spread_over(found, one.models).reduced())
        for index, one in memory.fields.items()
    }
    last = memory.diverged.past[-1]
    diverged = Diverged.before(memory.covariance, last.time)
    return replace(memory, fields=fields, diverged=diverged), known


def probability(log_odds: float) -> float:
    """Return that of what has such log odds."""
    return float(np.exp(-np.logaddexp(0.0, -log_odds)))
