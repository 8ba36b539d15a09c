"""A dense track averaged over stretches of itself.

Readings closer together than the map's features say little more than one, and cost time. Within a
stretch everything is averaged alike: time, place, reading and offset, so the mean of the readings
is compared with the map at their mean place. White noise averages out: n readings of 1-sigma s
have s / sqrt(n).

Rows of the matcher are means of neighbouring readings in the same way."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.frames import horizontal_difference
from isogal.maps.corridor import along_track
from isogal.matching.pmht.rows import Rows
from isogal.tracks.track import Track

MOST_ROWS, ENOUGH_ROWS, RESOLUTION_NODES = 220, 90, 2.0
"""Of more readings neighbouring ones are averaged; with more than enough also those closer
together than so many nodes of the map: how errors hold together over less than it can resolve is
known least, and says least about the place."""
MOST_POINTS = 440
"""Readings that stand for the rows: time grows with the square."""


def averaged(track: Track, spacing: float) -> Track:
    """Return a track with one reading for each stretch of a length (m, > 0); missing readings do
    not count, and a stretch without any is left out."""
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


@dataclass(frozen=True, slots=True, eq=False)
class Averages:
    """Which readings are averaged: neighbours of one channel."""

    order: Integers
    """(n,) the readings of row 0, those of row 1, ..."""
    first: Integers
    """(m,) of them each row begins with."""
    points: Integers
    """(p,) readings that stand for the rows where each with each is compared, in this order."""
    point: Integers
    """(m,) of them each row begins with."""

    @classmethod
    def of(cls, rows: Rows, node: float, old: int = 0) -> "Averages":
        """Choose them for readings where `node` (m) is the distance between two of the map. The
        first `old` are not averaged with later ones."""
        count, channels = len(rows.level), int(rows.channel.max()) + 1
        way = horizontal_difference(
            rows.latitude[:-1], rows.longitude[:-1], rows.latitude[1:], rows.longitude[1:]
        )
        way = np.hypot(way[..., 0], way[..., 1])
        step = float(np.median(way[way > 0.0])) if (way > 0.0).any() else 0.0
        resolved = round(RESOLUTION_NODES * node / step) if step > 0.0 else count
        size = max(math.ceil(count / MOST_ROWS), min(resolved, count // ENOUGH_ROWS), 1)
        block = (np.arange(count) - old) // (size * channels)
        order, new = np.arange(count), np.ones(count, bool)
        if size > 1:
            order = np.lexsort((rows.channel, block))
            new = np.diff(block[order], prepend=block[0] - 1) != 0
            new |= np.diff(rows.channel[order], prepend=-1) != 0
        first = np.flatnonzero(new)
        row = np.cumsum(new) - 1
        every = math.ceil(size / max(1, MOST_POINTS // len(first)))
        chosen = np.flatnonzero((np.arange(count) - first[row]) % every == 0)
        return cls(
            order, first, order[chosen], np.searchsorted(row[chosen], np.arange(row[-1] + 1))
        )

    @property
    def sizes(self) -> Integers:
        """(m,) how many readings each row is of."""
        return np.diff(np.r_[self.first, len(self.order)])

    def mean(self, values: Array) -> Array:
        """Return (m, ...) means of what readings have (n, ...)."""
        sums = np.add.reduceat(values[self.order], self.first, axis=0)
        return np.asarray(sums / self.sizes.reshape(-1, *[1] * (values.ndim - 1)))

    def covariance(self, of_points: Array) -> Array:
        """Return (m, m) the covariance of means by that of their points (p, p): a covariance of
        means is one, a correlation function of their distances is not."""
        if len(self.point) == len(self.points):
            return of_points
        sums = np.add.reduceat(np.add.reduceat(of_points, self.point, axis=0), self.point, axis=1)
        count = np.diff(np.r_[self.point, len(self.points)])
        return np.asarray(sums / np.outer(count, count))
