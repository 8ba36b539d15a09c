"""What readings of other fields say of a navigator that may be lost (docs/mathematics.md, section
8.9)."""

from typing import Any, Protocol, runtime_checkable

import numpy as np

from isogal.arrays import Array
from isogal.maps.channels import channels_of
from isogal.maps.field_map import FieldMap
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.elsewhere import evidence_at
from isogal.matching.pmht.last_hour import LastHour
from isogal.matching.pmht.map_error import MapErrorPrior
from isogal.matching.pmht.past_batches import PastBatch, taken_before


@runtime_checkable
class SeveralFields(Protocol):
    """A matcher of several fields."""

    def map_error_prior(self, memory: Any, field: int) -> MapErrorPrior | None:
        """Return what was believed of the error of a field's map before any reading; None = that
        it has none."""
        ...


def hour_of(
    matcher: Any, memory: Any, history: tuple[PastBatch, ...], own: MapErrorPrior | None
) -> LastHour | None:
    """Return the readings of all fields in past batches; None where there are none.

    Parameters
    ----------
    matcher, memory : Matcher and its memory
    history : tuple of PastBatch
    own : MapErrorPrior
        Of the field of the batches themselves; None = leave it out.

    Several channels, and what is fewer than a look takes, are left out.
    """
    maps: dict[int | None, tuple[FieldMap, MapErrorPrior]] = {}
    latest = history[-1]
    if own is not None and latest.batch.channel is None:
        maps[None] = channels_of(latest.field_map)[0], own
    if isinstance(matcher, SeveralFields):
        for field in sorted({one.field for past in history for one in past.beside}):
            beside = [one for past in history for one in past.beside if one.field == field]
            prior = matcher.map_error_prior(memory, field)
            read = sum(int(np.isfinite(one.batch.reading).sum()) for one in beside)
            few = read < CONSTANTS.first_look_readings
            if few or prior is None or beside[-1].batch.channel is not None:
                continue
            maps[field] = channels_of(beside[-1].field_map)[0], prior
    return LastHour.of(history, maps) if maps else None


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
    hour = hour_of(matcher, memory, history, own=None)
    if hour is None:
        return 0.0
    return evidence_at(hour, ((place[0] - taken_before(history)[-1])[:2], place[1][:2, :2]))
