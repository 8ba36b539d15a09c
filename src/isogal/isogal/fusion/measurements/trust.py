"""How an aid wins back the trust that it has lost (docs/mathematics.md, section 3.13).

The gate alone could lock an aid out for good: a navigator that is wrong, and sure of itself,
rejects what would put it right."""

import numpy as np

from isogal.arrays import Array
from isogal.fusion.gate import quantile
from isogal.fusion.measurements.model import Innovation, Outcome, Rows, update_linear
from isogal.fusion.model import FilterModel
from isogal.fusion.state import FilterState

INSISTS = 30
"""Readings beyond the gate, one after the other, from which on the navigator is doubted: fewer are
spikes."""
NEAR = 4.0
"""How many times the allowed normalised innovation squared an aid that insists may be off, 12
sigmas in one dimension: another unit, a broken sensor are farther."""
AGREEING = 60
"""Readings, one after the other, that have to agree before an aid is used that fixes have
contradicted: a navigator that is right shows one that is wrong by more than the velocity that it
loses in the time meanwhile; of one that loses more the aid knows more, and is to be used."""
AGREES = 0.01
"""Probability that a true reading does not agree."""


def update_insistent(state: FilterState, model: FilterModel, rows: Rows, aid: str) -> Innovation:
    """Update with rows of an aid (its name), as `update_linear`. One that insists is used with so
    much more noise that it is just within the gate."""
    result = update_linear(state, model, rows)
    if result.outcome is not Outcome.REJECTED:
        state.insisting.pop(aid, None)
        return result
    state.insisting[aid] = state.insisting.get(aid, 0) + 1
    if state.insisting[aid] < INSISTS or result.nis > NEAR * result.allowed:
        return result
    excess = 1.001 * result.nis / result.allowed - 1.0
    return update_linear(state, model, rows._replace(R=rows.R + excess * _spread(state, rows)))


def update_once_it_agrees(state: FilterState, model: FilterModel, rows: Rows) -> Innovation:
    """Update with rows if those of a while have agreed with a navigator that did not use them."""
    apart = rows.measured - rows.expected
    nis = float(apart @ np.linalg.solve(_spread(state, rows), apart))
    agrees = nis <= quantile(AGREES, len(apart))
    state.contradicted = state.contradicted - 1 if agrees else AGREEING
    if state.contradicted == 0:
        return update_linear(state, model, rows)
    reason = (
        "fixes contradicted the navigator: the velocity aid is not used until"
        f" {state.contradicted} more readings agree"
    )
    allowed = model.gate(len(apart))
    return Innovation(Outcome.UNTRUSTED, apart, nis, allowed, rows.expected, reason)


def _spread(state: FilterState, rows: Rows) -> Array:
    """Return (m, m) the covariance of the innovation."""
    return np.asarray(rows.H @ state.covariance @ rows.H.T + rows.R)
