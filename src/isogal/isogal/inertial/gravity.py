"""Horizontal gravity that the strapdown takes off by a map, at its own position.

Gravity is not vertical: beside normal gravity the vehicle feels the disturbance vector, whose
horizontal part is a few arc seconds of the whole, that is some ten mGal, a hundred times the
accelerometer bias of the precision grade. A navigator that has a map of it takes it off where it
believes to be; what is left goes with the map's error, and with the navigator's position error by
the map's gradient (docs/mathematics.md, section 3.9).
"""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature
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


def no_compensation() -> Compensation:
    """Return the compensation of a navigator that knows nothing of horizontal gravity."""
    return Compensation(Grid(np.zeros((8, 4)), 4, 0.0, 1.0, 0.0, 1.0), 0.0)


def compensation_by(field_map: ChannelMap | None, share: float = 1.0) -> Compensation:
    """Return the compensation by a map of `gravity_north` and `gravity_east`; None = none."""
    if field_map is None or share == 0.0:
        return no_compensation()
    return Compensation(field_map.grid, share)


@kernel
def horizontal_gravity(compensation: Compensation, position: Array) -> tuple[float, ...]:
    """Return the compensation at a position (3,): to north and east (m/s²), and the derivatives of
    both by north and by east (1/s²). Nothing where the map has no value."""
    grid, share = compensation
    if share == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    m, n = curvature(math.sin(position[0]))
    north = share / (m + position[2])
    east = share / ((n + position[2]) * math.cos(position[0]))
    gn, gn_lat, gn_lon = value_and_gradient(grid, position[0], position[1], NORTH)
    ge, ge_lat, ge_lon = value_and_gradient(grid, position[0], position[1], EAST)
    if not (math.isfinite(gn) and math.isfinite(ge)):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    return share * gn, share * ge, gn_lat * north, gn_lon * east, ge_lat * north, ge_lon * east
