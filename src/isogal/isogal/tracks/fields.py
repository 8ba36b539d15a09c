"""Readings of one or several fields along the same track, and the matcher of them all."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.channels import AnyMap, ChannelMap, RouteMap
from isogal.matching.expansion import Channels, with_allowed_tilt
from isogal.matching.interfaces import Batch, Matcher, SecondaryBatch
from isogal.matching.pmht.models import options_of
from isogal.matching.registry import load_matcher, matcher_of_fields
from isogal.scenario import Gradiometer
from isogal.scenario import Matcher as MatcherSettings
from isogal.tracks.bank import TrackMatcher
from isogal.tracks.batches import build_batch, without_map_edge
from isogal.tracks.track import Track


@dataclass(frozen=True, slots=True, eq=False)
class ChannelReadings:
    """Readings of several numbers each, such as components of the gradient tensor."""

    values: Array
    """(N, C) unit of the maps; NaN = no reading."""
    covariance: Array
    """(C, C) of the sensor's noise."""
    gradiometer: Gradiometer | None = None
    """Whose components they are; None = of another instrument."""


@dataclass(frozen=True, slots=True, eq=False)
class TrackField:
    """One field along a track."""

    name: str
    track: Track
    """Times and places are the same for all fields."""
    field_map: RouteMap
    settings: MatcherSettings
    channels: ChannelReadings | None = None
    """Instead of the track's values, where the map has several channels."""

    def batch(
        self, jacobian: Array, rows: slice, new: int, error: Array, covariance: Array
    ) -> Batch:
        """Return rows of the track as a batch; parameters of `batches.build_batch`."""
        batch = build_batch(self.track, jacobian, rows, new, error, covariance)
        if self.channels is None:
            return batch
        assumed = self.channels.gradiometer
        if assumed is not None:
            assumed = with_allowed_tilt(assumed, self.settings.name)
        expansion, offset = Channels(self.channels.covariance, assumed), np.zeros(len(batch))
        return expansion.expand(batch, self.channels.values[rows, :, None], offset)


def check_fields(fields: Sequence[TrackField]) -> None:
    """Raise InputError where fields do not belong to one track, or have one name."""
    first = fields[0]
    for one in fields[1:]:
        same = len(one.track) == len(first.track) and bool(
            (one.track.time == first.track.time).all()
        )
        if not same:
            raise InputError(
                f"{one.track.where}: readings of {one.name} are not at the times of those of"
                f" {first.name}"
            )
    names = [one.name for one in fields]
    if len(set(names)) < len(names):
        raise InputError(f"fields of a track need names of their own, not {', '.join(names)}")


def joint_batch(
    fields: Sequence[TrackField],
    jacobians: Sequence[Array],
    rows: slice,
    new: int,
    error: Array,
    covariance: Array,
    *,
    edge: bool,
) -> tuple[Batch, AnyMap]:
    """Return rows of the first field as a batch with those of the others beside it, and its map;
    `edge`: without readings near which a map ends. Other parameters as of
    `batches.build_batch`."""
    each = []
    for index, (field, jacobian) in enumerate(zip(fields, jacobians, strict=True)):
        batch = field.batch(jacobian, rows, new, error, covariance)
        near = field.field_map.near(batch.latitude, batch.longitude)
        each.append(SecondaryBatch(index, without_map_edge(batch, near) if edge else batch, near))
    batch = each[0].batch
    return (replace(batch, secondary=tuple(each[1:])) if each[1:] else batch), each[0].field_map


def matcher_of(fields: Sequence[TrackField]) -> Matcher:
    """Return the matcher that the settings name; `pmht` matches all fields together."""
    settings, names = [one.settings for one in fields], [one.name for one in fields]
    if all(one.name == "pmht" for one in settings):
        for one in settings:
            options_of(one)  # refuses bad options
        return TrackMatcher(tuple(settings), tuple(names))
    if len(fields) > 1:
        return matcher_of_fields(settings, names, 0)
    return load_matcher(settings[0], isinstance(fields[0].field_map, ChannelMap))
