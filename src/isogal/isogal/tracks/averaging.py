"""Means of neighbouring readings: a dense track averaged over stretches of itself, and the rows of
the matcher.

Readings closer together than the map's features say little more than one, and cost time. Within a
stretch everything is averaged alike: time, place, reading and offset, so the mean of the readings
is compared with the map at their mean place. White noise averages out: n readings of 1-sigma s
have s / sqrt(n)."""

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


@dataclass(frozen=True, slots=True, eq=False)
class Averages:
    """Which readings are averaged: neighbours, of one channel."""

    order: Integers
    """(n,) the readings of row 0, those of row 1, ..."""
    first: Integers
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
        if size == 1:
            return cls(np.arange(count), np.arange(count))
        block = (np.arange(count) - old) // (size * channels)
        order = np.lexsort((rows.channel, block))
        new = np.diff(block[order], prepend=block[0] - 1) != 0
        new |= np.diff(rows.channel[order], prepend=-1) != 0
        return cls(order, np.flatnonzero(new))

    @property
    def sizes(self) -> Integers:
        """(m,) how many readings each row is of."""
        return np.diff(np.r_[self.first, len(self.order)])

    def mean(self, values: Array) -> Array:
        """Return (m, ...) means of what readings have (n, ...)."""
        sums = np.add.reduceat(values[self.order], self.first, axis=0)
        return np.asarray(sums / self.sizes.reshape(-1, *[1] * (values.ndim - 1)))

    def few(self) -> "Averages":
        """Return those of fewer readings that stand for the rows where each is compared with each:
        every second, third, ... of a row."""
        every = math.ceil(int(self.sizes.max()) / max(1, MOST_POINTS // len(self.first)))
        place = np.arange(len(self.order)) - np.repeat(self.first, self.sizes)
        chosen = np.flatnonzero(place % every == 0)
        return Averages(self.order[chosen], np.searchsorted(chosen, self.first))

    def covariance(self, of_readings: Array) -> Array:
        """Return (m, m) the covariance of means by that of readings (n, n) in their order: a
        covariance of means is one, a correlation function of their distances is not."""
        if len(self.first) == len(self.order):
            return of_readings
        sums = np.add.reduceat(
            np.add.reduceat(of_readings, self.first, axis=0), self.first, axis=1
        )
        return np.asarray(sums / np.outer(self.sizes, self.sizes))


def averaged(track: Track, spacing: float) -> Track:
    """Return a track with one reading for each stretch of a length (m, > 0); missing readings do
    not count, and a stretch without any is left out."""
    there = np.flatnonzero(np.isfinite(track.value))
    stretch = np.floor(along_track(track.latitude, track.longitude)[there] / spacing)
    means = Averages(there, np.unique(stretch, return_index=True)[1])
    return replace(
        track,
        time=means.mean(track.time),
        latitude=means.mean(track.latitude),
        longitude=means.mean(np.unwrap(track.longitude)),
        value=means.mean(track.value),
        sigma=np.sqrt(means.mean(track.sigma**2) / means.sizes),
        offset=means.mean(track.offset),
    )
