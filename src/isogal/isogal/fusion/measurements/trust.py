"""How an aid wins back the trust that it has lost (docs/mathematics.md, section 3.13).

The gate alone could lock an aid out for good: a navigator that is wrong, and sure of itself,
rejects what would put it right."""

import numpy as np

from isogal.arrays import Array
from isogal.fusion.measurements.model import Innovation, Outcome, Rows, update_linear
from isogal.fusion.model import FilterModel, quantile
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
CONFIRMED = 3
"""Readings of gyroscopes that have to agree before a vehicle is taken to be at rest."""
VELOCITY, STANDSTILL = "velocity", "standstill"
"""What may be contradicted: all velocity aids by fixes, wheels that stand by gyroscopes."""


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
    """Update with rows of a velocity aid if those of a while have agreed with a navigator that did
    not use them."""
    left = state.contradicted[VELOCITY] - 1 if _agrees(state, rows) else AGREEING
    state.contradicted[VELOCITY] = left
    if left > 0:
        return untrusted(state, model, rows, VELOCITY, "fixes contradicted the navigator")
    del state.contradicted[VELOCITY]
    return update_linear(state, model, rows)


def standstill_waits(state: FilterState, gyroscopes: Rows, sudden: bool) -> bool:
    """Count a reading of wheels that stand, and return whether the gyroscopes have to agree with
    more before it is used, one after the other: a few, as the last turn may not be over, or
    many where it was so sudden that nothing stops like that."""
    left = state.contradicted.get(STANDSTILL)
    if left is None:
        left = AGREEING if sudden else CONFIRMED
    elif _agrees(state, gyroscopes):
        left = max(left - 1, 0)
    else:
        left = AGREEING if left > CONFIRMED else CONFIRMED
    state.contradicted[STANDSTILL] = left
    return left > 0


def _agrees(state: FilterState, rows: Rows) -> bool:
    """Whether rows are what a state expects, or nearly."""
    return squared(state, rows) <= quantile(AGREES, len(rows.measured))


def untrusted(
    state: FilterState, model: FilterModel, rows: Rows, aid: str, why: str
) -> Innovation:
    """Return what becomes of a reading that is not used until others have agreed."""
    reason = (
        f"{why}: the {aid} aid is not used until {state.contradicted[aid]} more readings agree"
    )
    apart, nis = rows.measured - rows.expected, squared(state, rows)
    allowed = model.gate(len(apart))
    return Innovation(Outcome.UNTRUSTED, apart, nis, allowed, rows.expected, reason)


def squared(state: FilterState, rows: Rows) -> float:
    """Return the normalised innovation squared of rows."""
    apart = rows.measured - rows.expected
    return float(apart @ np.linalg.solve(_spread(state, rows), apart))


def _spread(state: FilterState, rows: Rows) -> Array:
    """Return (m, m) the covariance of the innovation."""
    return np.asarray(rows.H @ state.covariance @ rows.H.T + rows.R)
