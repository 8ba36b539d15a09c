"""Readings of one or several fields along the same track, their batches, and the matcher of them
all (docs/mathematics.md, section 10.1)."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.inertial.error_state import BATCH_STATES, level
from isogal.maps.channels import AnyMap, ChannelMap, RouteMap, channels_of
from isogal.maps.tiled_map import ScalarMap
from isogal.matching.expansion import Channels
from isogal.matching.interfaces import Batch, Matcher, SecondaryBatch
from isogal.matching.pmht.models import options_of
from isogal.matching.registry import load_matcher, matcher_of_fields
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.bank import TrackMatcher
from isogal.tracks.evidence import SURE, on_map
from isogal.tracks.track import Track

FEWEST_IN_BATCH = 4
"""Scans that the incomplete last batch needs to be matched."""


@dataclass(frozen=True, eq=False)
class TrackField:
    """One field along a track."""

    name: str
    track: Track
    """Times and places are the same for all fields."""
    field_map: RouteMap
    settings: MatcherSettings = field(default_factory=MatcherSettings)
    channels: Channels | None = None
    """What `values` are of, where the map has several channels."""
    values: Array | None = None
    """(N, C) unit of the maps, instead of the track's; NaN = no reading."""
    unit: str = ""
    """In which its figures are shown: `Track.factor` units inside."""

    @property
    def scalar_map(self) -> ScalarMap:
        """The map, or the first of several: what holds for one holds for all."""
        return channels_of(self.field_map)[0]

    @cached_property
    def jacobian(self) -> Array:
        """(N, 4), see `Track.jacobian`."""
        return self.track.jacobian(self.field_map.quantity)

    def batch(self, rows: slice, new: int, error: Array, covariance: Array) -> Batch:
        """Return rows of the track as a batch.

        Parameters
        ----------
        rows : slice
            Readings of the batch, earlier ones that the matcher wants as context included.
        new : int
            How many of the last rows no earlier batch has used.
        error : (4,) array
            Error of the track at the last row as far as it is known (north, east m; m/s): the
            batch is moved by it.
        covariance : (4, 4) array
            Of the error that remains.
        """
        track = self.track
        time = track.time[rows]
        backward = np.tile(np.eye(BATCH_STATES), (time.size, 1, 1))
        backward[:, 0, 2] = backward[:, 1, 3] = time - time[-1]
        by_error = np.einsum("ti,tij->tj", self.jacobian[rows], backward[:, :4])
        latitude, longitude = track.moved(rows, error)
        batch = Batch(
            time=time,
            latitude=latitude,
            longitude=longitude,
            velocity=track.velocity[rows] - error[2:],
            reading=track.value[rows] - by_error[:, :4] @ error - track.offset[rows],
            sigma=track.sigma[rows],
            covariance=level(covariance),
            by_error=np.concatenate([backward[:, :2], by_error[:, None]], axis=1),
            backward=backward,
            new=min(new, time.size),
        )
        if self.channels is None or self.values is None:
            return batch
        return self.channels.expand(batch, self.values[rows, :, None], np.zeros(len(batch)))


def batch_ends(count: int, settings: MatcherSettings) -> list[int]:
    """Return after how many readings each batch ends: batches of a recorded track do not overlap
    unless the stride says so.

    The last batch may be incomplete if it has `FEWEST_IN_BATCH` new readings, or if it is the only
    one."""
    step = settings.stride or settings.batch_length
    ends = list(range(settings.batch_length, count + 1, step))
    if count - (ends[-1] if ends else 0) >= FEWEST_IN_BATCH or not ends:
        ends.append(count)
    return ends


def check_fields(fields: Sequence[TrackField]) -> None:
    """Raise InputError where fields do not belong to one track, or have one name."""
    first = fields[0]
    for one in fields[1:]:
        if not np.array_equal(one.track.time, first.track.time):
            raise InputError(
                f"{one.track.where}: readings of {one.name} are not at the times of those of"
                f" {first.name}"
            )
    names = [one.name for one in fields]
    if len(set(names)) < len(names):
        raise InputError(f"fields of a track need names of their own, not {', '.join(names)}")


def joint_batch(
    fields: Sequence[TrackField],
    rows: slice,
    new: int,
    error: Array,
    covariance: Array,
    *,
    edge: bool,
) -> tuple[Batch, AnyMap]:
    """Return rows of the first field as a batch with those of the others beside it, and its map;
    `edge`: without readings near which a map ends. Other parameters as of `TrackField.batch`."""
    each = []
    for index, one in enumerate(fields):
        batch = one.batch(rows, new, error, covariance)
        near = one.field_map.near(batch.latitude, batch.longitude)
        each.append(SecondaryBatch(index, on_map(batch, near, SURE) if edge else batch, near))
    batch = each[0].batch
    return (replace(batch, secondary=tuple(each[1:])) if each[1:] else batch), each[0].field_map


def prefix(field: TrackField, fields: Sequence[TrackField]) -> str:
    """Return what the names of a field's figures begin with: of the first with nothing."""
    return "" if field is fields[0] else f"{field.name}."


def matcher_of(fields: Sequence[TrackField]) -> Matcher:
    """Return the matcher that the settings name; `pmht` matches all fields together."""
    settings = tuple(one.settings for one in fields)
    if all(one.name == "pmht" for one in settings):
        for one in settings:
            options_of(one)  # refuses bad options
        return TrackMatcher(settings, tuple(prefix(one, fields) for one in fields))
    if len(fields) > 1:
        return matcher_of_fields(settings, [one.name for one in fields], 0)
    return load_matcher(settings[0], isinstance(fields[0].field_map, ChannelMap))
