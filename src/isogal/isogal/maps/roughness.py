"""How rough is a map: what would it not show if its grid were half as dense?

The roughness is the RMS difference of a node from the mean of its neighbours on either side. What
a grid leaves out is a share of it, everywhere alike: over SE Australia, half as dense, 0.15 to
0.97 in 26 parts of a track on which both vary a hundredfold.
"""

import math

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
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
    result = np.empty(len(latitude))
    for t, (lat, lon) in enumerate(zip(latitude, longitude, strict=True)):
        row = (lat - grid.latitude0) / grid.latitude_step
        column = column_position(grid.values.shape[1], grid.longitude0, grid.longitude_step, lon)
        result[t] = _around(grid.values, row, column)
    return result


@kernel(error_model="numpy")
def _around(values, row, column):  # type: ignore[no-untyped-def]
    """Return the roughness around a fractional row and column."""
    total = weights = 0.0
    for i in range(max(round(row) - AROUND, 1), min(round(row) + AROUND + 1, len(values) - 1)):
        first, last = round(column) - AROUND, round(column) + AROUND + 1
        for j in range(max(first, 1), min(last, values.shape[1] - 1)):
            along = values[i, j] - 0.5 * (values[i + 1, j] + values[i - 1, j])
            across = values[i, j] - 0.5 * (values[i, j + 1] + values[i, j - 1])
            squared = 0.5 * (along * along + across * across)
            if math.isfinite(squared):
                weight = math.exp(-0.5 * ((i - row) ** 2 + (j - column) ** 2))
                total += weight * squared
                weights += weight
    return math.sqrt(total / weights) if weights > 0.0 else math.nan
