"""Horizontal gravity that the strapdown takes off by a map, at its own position.

Gravity is not vertical: beside normal gravity the vehicle feels the disturbance vector, whose
horizontal part is a few arc seconds of the whole, that is some ten mGal, a hundred times the
accelerometer bias of the precision grade. A navigator that has a map of it takes it off where it
believes to be; what is left goes with the map's error, and with the navigator's position error
(docs/mathematics.md, section 3.9).
"""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.maps.channels import ChannelMap
from isogal.maps.interpolation import Grid, value_and_gradient

NORTH, EAST = np.int64(0), np.int64(1)
"""Channels of the map; as plain numbers the interpolation would be compiled for each of them."""


class Compensation(NamedTuple):
    """A map of horizontal gravity, as the kernels take it."""

    grid: Grid
    """Two channels, north and east, m/s²."""
    share: float
    """Of the map's value that is taken off; 0 = no compensation."""
    variance: float = 0.0
    """(m/s²)², of each component over the map, times share²."""
    feature: float = 1.0
    """m, over which that changes: a component's 1-sigma per that of its derivatives."""


def no_compensation() -> Compensation:
    """Return the compensation of a navigator that knows nothing of horizontal gravity."""
    return Compensation(Grid(np.zeros((8, 4)), 4, 0.0, 1.0, 0.0, 1.0), 0.0)


def compensation_by(field_map: ChannelMap | None, share: float = 1.0) -> Compensation:
    """Return the compensation by a map of `gravity_north` and `gravity_east`; None = none."""
    if field_map is None or share == 0.0:
        return no_compensation()
    first, values = field_map.channels[0], field_map.values
    sizes = first.cell_size_m(float(first.latitude.mean()))
    variance = float(np.nanvar(values, axis=(1, 2)).mean())
    slopes = (np.gradient(values, size, axis=k) for k, size in enumerate(sizes, 1))
    steep = sum(float(np.nanmean(np.square(slope))) for slope in slopes) / 2.0
    feature = math.sqrt(variance / steep) if steep > 0.0 else math.inf
    return Compensation(field_map.grid, share, share**2 * variance, feature)


@kernel(error_model="numpy")
def misplaced(compensation: Compensation, spread: float) -> float:
    """Return the variance of what is left of each component, (m/s²)², since a navigator whose
    position has the variance `spread` (m²) along an axis takes off what is elsewhere.

    Over a field of the variance s² and the covariance s² exp(-d² / 2 L²) it is 2 s² r / (1 + r),
    with r = spread / L² (docs/mathematics.md, section 3.9)."""
    r = spread / compensation.feature**2
    return 2.0 * compensation.variance * r / (1.0 + r)


@kernel
def horizontal_gravity(compensation: Compensation, position: Array) -> tuple[float, float]:
    """Return the compensation at a position (3,), to north and to east (m/s²). Nothing where the
    map has no value."""
    grid, share = compensation.grid, compensation.share
    if share == 0.0:
        return 0.0, 0.0
    north = value_and_gradient(grid, position[0], position[1], NORTH)[0]
    east = value_and_gradient(grid, position[0], position[1], EAST)[0]
    if not (math.isfinite(north) and math.isfinite(east)):
        return 0.0, 0.0
    return share * north, share * east
