"""Hypotheses about a navigator that may be anywhere: where its start is specified as uncertain by
kilometres, or where the readings of the last hour say that it has diverged.

The best cells of a grid (`cells.py`) become hypotheses of few models, which follow the navigator
through the batches of the last hour. docs/mathematics.md, section 9.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.interpolation import Grid
from isogal.matching.pmht.cells import PLACES
from isogal.matching.pmht.hypotheses import NEGLIGIBLE, Hypotheses, at_same_time
from isogal.matching.pmht.models import Models
from isogal.matching.pmht.rows import OF_LENGTHS, Rows, parts_of

WORK = 10000
"""Readings times hypotheses of the usual number of states that a search goes through with one
batch, 0.15 s; with 8000 a place on a map of 3 mGal is found 2 minutes later than with 20000."""

WIDE_M, FEW = 500.0, 24
"""1-sigma of a place, along an axis, above which it is searched for and below which it is found;
and how many hypotheses stand for it at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Past:
    """What became of the navigator over a batch, and its new readings."""

    forward: Array
    """(7, 7) error at its end before its fix per unit of error at the last batch end."""
    growth: Array
    """(7, 7) what has joined the navigator's covariance."""
    left: Array
    """(7, 7) covariance of the navigator after its fix."""
    taken: Array
    """(7,) what its fix took off the error."""
    time: float
    """s, its end."""
    rows: Rows | None = None
    """None = there was no reading."""
    evidence: float = 0.0
    """Log evidence of its readings given those before, by the bank."""

    @classmethod
    def of(cls, forward: Array, growth: Array, prior: Array, time: float) -> "Past":
        """Return that of a batch that has had no reading and no fix."""
        return cls(forward, growth, prior, np.zeros(BATCH_STATES), time)


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
    parts, since, A, b = list[Rows](), list[Array](), np.eye(n), np.zeros(n)
    rest = start.copy()
    rest[:2], rest[:, :2] = 0.0, 0.0
    for past in history:
        A, b = past.forward @ A, past.forward @ b
        back = np.linalg.inv(A)
        rest = rest + back @ past.growth @ back.T
        if past.rows is not None:
            rows = past.rows
            of_place, of_reading = rows.place[:, :, :n], rows.reading[:, :n]
            moved = of_place @ b
            place, reading = rows.place.copy(), rows.reading.copy()
            place[:, :, :n], reading[:, :n] = of_place @ A, of_reading @ A
            since.append(np.broadcast_to(rest, (len(rows.level), n, n)))
            parts.append(
                rows._replace(
                    latitude=rows.latitude - moved[:, 0] * rows.radian[:, 0],
                    longitude=rows.longitude - moved[:, 1] * rows.radian[:, 1],
                    level=rows.level - of_reading @ b,
                    place=place,
                    reading=reading,
                )
            )
        b = b - past.taken
    return _together(parts), np.concatenate(since), A, b


@dataclass(frozen=True, slots=True, eq=False)
class Search:
    """Hypotheses about a navigator that may be anywhere, on their way through the batches of the
    last hour."""

    hypotheses: Hypotheses
    """About its error at the end of the last batch that they have come to, before its fix; before
    the first one about that before it."""
    log_odds: float
    """Of them against the bank, by the readings of these batches."""
    done: int = 0
    """How many batches that are."""

    def later(self, history: Sequence[Past], grid: Grid) -> "Search | None":
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
                them = them.split(grid, part, 2 * most).observed(grid, part)
                if not len(them):
                    return None
                them = pruned(them, most, part.place[-1])
            log_odds += them.log_evidence - past.evidence
            them, done = them.normalised(), done + 1
        return Search(them, log_odds, done)


def _together(parts: Sequence[Rows]) -> Rows:
    """Return the rows of several batches."""
    axis = dict.fromkeys(OF_LENGTHS, 1)
    return Rows._make(
        np.concatenate([getattr(one, name) for one in parts], axis=axis.get(name, 0))
        for name in Rows._fields
    )


def pruned(them: Hypotheses, most: int, of_place: Array) -> Hypotheses:
    """Merge places (`Hypotheses.places`) and drop what is negligible, whatever its model; weights
    stay as they are."""
    kept = np.argsort(-them.log_weight)[:most]
    kept = kept[them.log_weight[kept] > them.log_weight[kept[0]] - NEGLIGIBLE]
    return them.part(kept[np.argsort(them.which[kept], kind="stable")]).merged(of_place)


def resolved(them: Hypotheses) -> bool:
    """Whether what is probable is one place."""
    covariance = them.moments()[1]
    return bool(covariance[0, 0] + covariance[1, 1] < 2.0 * WIDE_M**2)


def spread_over(them: Hypotheses, models: Models) -> Hypotheses:
    """Return the same places under other models, of which nothing is known yet."""
    them = pruned(them, FEW, np.eye(2, them.mean.shape[1]))
    count, m, n = len(them), len(models.sigma), BATCH_STATES
    base = Hypotheses.before(models, np.eye(n))
    covariance = np.tile(base.covariance, (count, 1, 1))
    covariance[:, :n, :n] = np.repeat(them.covariance[:, :n, :n], m, axis=0)
    mean = np.zeros((count * m, covariance.shape[1]))
    mean[:, :n] = np.repeat(them.mean[:, :n], m, axis=0)
    weight = (them.log_weight[:, None] + models.log_prior).ravel()
    return Hypotheses(models, np.tile(np.arange(m), count), weight, mean, covariance)
