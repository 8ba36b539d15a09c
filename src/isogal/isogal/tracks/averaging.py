"""A dense track averaged over stretches of itself.

Readings closer together than the map's features say little more than one, and cost time. Within a
stretch everything is averaged alike: time, place, reading and offset, so the mean of the readings
is compared with the map at their mean place. White noise averages out: n readings of 1-sigma s
have s / sqrt(n)."""

from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.corridor import along_track
from isogal.tracks.track import Track


def averaged(track: Track, spacing: float) -> Track:
    """Return a track with one reading for each stretch of a length (m); missing readings do not
    count, and a stretch without any is left out.

    Raises
    ------
    InputError
        Fewer than three stretches have a reading.
    """
    if not spacing > 0.0:
        raise InputError(f"--spacing: must be > 0 m, is {spacing:g}")
    keep = np.isfinite(track.value)
    stretch = np.floor(along_track(track.latitude, track.longitude)[keep] / spacing)
    _, group = np.unique(stretch, return_inverse=True)
    count = np.bincount(group)

    def mean(values: Array) -> Array:
        return np.asarray(np.bincount(group, values[keep]) / count)

    return replace(
        track,
        time=mean(track.time),
        latitude=mean(track.latitude),
        longitude=mean(np.unwrap(track.longitude)),
        value=mean(track.value),
        sigma=np.sqrt(np.bincount(group, track.sigma[keep] ** 2)) / count,
        offset=mean(track.offset),
    )
