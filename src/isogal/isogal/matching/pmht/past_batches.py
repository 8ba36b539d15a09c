"""What the monitor of lost navigators remembers of the past."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.inertial.error_state import BATCH_STATES, HORIZONTAL_STATES
from isogal.maps.channels import AnyMap
from isogal.matching.interfaces import Batch, Beside, Fix, Information
from isogal.matching.pmht.attitude import joint_prior
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.transitions import condition, unconditioned
from isogal.matrices import inverse, inverted, product

Effects = tuple[Array, Array]
"""Position errors (T, 2, 7) at a batch's rows, and what is in its readings (T, 7), per unit of the
navigator's error at its end."""


@dataclass(frozen=True, eq=False)
class PastBatch:
    """A batch that the navigator has dealt with; what follows from it alone is computed once, when
    it is first asked for."""

    batch: Batch
    """Its new readings alone, or where a search is to match, all those since the last such batch
    as new ones and older ones, with those of other fields."""
    field_map: AnyMap
    posterior: tuple[Array, Array]
    """Mean (7,) and covariance (7, 7) of the navigator's error before the fix, given what it was
    told."""
    log_evidence: float
    """Of its new readings."""
    searched: bool
    """Whether a search is to match it."""
    new: int
    """How many of its readings no earlier batch had used."""
    forward: Array
    """(7, 7) the navigator's error at its end per unit of that at the end of the batch before."""
    beside: tuple[Beside, ...] = ()
    """The new readings of other fields."""

    @classmethod
    def of(
        cls,
        batch: Batch,
        field_map: AnyMap,
        fix: Fix,
        log_evidence: float,
        before: "Sequence[PastBatch]" = (),
    ) -> "PastBatch":
        """Remember a batch after those before it."""
        told = fix.information if fix.published else None
        posterior = posterior_of(joint_prior(batch), told)
        stretch = _unsearched(before)
        count = sum(past.new for past in stretch) + batch.new
        enough = CONSTANTS.search_readings * batch.rows_per_scan
        searched = count >= enough or count + batch.new > len(batch)
        searched = searched or batch.backward is None
        kept, others = batch.part(len(batch) - batch.new), tuple(map(_new_ones, batch.beside))
        if searched:
            since = {
                one.field: sum(
                    each.batch.new
                    for past in stretch
                    for each in past.beside
                    if each.field == one.field
                )
                for one in batch.beside
            }
            whole = [
                replace(one, batch=_with_new(one.batch, since[one.field] + one.batch.new))
                for one in batch.beside
            ]
            kept = replace(_with_new(batch, count), beside=tuple(whole))
        forward = error_after(batch)
        return cls(kept, field_map, posterior, log_evidence, searched, batch.new, forward, others)

    @cached_property
    def prior(self) -> Array:
        """(7, 7) the navigator's covariance at its end, before the fix."""
        return joint_prior(self.batch)

    @cached_property
    def new_readings(self) -> Batch:
        """Its readings that no earlier batch had used."""
        return self.batch.part(max(len(self.batch) - self.new, self.batch.cut))

    def new_of(self, field: int | None) -> Batch | None:
        """Return the new readings of a field beside, or (None) its own; None where there are
        none."""
        if field is None:
            return self.new_readings
        return next((one.batch for one in self.beside if one.field == field), None)

    @cached_property
    def effects(self) -> dict[int | None, Effects]:
        """Of the new readings of each field (`new_of`)."""
        found: dict[int | None, Effects] = {None: effects_of(self.new_readings)}
        return found | {one.field: effects_of(one.batch) for one in self.beside}


def _unsearched(history: Sequence[PastBatch]) -> Sequence[PastBatch]:
    """Return the last ones, since that which a search would match."""
    first = len(history)
    while first and not history[first - 1].searched:
        first -= 1
    return history[first:]


def _new_ones(beside: Beside) -> Beside:
    """Return the new readings of another field."""
    batch = beside.batch
    return replace(beside, batch=batch.part(max(len(batch) - batch.new, batch.cut)))


