"""Readings that are later than told: what a delay does to a batch.

docs/mathematics.md, section 9.4.
"""

from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.interfaces import Batch
from isogal.matching.path import Path


def later(batch: Batch, delay: float) -> Batch:
    """Return a batch whose readings tell of places that were passed a time (s) before those of
    its rows; so do those of other fields beside it, and what they were reduced with."""
    if delay == 0.0:
        return batch
    if batch.beam is not None:  # rows of a scan share its stamp, but not its place
        north, east = metres_per_radian(batch.latitude)
        return replace(
            batch,
            latitude=batch.latitude - delay * batch.velocity[:, 0] / north,
            longitude=batch.longitude - delay * batch.velocity[:, 1] / east,
            beside=tuple(replace(one, batch=delayed(one.batch, delay)) for one in batch.beside),
        )
    _, scan = np.unique(batch.time, return_index=True)  # channels of a scan share stamp and place
    track = batch.time, batch.latitude, batch.longitude, np.zeros(len(batch)), batch.velocity
    path = Path(*(column[scan] for column in track))
    at = path.at(batch.time - delay)
    return replace(
        batch,
        latitude=np.asarray(at.latitude),
        longitude=np.asarray(at.longitude),
        velocity=np.stack([at.v_north, at.v_east], axis=-1),
        end_place=batch.end,
        beside=tuple(replace(one, batch=delayed(one.batch, delay)) for one in batch.beside),
    )


def delayed(batch: Batch, delay: float) -> Batch:
    """Return a batch whose readings are later than told by a time (s): of earlier places, and
    reduced with the state there."""
    return replace(later(batch, delay), offset=batch.offset + delay * by_delay(batch))


def by_delay(batch: Batch) -> Array:
    """Return (T,) how much is in each reading per s of delay because it was reduced with the state
    at its stamp, instead of that before."""
    return np.zeros(len(batch)) if batch.reading_rate is None else batch.reading_rate
