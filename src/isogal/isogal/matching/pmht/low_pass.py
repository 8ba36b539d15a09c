"""Readings that are a mean over the path behind the vehicle, by the instrument's low-pass filter.

docs/mathematics.md, section 5.1.
"""

from dataclasses import replace

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
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


def as_points(batch: Batch, field_map: FieldMap, xi: Array) -> Batch:
    """Return the batch as if each reading were of one point, the row's place, if the navigator's
    error is xi (4,): what the mean over the path differs by joins the offset."""
    if batch.filter_path is None:
        return batch
    moved = batch.transition @ xi
    north, east = metres_per_radian(batch.latitude)
    latitude, longitude = (
        batch.latitude - moved[:, 0] / north,
        batch.longitude - moved[:, 1] / east,
    )
    nodes = path_nodes(batch, np.arange(len(batch)))
    along = latitude[:, None] + nodes[..., 0], longitude[:, None] + nodes[..., 1]
    mean = (field_map.value(*along) * nodes[..., 2]).sum(axis=1)
    more = mean - field_map.value(latitude, longitude)
    return replace(batch, offset=batch.offset + np.nan_to_num(more))