def recent(history: tuple[PastBatch, ...]) -> tuple[PastBatch, ...]:
    """Return the last batches: whole stretches that a search would match, of so many readings at
    most."""
    count, first = 0, len(history)
    for k in range(len(history) - 1, -1, -1):
        count += history[k].new
        if count > CONSTANTS.remembered_readings:
            break
        if k == 0 or history[k - 1].searched:
            first = k
    return history[first:]


def without_fixes(history: Sequence[PastBatch], field: int | None = None) -> list[Batch | None]:
    """Return the new readings of batches as a navigator would have them that has taken none of
    the fixes since the first; see `PastBatch.new_of`."""
    seen = []
    for past, shift in zip(history, taken_before(history), strict=True):
        one = past.new_of(field)
        seen.append(None if one is None else _moved(one, past.effects[field], shift))
    return seen


def taken_before(history: Sequence[PastBatch]) -> list[Array]:
    """Return what fixes since the first have added to the estimate before each batch's, (7,)."""
    shifts, shift = [], np.zeros(BATCH_STATES)
    for k, past in enumerate(history):
        shift = past.forward @ shift if k else shift
        shifts.append(shift)
        shift = shift - past.posterior[0]  # the fix takes its mean error away
    return shifts


def effects_of(batch: Batch) -> Effects:
    """Return what the navigator's error does to a batch; of one without attitude, what the tilts
    do is 0."""
    if batch.attitude is not None:
        known = batch.attitude[1].shape[1]  # behind it: what the matcher itself has added
        rows = np.concatenate([batch.transition, batch.reading_jacobian[:, None]], axis=1)
        drift = [batch.nuisance_position, batch.nuisance_reading[:, None]]
        whole = unconditioned(batch, rows, np.concatenate(drift, axis=1)[..., :known])
        return whole[:, :2], whole[:, 2]
    by_tilt = np.zeros((len(batch), 2, BATCH_STATES - batch.transition.shape[2]))
    return (
        np.concatenate([batch.transition, by_tilt], axis=2),
        np.concatenate([batch.reading_jacobian, by_tilt[:, 0]], axis=1),
    )


def _moved(batch: Batch, effects: Effects, shift: Array) -> Batch:
    """Return a batch's rows with a shift (7,) at its end taken off."""
    moved = effects[0] @ shift
    north, east = metres_per_radian(batch.latitude)
    return replace(
        batch,
        latitude=batch.latitude - moved[:, 0] / north,
        longitude=batch.longitude - moved[:, 1] / east,
        reading=batch.reading - effects[1] @ shift,
    )


