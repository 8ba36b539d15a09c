"""A dense track averaged over stretches of itself.

Readings closer together than the map's features say little more than one, and cost time. Within a
stretch everything is averaged alike: time, place, reading and offset, so the mean of the readings
is compared with the map at their mean place. White noise averages out: n readings of 1-sigma s
have s / sqrt(n).

Rows of the matcher are means of neighbouring readings in the same way."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.maps.corridor import along_track
from isogal.matching.pmht.rows import Rows
from isogal.matching.pmht.search import OF_LENGTHS
from isogal.tracks.track import Track

MOST_ROWS, ENOUGH_ROWS, RESOLUTION_NODES = 220, 90, 2.0
"""Of more readings neighbouring ones are averaged; with more than enough also those closer
together than so many nodes of the map: how errors hold together over less than it can resolve is
known least, and says least about the place."""


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


def grouped(rows: Rows, node: float, old: int = 0) -> tuple[Rows, Integers]:
    """Return readings such that those that are to be averaged are neighbours, and with which of
    them each row begins; `node` (m) is the distance between two of the map. The first `old`
    readings are not averaged with later ones."""
    count, channels = len(rows.level), int(rows.channel.max()) + 1
    way = rows.travelled[1:]
    step = float(np.median(way[way > 0.0])) if (way > 0.0).any() else 0.0
    resolved = round(RESOLUTION_NODES * node / step) if step > 0.0 else count
    size = max(math.ceil(count / MOST_ROWS), min(resolved, count // ENOUGH_ROWS), 1)
    if size == 1:
        return rows, np.arange(count)
    block = (np.arange(count) - old) // (size * channels)
    order = np.lexsort((rows.channel, block))
    reach, since = np.cumsum(rows.travelled)[order], cumulated(rows)
    rows = Rows._make(
        np.ascontiguousarray(column[:, order] if name in OF_LENGTHS else column[order])
        for name, column in zip(Rows._fields, rows, strict=True)
    )._replace(travelled=np.maximum(np.diff(reach, prepend=0.0), 0.0))
    steps = _stepped(*(one[order] for one in since))
    rows = rows._replace(keep=steps["keep"], fresh=steps["fresh"])
    new = (np.diff(block[order], prepend=block[0] - 1) != 0) | (
        np.diff(rows.channel, prepend=-1) != 0
    )
    return rows, np.flatnonzero(new)


def averaged_rows(rows: Rows, first: Integers) -> Rows:
    """Return means of neighbouring readings, those from each of `first` to the next."""
    count = len(rows.level)
    if len(first) == count:
        return rows
    sizes = np.diff(np.r_[first, count])

    def mean(column: Array) -> Array:
        sums = np.add.reduceat(column, first, axis=0)
        return np.ascontiguousarray(sums / sizes.reshape(-1, *[1] * (column.ndim - 1)))

    middle = np.minimum(first + sizes // 2, count - 1)
    steps = _stepped(*(one[middle] for one in cumulated(rows)))
    return rows._replace(
        **{name: mean(getattr(rows, name)) for name in _MEANS},
        load=np.ascontiguousarray(np.stack([mean(one) for one in rows.load])),
        noise=mean(rows.noise) / sizes,
        travelled=np.diff(np.cumsum(rows.travelled)[middle], prepend=0.0),
        keep=steps["keep"],
        fresh=steps["fresh"],
        step=np.ascontiguousarray(rows.step[:, first]),
        joined=np.ascontiguousarray(rows.joined[:, first]),
        channel=rows.channel[first],
    )


_MEANS = (
    *("latitude", "longitude", "radian", "level", "place", "reading", "rate"),
    *("velocity", "nodes"),
)


def cumulated(rows: Rows) -> tuple[Array, Array]:
    """Return (n, S) the negative log of what share of each state is left since before the first
    reading, and (n, S) the variance that has joined it since."""
    gone = -np.cumsum(np.log(np.maximum(rows.keep, 1e-300)), axis=0)
    joined = np.zeros_like(rows.fresh)
    if rows.fresh.any():
        last = np.zeros(joined.shape[1])
        for t in range(len(joined)):
            last = joined[t] = rows.keep[t] ** 2 * last + rows.fresh[t]
    return gone, joined


def _stepped(gone: Array, joined: Array) -> dict[str, Array]:
    """Return `Rows.keep` and `Rows.fresh` from row to row; the inverse of `cumulated`."""
    keep = np.exp(-np.maximum(np.diff(gone, axis=0, prepend=0.0), 0.0))
    before = np.concatenate([np.zeros((1, joined.shape[1])), joined[:-1]])
    return {"keep": keep, "fresh": np.maximum(joined - keep**2 * before, 0.0)}
