"""Readings that are a mean over the path behind the vehicle, by the instrument's low-pass filter.

docs/mathematics.md, section 5.1.
"""

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.interfaces import Batch

_LEAST_WEIGHT = 1e-4
"""Of a node of the path: what those of less weight change of a reading is less than 1e-5 of how
the field differs along it."""


def path_nodes(batch: Batch, rows: Integers) -> Array:
    """Return (T, K, 3) for some rows of a batch the points that a reading is a weighted mean over:
    latitude and longitude (rad) beside the row's place, and weight; a single one, the place
    itself, where the instrument has no filter."""
    path = batch.filter_path
    if path is None:
        place = np.zeros((len(rows), 1, 3))
        place[..., 2] = 1.0
        return place
    counts = path.weight > _LEAST_WEIGHT
    north, east = metres_per_radian(batch.latitude[rows])
    away = path.away[rows][:, counts]
    weight = path.weight[counts] / path.weight[counts].sum()
    nodes = [away[..., 0] / north[:, None], away[..., 1] / east[:, None]]
    every = np.stack([*nodes, np.broadcast_to(weight, away.shape[:2])], axis=-1)
    return np.ascontiguousarray(every)  # kernels are compiled once for each memory layout
