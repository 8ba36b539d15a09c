"""A map continued beyond its edge and into its gaps.

A place at which some readings fall off the map is possible all the same: their likelihood must
neither be zero nor be left out, since then places with fewer readings on the map would be
compared by other data. So the field is continued by the nearest value, and its 1-sigma grows with
the distance as the field itself varies: by the RMS gradient, to at most the field's own standard
deviation."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.maps.field_map import FieldMap

SMOOTHING = 2000.0
"""m, 1-sigma of the Gaussian weights with which the gradient is averaged: of 1, 2 and 4 km the
likeliest along the flight lines and along the tie lines over Scotland
(docs/evidence/real-data.md)."""


@dataclass(frozen=True, slots=True, eq=False)
class ContinuedMap:
    """A map without gaps, and where its values are only continued."""

    field: FieldMap
    """With a value at every node, and of its error (if it says it node by node) the median where
    that was unknown."""
    doubt: Array
    """(n, m) 1-sigma of the continuation at its nodes: 0 where the map has values."""
    rough: Array
    """(n, m) RMS gradient at its nodes, unit/m."""
    uneven: float
    """Mean of what the map says of its error node by node, map's unit; 0 = it does not say it."""


@lru_cache(maxsize=1)  # tracks are matched one after the other on the same map
def continued(field_map: FieldMap, reach: float) -> ContinuedMap:
    """Return a map continued by at least `reach` (m) on every side."""
    from scipy.ndimage import distance_transform_edt

    size = field_map.cell_size_m(float(np.mean(field_map.latitude)))
    rows, columns = (int(reach / s) + 4 for s in size)
    if field_map.longitude.size * field_map.step[1] > 2.0 * math.pi - 1e-6:
        columns = 0  # goes round the Earth

    def padded(values: NDArray[np.floating]) -> Array:
        pad = ((rows, rows), (columns, columns))
        return np.pad(np.asarray(values, dtype=np.float64), pad, constant_values=np.nan)

    def known_of_error(numbers: Array) -> Array:
        wide = padded(numbers)
        return np.where(np.isfinite(wide), wide, np.nanmedian(wide))

    def longer(axis: Array, step: float, count: int) -> Array:
        return axis[0] + step * (np.arange(axis.size + 2 * count) - count)

    values = padded(field_map.values)
    distance, nearest = distance_transform_edt(
        ~np.isfinite(values), sampling=size, return_indices=True
    )
    sigma, ellipses = field_map.sigma, field_map.error_ellipses
    if ellipses is not None:
        parts = np.moveaxis(ellipses, -1, 0)
        ellipses = np.stack([known_of_error(part) for part in parts], axis=-1)
    field = replace(
        field_map,
        latitude=longer(field_map.latitude, field_map.step[0], rows),
        longitude=longer(field_map.longitude, field_map.step[1], columns),
        values=values[tuple(nearest)],
        sigma=sigma if isinstance(sigma, float) else known_of_error(sigma),
        error_ellipses=ellipses,
    )
    slope = math.sqrt(float(np.nanmean(rms_gradient(field_map) ** 2)))
    doubt = np.minimum(slope * distance, float(np.nanstd(values)))
    uneven = 0.0 if isinstance(field_map.sigma, float) else field_map.usual_sigma
    return ContinuedMap(field, doubt, rms_gradient(field), uneven)


def rms_gradient(field_map: FieldMap) -> Array:
    """Return (n, m) the RMS gradient (unit/m) round each node, with Gaussian weights of 1-sigma
    `SMOOTHING`."""
    from scipy.ndimage import gaussian_filter

    latitude, longitude = np.meshgrid(field_map.latitude, field_map.longitude, indexing="ij")
    _, north, east = field_map.value_and_gradient(latitude, longitude)
    known = np.isfinite(north)
    cell = field_map.cell_size_m(float(np.mean(field_map.latitude)))
    widths = [SMOOTHING / size for size in cell]
    square = gaussian_filter(np.where(known, north**2 + east**2, 0.0), widths, mode="constant")
    weight = gaussian_filter(known.astype(np.float64), widths, mode="constant")
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.sqrt(np.where(weight > 1e-6, square / weight, np.nan))
