"""Readings that are a mean over the path behind the vehicle, by the instrument's low-pass filter.

docs/mathematics.md, section 5.8.
"""

from dataclasses import replace

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.path import FilterPath
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.quasi_random import standard_normal

_POINTS = 16
"""Of the prior, at which it is seen how far the map's curvature is from what it is at the mean."""


def at_points(batch: Batch, field_map: FieldMap, prior: Mixture) -> Batch:
    """Return the batch as if each reading were of one point, the row's place.

    What the mean over the path differs by is known from the map where the navigator believes to
    be: it joins the offset, and its derivatives join those of the reduction. What is left where
    the place is uncertain joins the white noise.
    """
    path = batch.filter_path
    if path is None:
        return batch
    mean, covariance = prior.moments()
    root = np.linalg.cholesky(covariance + 1e-12 * np.diag(np.diag(covariance)))
    xi = mean + np.concatenate([np.zeros((1, 4)), standard_normal(_POINTS, 4)]) @ root.T
    moved = np.einsum("tij,sj->sti", batch.transition, xi)
    more = _more(batch, path, field_map, moved)
    slope = _slope(batch, path, field_map, moved[0])
    by_xi = np.einsum("ti,tij->tj", slope, batch.transition)
    left = np.nan_to_num(more - more[0] - (xi - mean) @ by_xi.T)[1:]
    variance = (left**2).mean(axis=0)
    covariance_of_readings = batch.reading_covariance
    if covariance_of_readings is not None:
        covariance_of_readings = covariance_of_readings + np.diag(variance)
    return replace(
        batch,
        offset=batch.offset + np.nan_to_num(more[0] - by_xi @ mean),
        sigma=np.sqrt(batch.sigma**2 + variance),
        reading_jacobian=batch.reading_jacobian + by_xi,
        nuisance_reading=batch.nuisance_reading
        + np.einsum("ti,tij->tj", slope, batch.nuisance_position),
        reading_covariance=covariance_of_readings,
    )


def _places(batch: Batch, path: FilterPath, moved: Array) -> tuple[Array, Array]:
    """Return latitude and longitude (..., T, K) of the path's nodes if the navigator's error at
    the rows is (..., T, 2) m."""
    north, east = metres_per_radian(batch.latitude)
    away = path.away - moved[..., None, :]
    return (
        batch.latitude[:, None] + away[..., 0] / north[:, None],
        batch.longitude[:, None] + away[..., 1] / east[:, None],
    )


def _more(batch: Batch, path: FilterPath, field_map: FieldMap, moved: Array) -> Array:
    """Return (S, T) the mean over the path less the value at the row's place."""
    mean = field_map.value(*_places(batch, path, moved)) @ path.weight
    here = replace(path, away=np.zeros((len(batch), 1, 2)))
    return np.asarray(mean - field_map.value(*_places(batch, here, moved))[..., 0])


def _slope(batch: Batch, path: FilterPath, field_map: FieldMap, moved: Array) -> Array:
    """Return (T, 2) the derivative of that by the navigator's error (north, east) at the row."""
    here = replace(path, away=np.zeros((len(batch), 1, 2)))
    _, *of_mean = field_map.value_and_gradient(*_places(batch, path, moved))
    _, *of_point = field_map.value_and_gradient(*_places(batch, here, moved))
    slope = [
        one @ path.weight - other[..., 0] for one, other in zip(of_mean, of_point, strict=True)
    ]
    return -np.nan_to_num(np.stack(slope, axis=-1))
