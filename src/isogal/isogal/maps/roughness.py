"""How rough is a map: what would it not show if its grid were half as dense?

The roughness is the RMS difference of a node from the mean of its neighbours on either side. What
a grid leaves out is a share of it, everywhere alike: over SE Australia, half as dense, 0.15 to
0.97 in 26 parts of a track on which both vary a hundredfold.
"""

import math

import numpy as np

from isogal.arrays import Array
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import column_position

AROUND = 3
"""Nodes on either side of a place that its roughness is a mean over, with a Gaussian weight of one
node (1-sigma)."""


def roughness(field_map: FieldMap) -> float:
    """Return that of the whole map (map's unit), by at most 200 x 200 nodes; 0 where nothing is
    known."""
    steps = [max(1, count // 200) for count in field_map.values.shape]
    values = field_map.values
    along = values[1:-1] - 0.5 * (values[2:] + values[:-2])
    across = values[:, 1:-1] - 0.5 * (values[:, 2:] + values[:, :-2])
    known = np.concatenate([part[:: steps[0], :: steps[1]].ravel() for part in (along, across)])
    known = known[np.isfinite(known)]
    return math.sqrt(float((known**2).mean())) if known.size else 0.0


def roughness_at(field_map: FieldMap, latitude: Array, longitude: Array) -> Array:
    """Return (T,) that around points (T,) (rad), map's unit; NaN where nothing is known."""
    grid = field_map.grid
    rows = (latitude - grid.latitude0) / grid.latitude_step
    size = grid.values.shape[1]
    columns = np.array(
        [column_position(size, grid.longitude0, grid.longitude_step, lon) for lon in longitude]
    )
    around = np.arange(-AROUND, AROUND + 1)
    i = np.rint(rows).astype(int)[:, None, None] + around[:, None]
    j = np.rint(columns).astype(int)[:, None, None] + around
    inside = (i > 0) & (i < len(grid.values) - 1) & (j > 0) & (j < size - 1)
    i, j = np.where(inside, i, 1), np.where(inside, j, 1)
    here = grid.values
    along = here[i, j] - 0.5 * (here[i + 1, j] + here[i - 1, j])
    across = here[i, j] - 0.5 * (here[i, j + 1] + here[i, j - 1])
    squared = 0.5 * (along * along + across * across)
    away = (i - rows[:, None, None]) ** 2 + (j - columns[:, None, None]) ** 2
    weight = np.where(inside & np.isfinite(squared), np.exp(-0.5 * away), 0.0)
    total = (weight * np.nan_to_num(squared)).sum(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.sqrt(total / weight.sum(axis=(1, 2))))
