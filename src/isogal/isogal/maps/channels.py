"""Several maps on one grid, for sensors that measure several quantities at once, such as the
gravity gradient tensor."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import cached_property, partial
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array, Booleans, Integers, Values
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap, delegated
from isogal.maps.interpolation import Grid
from isogal.maps.tiled_map import ScalarMap

_of_first = partial(delegated, lambda several: several.channels[0])


class ChannelMap:
    """C maps on the same grid in the same unit; row t of a batch is compared with the map of its
    channel.

    Parameters
    ----------
    channels : sequence of FieldMap
        At least one.
    values : (C, n, m) array, optional
        Of all channels, where theirs are parts of one array already; else they are put together in
        one.

    Raises
    ------
    InputError
        Grids or units differ.
    """

    def __init__(self, channels: Sequence[FieldMap], values: Values | None = None) -> None:
        first = channels[0]
        for number, other in enumerate(channels[1:], 1):
            if other.unit != first.unit or not other.on_grid_of(first):
                raise InputError(
                    f"channel {number} of a vector map, in {other.unit}, is on another grid, or in"
                    f" another unit, than channel 0, in {first.unit}"
                )
        self.channels = tuple(channels)
        if values is None:
            values = np.asarray(np.stack([channel.values for channel in channels]))
            self.channels = tuple(
                replace(one, values=part) for one, part in zip(channels, values, strict=True)
            )
        self.values = values

    def __len__(self) -> int:
        return len(self.channels)

    def __reduce__(self) -> tuple[Callable[..., "ChannelMap"], tuple[object, ...]]:
        """Pickle the values of all channels once, and what is known of each beside them."""
        rest = [
            {one.name: getattr(channel, one.name) for one in fields(channel)}
            for channel in self.channels
        ]
        for channel in rest:
            del channel["values"]
        return _restored, (self.values, rest)

    def value(self, latitude: ArrayLike, longitude: ArrayLike) -> Array:
        """Interpolate all channels at points (rad, any shapes that broadcast): (..., C), NaN where
        a map has no value."""
        return np.stack([channel.value(latitude, longitude) for channel in self.channels], axis=-1)

    def covers(self, latitude: ArrayLike, longitude: ArrayLike) -> Booleans:
        """Tell where all channels have a value."""
        return np.asarray(np.isfinite(self.value(latitude, longitude)).all(axis=-1))

    def near(self, latitude: ArrayLike, longitude: ArrayLike) -> "ChannelMap":
        """See `FieldMap`."""
        return self

    @cached_property
    def grid(self) -> Grid:
        """The grid of all channels, as the kernels of `isogal.maps.interpolation` take it."""
        columns = self.values.shape[2]
        return self.channels[0].grid._replace(values=self.values.reshape(-1, columns))

    @cached_property
    def sigma_grid(self) -> Grid:
        """What the maps say of their errors at their nodes, below one another; one node where none
        says it of each node."""
        grids = [one.sigma_grid.values for one in self.channels]
        if all(one.size == 1 for one in grids):
            return self.channels[0].sigma_grid
        shape = self.channels[0].values.shape
        each = [np.broadcast_to(one, shape) for one in grids]
        return self.grid._replace(values=np.ascontiguousarray(np.concatenate(each)))

    unit: str = _of_first("unit")
    quantity: str = _of_first("quantity")
    extent: Window = _of_first("extent")
    provenance: str = _of_first("provenance")


def _restored(values: Values, rest: list[dict[str, Any]]) -> ChannelMap:
    """Return what `ChannelMap.__reduce__` has pickled, without a copy of the values."""
    parts = [FieldMap(values=part, **one) for part, one in zip(values, rest, strict=True)]
    return ChannelMap(parts, values)


AnyMap = FieldMap | ChannelMap
"""What readings are matched against: in memory."""
RouteMap = ScalarMap | ChannelMap
"""What there is along a route, however large."""


@overload
def channels_of(field_map: AnyMap) -> tuple[FieldMap, ...]: ...
@overload
def channels_of(field_map: RouteMap) -> tuple[ScalarMap, ...]: ...
def channels_of(field_map: RouteMap) -> tuple[ScalarMap, ...]:
    """Return the maps of all channels, or the only map."""
    return field_map.channels if isinstance(field_map, ChannelMap) else (field_map,)


def by_channel(
    field_map: FieldMap | ChannelMap,
    channel: Integers,
    of: Callable[[FieldMap, Array, Array], Array],
    latitude: Array,
    longitude: Array,
) -> Array:
    """Return (T,) what a function says of the map of each row's channel.

    Parameters
    ----------
    field_map : FieldMap or ChannelMap
    channel : (T,) array
        Of each row.
    of : callable
        ``of(map, latitude, longitude)`` returns an array for some of the points.
    latitude, longitude : (T,) arrays
        rad.
    """
    maps = channels_of(field_map)
    if len(maps) == 1:
        return np.asarray(of(maps[0], latitude, longitude), dtype=np.float64)
    result = np.empty(len(channel))
    for index, one in enumerate(maps):
        rows = channel == index
        result[rows] = of(one, latitude[rows], longitude[rows])
    return result
