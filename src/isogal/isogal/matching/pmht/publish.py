"""The fix of a batch: what its readings alone say (docs/mathematics.md, section 7)."""

from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.quantities import GRAVITY
from isogal.maps.variability import feature_variability
from isogal.matching.expansion import first_channel
from isogal.matching.failures import UNEXPLAINED
from isogal.matching.information import (
    informed,
    likelihood_information,
    measurement_only,
    shares,
)
from isogal.matching.interfaces import (
    SATELLITES,
    Candidates,
    Fix,
    Information,
    SecondaryBatch,
    declined,
    located,
    with_scans,
)
from isogal.matching.pmht.hypotheses import Hypotheses
from isogal.matching.pmht.memory import Memory
from isogal.matching.pmht.models import FAMILIES

LEAST_GAIN = 0.1
"""Share by which the 1-sigma of a navigator with satellites becomes smaller by a fix at least."""
NOTHING_NEW = "the batch tells nothing that the navigator does not know"
SHOWN = 64
"""Hypotheses that are shown as candidates, at most."""


def total(parts: Iterable[Information]) -> Information:
    """Return what all of some readings say of the navigator's error, by what each adds."""
    vector, matrix = np.zeros(BATCH_STATES), np.zeros((BATCH_STATES, BATCH_STATES))
    for one in parts:
        vector, matrix = vector + one.vector, matrix + one.matrix
    return Information(vector, matrix)


def added(bank: Hypotheses, prior: Array, known: Information) -> Information:
    """Return what readings add to what is known that make a navigator N(0, prior), informed by
    that, what their bank says."""
    mean, before = informed(prior, known)
    after, covariance = bank.credible().moments()
    own = likelihood_information(after - mean, covariance, before)
    return Information(own.vector + own.matrix @ mean, own.matrix)


def published(
    each: Sequence[SecondaryBatch],
    memory: Memory,
    prior: Array,
    information: Information,
    names: Sequence[str],
    each_scan: bool,
    astray: str | None,
) -> tuple[Fix, Memory]:
    """Return the fix of a batch, and the memory of a navigator that takes it.

    Parameters
    ----------
    each : sequence of SecondaryBatch
        The batch of the first field, and those of others.
    prior : (7, 7) array
        Covariance of the navigator, widened where it has diverged.
    information : Information
        What the readings of all fields say.
    each_scan : bool
        Whether it says what each scan is given of it (retrodiction).
    astray : str, optional
        Why there is to be no fix, in one line.
    """
    batch = each[0].batch
    figures = _figures(each, memory, names)
    error = _gravity_error(each, memory)
    aided = batch.history.aided
    reason = astray or (SATELLITES if aided else NOTHING_NEW)
    mean, covariance = informed(prior, information)
    new = information.matrix.any() and (not aided or adds(prior, covariance))
    if astray or not new:
        fix = replace(declined(batch, reason, **figures), map_error=error)
        return fix, memory.after(np.zeros(BATCH_STATES), prior)
    place, spread = measurement_only(mean[:4], covariance[:4, :4], prior[:4, :4])
    bank = memory.fields[each[0].field].bank
    assert bank is not None
    fix = located(
        batch,
        place,
        spread,
        shown=lambda: _candidates(each[0], bank),
        diagnostics=figures,
        information=information,
        map_error=error,
    )
    if each_scan:
        fix = _of_each_scan(fix, each[0], information, prior, mean)
    return fix, memory.after(mean, covariance)


def adds(prior: Array, covariance: Array) -> bool:
    """Whether readings make a navigator of covariance `prior` (7, 7), which has one of
    `covariance` with them, more certain of its place by as much as is worth telling it.

    What is not told stays in the bank, and is told when there are no satellites. A navigator
    between satellites that are wrong and a map that pulls it away from them would have errors that
    its covariance says nothing of, and nobody could tell any more which of both is wrong."""
    before, after = (float(np.linalg.det(one[:2, :2])) for one in (prior, covariance))
    return after < (1.0 - LEAST_GAIN) ** 4 * before


def _gravity_error(each: Sequence[SecondaryBatch], memory: Memory) -> tuple[float, float] | None:
    """Return sigma (m/s²) and correlation length (m) of the gravity map's error, as readings have
    shown them; None where it is specified that there is none."""
    for one in each:
        bank = memory.fields[one.field].bank
        if one.field_map.quantity in GRAVITY and bank is not None:
            sigma, length = bank.map_error
            return (sigma, length) if sigma > 0.0 else None
    return None


def _candidates(one: SecondaryBatch, bank: Hypotheses) -> Candidates:
    """Return where the likeliest hypotheses have each scan of the batch."""
    each, _ = first_channel(one.batch, one.field_map)
    best = np.argsort(-bank.log_weight)[:SHOWN]
    weight = np.exp(bank.log_weight[best])
    moved = np.einsum("tij,kj->tki", each.by_error[:, :2], bank.mean[best, :BATCH_STATES])
    north, east = metres_per_radian(each.latitude)
    count = len(each)
    return Candidates(
        (each.latitude[:, None] - moved[..., 0] / north[:, None]).ravel(),
        (each.longitude[:, None] - moved[..., 1] / east[:, None]).ravel(),
        np.tile(weight / weight.sum(), count),
        np.repeat(np.arange(count), len(best)),
    )


def _of_each_scan(
    fix: Fix, one: SecondaryBatch, information: Information, prior: Array, mean: Array
) -> Fix:
    """Return the fix with what it says at each scan, for retrodiction."""
    each, _ = first_channel(one.batch, one.field_map)  # each scan once
    parts: list[Information | None] = [None] * (len(each) - each.new)
    parts += shares(information, prior, each.backward[len(parts) :])
    fix = with_scans(fix, each, each.by_error[:, :2] @ mean)
    return replace(fix, scan_information=tuple(parts))


def _figures(
    each: Sequence[SecondaryBatch], memory: Memory, names: Sequence[str]
) -> dict[str, float]:
    """Return what the diagnostics say: of the first field, and of others with their names."""
    figures: dict[str, float] = {}
    for one in each:
        field = memory.fields[one.field]
        if field.bank is None:
            continue
        prefix = "" if one is each[0] else f"{names[one.field]}."
        sigma, length = field.bank.map_error
        of_field = {"map_sigma": sigma, "map_correlation_length_m": length}
        of_field[UNEXPLAINED] = field.bank.unexplained
        of_field |= dict(zip(FAMILIES[1:], map(float, field.bank.faults[1:]), strict=True))
        of_field |= field.bank.figures(field.states)
        figures |= {prefix + name: value for name, value in of_field.items()}
    batch, field_map = each[0].batch, first_channel(each[0].batch, each[0].field_map)[1]
    bank = memory.fields[each[0].field].bank
    figures["hypotheses"] = float(0 if bank is None else len(bank))
    place = batch.latitude[-1:], batch.longitude[-1:]
    figures["feature_variability"] = float(feature_variability(field_map, *place)[0])
    search = memory.diverged.search
    if search is not None and memory.diverged.found is not None:
        figures["diverged"] = float(np.exp(-np.logaddexp(0.0, -search.log_odds)))
    return figures
