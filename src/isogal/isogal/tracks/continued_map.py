"""A map continued beyond its edge and into its gaps.

A place at which some readings fall off the map is possible all the same: their likelihood must
neither be zero nor be left out, since then places with fewer readings on the map would be
compared by other data. So the field is continued by weighted means of what is known near by, and
its 1-sigma grows with the distance as the field itself varies: by the RMS gradient, to at most the
field's own standard deviation."""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.maps.field_map import FieldMap
from isogal.tracks.map_error import rms_gradient

_WIDTHS = (1e3, 2e3, 4e3, 8e3, 16e3, 32e3, 64e3)
"""m, 1-sigmas of the Gaussian weights, the narrowest that finds anything is taken."""
_SMOOTHING = 2000.0
"""m, over which the RMS gradient is averaged."""
_LEAST_WEIGHT = 0.02
"""Share of the weights that must fall on known nodes."""


@dataclass(frozen=True, slots=True, eq=False)
class ContinuedMap:
    """A map without gaps, and where its values are only continued."""

    field: FieldMap
    """With a value at every node; its sigma (if it has one node by node) continued, too."""
    doubt: FieldMap
    """The same with the 1-sigma of the continuation in place of the map's own: 0 where the map
    has values."""
    rough: FieldMap
    """The same with the RMS gradient (unit/m) in place of the map's own sigma."""
    original: FieldMap
    """Without the continuation."""
    spread: float
    """Standard deviation of the field."""
    reach: float
    """m, by which it is continued."""


@lru_cache(maxsize=1)  # tracks are matched one after the other on the same map
def continued(field_map: FieldMap, reach: float, floor: float = 0.0) -> ContinuedMap:
    """Return a map continued by at least `reach` (m) on every side.

    A sigma of its own is at least `floor` everywhere."""
    from scipy.ndimage import distance_transform_edt

    size = field_map.cell_size_m(float(np.mean(field_map.latitude)))
    rows, columns = (int(reach / s) + 4 for s in size)
    if field_map.longitude.size * field_map.step[1] > 2.0 * math.pi - 1e-6:
        columns = 0  # goes round the Earth
    pad = ((rows, rows), (columns, columns))
    values = np.pad(np.asarray(field_map.values, dtype=np.float64), pad, constant_values=np.nan)
    known = np.isfinite(values)
    distance = distance_transform_edt(~known, sampling=size)
    spread, slope = float(np.nanstd(values)), _rms_gradient(values, size)
    grid: dict[str, Any] = {
        "latitude": _longer(field_map.latitude, field_map.step[0], rows),
        "longitude": _longer(field_map.longitude, field_map.step[1], columns),
        "values": _filled(values, known, size),
    }
    if not isinstance(field_map.sigma, float):
        grid["sigma"] = np.maximum(_padded(field_map.sigma, pad), floor)
    if field_map.correlation_lengths is not None:
        grid["correlation_lengths"] = _padded(field_map.correlation_lengths, pad)
    if field_map.error_ellipses is not None:
        parts = np.moveaxis(field_map.error_ellipses, -1, 0)
        grid["error_ellipses"] = np.stack([_padded(part, pad) for part in parts], axis=-1)
    field = replace(field_map, **grid)
    doubt = np.where(known, 0.0, np.minimum(slope * distance, spread))
    return ContinuedMap(
        field=field,
        doubt=replace(field, sigma=doubt),
        rough=replace(field, sigma=rms_gradient(field, _SMOOTHING)),
        original=field_map,
        spread=spread,
        reach=reach,
    )


def _padded(of_error: Array, pad: tuple[tuple[int, int], tuple[int, int]]) -> Array:
    """Return what a map says of its error (n, m) with its median around, and where it is NaN."""
    padded = np.pad(np.asarray(of_error, dtype=np.float64), pad, constant_values=np.nan)
    return np.asarray(np.where(np.isfinite(padded), padded, np.nanmedian(padded)))


def _longer(axis: Array, step: float, count: int) -> Array:
    return np.asarray(axis[0] + step * (np.arange(axis.size + 2 * count) - count))


def _rms_gradient(values: Array, size: tuple[float, float]) -> float:
    north, east = np.gradient(values, *size)
    return math.sqrt(float(np.nanmean(north**2 + east**2))) if values.size else 0.0


def _filled(values: Array, known: Array, size: tuple[float, float]) -> Array:
    """Return the values with weighted means in place of NaN."""
    from scipy.ndimage import gaussian_filter

    if known.all():
        return values
    result = values.copy()
    seen, weight = np.where(known, values, 0.0), known.astype(np.float64)
    for width in _WIDTHS:
        sigma = [width / s for s in size]
        share = gaussian_filter(weight, sigma, mode="constant")
        take = ~np.isfinite(result) & (share > _LEAST_WEIGHT)
        if take.any():
            result[take] = gaussian_filter(seen, sigma, mode="constant")[take] / share[take]
        if np.isfinite(result).all():
            return result
    result[~np.isfinite(result)] = float(values[known].mean())
    return result
