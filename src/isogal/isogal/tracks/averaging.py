"""Means of neighbouring readings: a dense track averaged over stretches of itself, and the rows of
the matcher.

Readings closer together than the map's features say little more than one, and cost time. Within a
stretch everything is averaged alike: time, place, reading and offset, so the mean of the readings
is compared with the map at their mean place. White noise averages out: n readings of 1-sigma s
have s / sqrt(n)."""

import math
from dataclasses import replace

import numpy as np

from isogal.arrays import Integers
from isogal.earth.frames import horizontal_difference
from isogal.groups import Groups
from isogal.maps.corridor import along_track
from isogal.matching.pmht.rows import Rows
from isogal.tracks.track import Track

MOST_ROWS, ENOUGH_ROWS, RESOLUTION_NODES = 220, 90, 2.0
"""Of more readings neighbouring ones are averaged; with more than enough also those closer
together than so many nodes of the map: how errors hold together over less than it can resolve is
known least, and says least about the place."""
MOST_POINTS = 440
"""Readings that stand for the rows: time grows with the square."""


def neighbours(readings: Rows, node: float, old: int) -> Groups:
    """Return which readings are averaged, of one channel: few enough, and about as far apart as
    the map can resolve.

    Parameters
    ----------
    readings : Rows
    node : float
        From one node of the map to the next, m.
    old : int
        How many of the first are not averaged with later ones.
    """
    count, channels = len(readings.level), int(readings.channel.max()) + 1
    latitude, longitude = readings.latitude, readings.longitude
    way = horizontal_difference(latitude[:-1], longitude[:-1], latitude[1:], longitude[1:])
    way = np.hypot(way[..., 0], way[..., 1])
    step = float(np.median(way[way > 0.0])) if (way > 0.0).any() else 0.0
    resolved = round(RESOLUTION_NODES * node / step) if step > 0.0 else count
    size = max(math.ceil(count / MOST_ROWS), min(resolved, count // ENOUGH_ROWS), 1)
    if size == 1:
        return Groups.by(np.arange(count))
    return Groups.by((np.arange(count) - old) // (size * channels), readings.channel)


def few(rows: Groups) -> Integers:
    """Return the readings (p,) that stand for rows where each is compared with each: of every row
    the first and then every second, third, ..."""
    order, count = np.argsort(rows.of, kind="stable"), rows.count.astype(np.int64)
    place = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)
    every = math.ceil(int(count.max()) / max(1, MOST_POINTS // len(count)))
    return order[place % every == 0]


def averaged(track: Track, spacing: float) -> Track:
    """Return a track with one reading for each stretch of a length (m, > 0); missing readings do
    not count, and a stretch without any is left out."""
    there = np.isfinite(track.value)
    stretch = np.floor(along_track(track.latitude, track.longitude)[there] / spacing)
    groups = Groups.by(stretch)
    places = [track.latitude, np.unwrap(track.longitude)]
    columns = np.column_stack([track.time, *places, track.value, track.offset, track.sigma**2])
    time, latitude, longitude, value, offset, square = groups.mean(columns[there]).T
    return replace(
        track,
        time=time,
        latitude=latitude,
        longitude=longitude,
        value=value,
        sigma=np.sqrt(square / groups.count),
        offset=offset,
    )
