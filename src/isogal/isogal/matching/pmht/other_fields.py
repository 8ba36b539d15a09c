"""What readings of other fields say of a navigator that those of one field find lost
(docs/mathematics.md, section 8.9)."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from isogal.arrays import Array
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.elsewhere import evidence_at
from isogal.matching.pmht.map_error import MapErrorPrior
from isogal.matching.pmht.past_batches import PastBatch, others_without_fixes, taken_before


@runtime_checkable
class SeveralFields(Protocol):
    """A matcher of several fields."""

    def map_error_prior(self, memory: Any, field: int) -> MapErrorPrior | None:
        """Return what was believed of the error of a field's map before any reading; None = that
        it has none."""
        ...


def log_evidence_of_others(
    matcher: Any, memory: Any, history: tuple[PastBatch, ...], place: tuple[Array, Array]
) -> float:
    """Return by how much readings of other fields in past batches are more likely at a place than
    where the navigator believes to be; 0 where there are none, or too few.

    Parameters
    ----------
    matcher, memory : Matcher and its memory
    history : tuple of PastBatch
    place : (7,) and (7, 7) arrays
        Error of the navigator at the end of the last batch, before its fix, if it is there.
    """
    if not isinstance(matcher, SeveralFields):
        return 0.0
    mean = (place[0] - taken_before(history)[-1])[:2], place[1][:2, :2]
    total = 0.0
    for field in sorted({one.field for past in history for one in past.beside}):
        beside = [one for past in history for one in past.beside if one.field == field]
        batches = [one.batch for one in beside]
        prior = matcher.map_error_prior(memory, field)
        read = sum(int(np.isfinite(batch.reading).sum()) for batch in batches)
        few = read < CONSTANTS.first_look_readings
        if few or prior is None or batches[-1].channel is not None:
            continue
        tracks = batches, others_without_fixes(history, field)
        total += evidence_at(tracks, beside[-1].field_map, prior, mean)
    return total
