"""By how much a gridded map may show its anomalies beside their place (docs/mathematics.md,
section 10.3).

Between a survey's lines a map repeats what is known beside them: anomalies that run aslant, in
directions that change from place to place, are found there, but not in their place. To a track
this looks like a shift, of the size that turns the map's own variation into its error, and no
reading tells it from an error of the navigator's position. So it is a state with a prior, of which
hardly anything is learnt."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.maps.field_map import FieldMap
from isogal.maps.variability import feature_variability

SIZE = 0.4
"""1-sigma of the displacement where a map tells nothing, in correlation lengths of the map's
error: measured (docs/evidence/real-data.md)."""
EXTENT = 50.0
"""Correlation lengths of the map's error over which a displacement holds together: along tracks of
10 to 200 of them it is as if it were one (docs/evidence/real.md)."""
WINDOW = 2.0
"""Half width, in correlation lengths of the map's error, of the square in which the map's
variation about a place counts."""


def displacement(length: ArrayLike, error: ArrayLike, shown: ArrayLike) -> Array:
    """Return the 1-sigma of the displacement along each axis, m.

    Parameters
    ----------
    length : array, m
        Over which the map's errors hold together.
    error, shown : arrays, map's unit squared
        Variances of the map's error, and of what the map shows.
    """
    share = np.asarray(error) / np.maximum(np.add(error, shown), 1e-300)
    return np.asarray(SIZE * np.asarray(length) * np.sqrt(share))


def length_of(field_map: FieldMap) -> float | None:
    """Return the correlation length of the error (m) of a map that may be displaced: one that says
    place by place over which lengths its errors hold together, as those of `isogal map grid` do;
    None = it does not."""
    return None if field_map.error_ellipses is None else field_map.correlation_length


def displacement_at(field_map: FieldMap, latitude: Array, longitude: Array) -> Array:
    """Return (T,) the 1-sigma at points (T,), rad; 0 of a map that has no `length_of`."""
    length = length_of(field_map)
    if length is None:
        return np.zeros(len(latitude))
    error = field_map.sigma_at(latitude, longitude) ** 2
    # the mean squared difference of two places is twice the variance
    around = 0.5 * feature_variability(field_map, latitude, longitude, WINDOW * length)
    around = np.where(np.isfinite(around), around, field_map.scale**2)
    error = np.where(np.isfinite(error), error, field_map.usual_sigma**2)
    return displacement(length, error, around)
