"""Several maps on one grid, for sensors that measure several quantities at once, such as the gravity gradient tensor."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap, Grid


class ChannelMap:
    """C maps on the same grid in the same unit; row t of a batch is compared with the map of its channel.

    Parameters
    ----------
    channels : sequence of FieldMap
        At least one.

    Raises
    ------
    InputError
        Grids or units differ.
    """

    def __init__(self, channels: Sequence[FieldMap]) -> None:
        if not channels:
            raise InputError("a vector map needs at least one channel")
        self.channels = tuple(channels)
        first = self.channels[0]
        for number, other in enumerate(self.channels[1:], 1):
            if other.unit != first.unit:
                raise InputError(f"channel {number} of a vector map is in {other.unit}, channel 0 in {first.unit}")
            same = other.values.shape == first.values.shape and np.allclose(other.grid[1:], first.grid[1:], rtol=1e-12)
            if not same:
                raise InputError(f"channel {number} of a vector map is on another grid than channel 0")

    def __len__(self) -> int:
        return len(self.channels)

    @cached_property
    def grid(self) -> Grid:
        """``(values (C, n, m), lat0, dlat, lon0, dlon)``, rad."""
        values = np.stack([np.asarray(channel.values, dtype=np.float64) for channel in self.channels])
        return (values, *self.channels[0].grid[1:])

    @property
    def unit(self) -> str:
        """Unit of all channels."""
        return self.channels[0].unit

    @property
    def extent(self) -> Window:
        """South, north, west and east node, rad."""
        return self.channels[0].extent

    @property
    def provenance(self) -> str:
        """Where it comes from, one line."""
        return self.channels[0].provenance


def channels_of(field_map: FieldMap | ChannelMap) -> tuple[FieldMap, ...]:
    """Return the maps of a vector map, or the only one."""
    return field_map.channels if isinstance(field_map, ChannelMap) else (field_map,)


def by_channel(
    field_map: FieldMap | ChannelMap, channel: NDArray[np.int64], name: str, *arguments: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return ``getattr(map of the channel, name)(*arguments)`` (T,) row by row, for channel (T,) and arguments (T,)."""
    maps = channels_of(field_map)
    if len(maps) == 1:
        return np.asarray(getattr(maps[0], name)(*arguments), dtype=np.float64)
    result = np.empty(len(channel))
    for index, one in enumerate(maps):
        rows = channel == index
        result[rows] = getattr(one, name)(*(argument[rows] for argument in arguments))
    return result
