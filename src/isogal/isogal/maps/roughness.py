"""How rough is a map around a place: what would it not show if its grid were half as dense?

The roughness is that of `FieldMap.roughness`, by the nodes around. What a grid leaves out is a
share of it, everywhere alike: over SE Australia, half as dense, 0.15 to 0.97 in 26 parts of a
track on which both vary a hundredfold.
"""

import math

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid, column_position

AROUND = 3
"""Nodes on either side of a place that its roughness is a mean over, with a Gaussian weight of one
node (1-sigma)."""


def roughness_at(field_map: FieldMap, latitude: Array, longitude: Array) -> Array:
    """Return (T,) that around points (T,) (rad), map's unit; NaN where nothing is known."""
    return np.asarray(_around(field_map.grid, latitude, longitude))


@kernel(error_model="numpy")
def _around(grid: Grid, latitude: Array, longitude: Array) -> Array:
    values, size = grid.values, grid.values.shape[1]
    out = np.empty(latitude.shape[0])
    for k in range(out.shape[0]):
        row = (latitude[k] - grid.latitude0) / grid.latitude_step
        column = column_position(size, grid.longitude0, grid.longitude_step, longitude[k])
        total = weights = 0.0
        for i in range(round(row) - AROUND, round(row) + AROUND + 1):
            for j in range(round(column) - AROUND, round(column) + AROUND + 1):
                if not (0 < i < grid.rows - 1 and 0 < j < size - 1):
                    continue
                along = values[i, j] - 0.5 * (values[i + 1, j] + values[i - 1, j])
                across = values[i, j] - 0.5 * (values[i, j + 1] + values[i, j - 1])
                squared = 0.5 * (along * along + across * across)
                if math.isfinite(squared):
                    weight = math.exp(-0.5 * ((i - row) ** 2 + (j - column) ** 2))
                    total += weight * squared
                    weights += weight
        out[k] = math.sqrt(total / weights)
    return out