def _with_new(batch: Batch, new: int) -> Batch:
    """Return the batch with so many of its last readings new."""
    channels = batch.rows_per_scan
    new = min(new, len(batch))
    before = len(batch) - new - 1
    if batch.backward is None or before < 0 or new == batch.new:
        return (
            batch
            if new == batch.new
            else replace(batch, new=new, back_transition=None, back_nuisance=None)
        )
    beside = batch.nuisance_reading.shape[1] - BATCH_STATES + HORIZONTAL_STATES
    back, nuisance = condition(
        batch.backward[None, before // channels * channels],
        joint_prior(batch),
        np.zeros((1, BATCH_STATES, beside)),
    )
    return replace(batch, new=new, back_transition=back[0], back_nuisance=nuisance[0])


def error_before(batch: Batch) -> Array:
    """Return (7, 7) the error at the end of the batch before per unit of error at this one's; a
    first batch has none.
    """
    if batch.back_transition is None or batch.back_nuisance is None:
        return np.eye(BATCH_STATES)
    if batch.backward is not None:
        return batch.backward[len(batch) - batch.new - 1]
    return unconditioned(batch, batch.back_transition, batch.back_nuisance)


@lru_cache(maxsize=4)  # several ask it of the same batch
def error_after(batch: Batch) -> Array:
    """Return (7, 7) the error at a batch's end per unit of error at the end of the batch before.
    Not to be written to."""
    return inverse(error_before(batch))


def placeless(covariance: Array) -> bool:
    """Whether a navigator of a covariance (n, n), north and east first, knows that it is lost."""
    return float(np.trace(covariance[:2, :2])) > CONSTANTS.lost_m**2


def posterior_of(prior: Array, information: Information | None) -> tuple[Array, Array]:
    """Return mean (7,) and covariance (7, 7) of the error N(0, prior) given the information."""
    if information is None:
        return np.zeros(BATCH_STATES), prior
    told = np.ascontiguousarray(information.vector), np.ascontiguousarray(information.matrix)
    mean, covariance = _informed(np.ascontiguousarray(prior), *told)
    if not np.isfinite(covariance[0, 0]):
        raise np.linalg.LinAlgError("Singular matrix")
    return mean, covariance


@kernel
def _informed(prior, vector, matrix):  # type: ignore[no-untyped-def]
    """Return `posterior_of`: (P⁻¹ + M)⁻¹ without inverting P, whose velocity part may be tiny."""
    n = prior.shape[0]
    inner = product(prior, matrix)
    for i in range(n):
        inner[i, i] += 1.0
    whole = product(inverted(inner), prior)
    mean, covariance = np.zeros(n), np.empty((n, n))
    for i in range(n):
        for j in range(n):
            mean[i] += whole[i, j] * vector[j]
            covariance[i, j] = 0.5 * (whole[i, j] + whole[j, i])
    return mean, covariance


def seen_from(batch: Batch, shift: Array, covariance: Array) -> Batch:
    """Return the batch as another navigator would have it.

    Parameters
    ----------
    batch : Batch
        With attitude.
    shift : (7,) array
        Estimate of the batch's navigator minus that of the other one, at the batch end.
    covariance : (7, 7) array
        Of the other one's error there.

    Returns
    -------
    Batch
        Without the scans before a gap in the inertial data: what they say of the error at the end
        is by the navigator's own covariance.
    """
    beside = tuple(
        replace(one, batch=seen_from(one.batch, shift, covariance)) for one in batch.beside
    )
    back = error_before(batch)[None]
    batch = batch.part(batch.cut) if batch.cut else batch
    position, reading = effects_of(batch)
    moved = position @ shift
    north, east = metres_per_radian(batch.latitude)
    rows = np.concatenate([position, reading[:, None]], axis=1)
    apart = _apart(batch)
    by_xi, nuisance = condition(rows, covariance, apart[0])
    back, back_nuisance = condition(back, covariance, apart[1])
    level, level_nuisance = condition(np.eye(BATCH_STATES)[None, 4:], covariance, apart[2])
    end = batch.end
    to_north, to_east = metres_per_radian(end[0])
    return replace(
        batch,
        end_place=(end[0] - float(shift[0] / to_north), end[1] - float(shift[1] / to_east)),
        latitude=batch.latitude - moved[:, 0] / north,
        longitude=batch.longitude - moved[:, 1] / east,
        reading=batch.reading - reading @ shift,
        transition=np.ascontiguousarray(by_xi[:, :2]),
        reading_jacobian=np.ascontiguousarray(by_xi[:, 2]),
        nuisance_position=np.ascontiguousarray(nuisance[:, :2]),
        nuisance_reading=np.ascontiguousarray(nuisance[:, 2]),
        prior=covariance[:4, :4],
        back_transition=None if batch.back_transition is None else back[0],
        back_nuisance=None if batch.back_nuisance is None else back_nuisance[0],
        attitude=(level[0], level_nuisance[0]),
        beside=beside,
    )


def _apart(batch: Batch) -> tuple[Array, Array, Array]:
    """Return what moves a batch's rows (T, 3, K), the error at the end of the batch before (1, 7,
    K) and the attitude at its own (1, 3, K) beside the navigator's error at the end."""
    assert batch.attitude is not None
    level = np.abs(batch.attitude[1]).max(axis=0)
    moves = (level == 0.0) & (np.abs(batch.nuisance_position).max(axis=(0, 1)) > 0.0)
    rows = np.concatenate([batch.nuisance_position, batch.nuisance_reading[:, None]], axis=1)
    back = np.zeros((BATCH_STATES, moves.size))
    if batch.back_nuisance is not None:
        back = batch.back_nuisance
    return rows[..., moves], back[None][..., moves], np.zeros((1, 3, int(moves.sum())))
