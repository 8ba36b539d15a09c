"""Map feature variability: how much a map varies around a place (paper eq. CV).

C_i is the mean, over the n points of a fixed window template centred at place i (without i
itself), of the squared difference between the value at i and the value at the point. The paper
normalises it "over a fixed number of samples" and does not say how. Here C_i is divided by the
mean of C over the last ``samples`` places (at the start over those there are), so that 1 means "as
usual on this stretch"."""

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.field_map import flat_points
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.maps.tiled_map import ScalarMap

WINDOW = 2000.0
"""Half width of the template, m: about the 1-sigma horizontal error of an unaided navigator after
some hours."""
POINTS = 9
"""Points of the template along each side."""
SAMPLES = 100
"""Places that the normalisation looks back over: about 1000 s of scans every 10 s, the stretch of
a few batches."""


@lru_cache(maxsize=4)
def template(half_width: float = WINDOW, points: int = POINTS) -> tuple[Array, Array]:
    """Return the window template: a square lattice without its centre.

    Parameters
    ----------
    half_width : float
        m.
    points : int
        Along each side, odd and at least 3.

    Returns
    -------
    north, east : (n,) m
        n = points² - 1. Not to be written to.
    """
    if points < 3 or points % 2 == 0:
        raise InputError(f"variability points (--points) must be odd and at least 3, is {points}")
    if not (half_width > 0.0 and math.isfinite(half_width)):
        raise InputError(f"variability window must be > 0 m, is {half_width}")
    side = np.linspace(-half_width, half_width, points)
    north, east = (grid.reshape(-1) for grid in np.meshgrid(side, side, indexing="ij"))
    keep = np.arange(north.size) != north.size // 2
    return north[keep], east[keep]


@kernel(error_model="numpy")
def _variabilities(grid: Grid, places: Array, template: Array, metres: Array) -> Array:
    """Return C (paper eq. CV) at many places.

    Parameters
    ----------
    grid : Grid
    places : (K, 2) rad
        Latitude and longitude.
    template : (n, 2) m
        North and east. Points without a value are left out; C is NaN where the place itself or
        more than half of the template has none.
    metres : (K, 2)
        For one rad of latitude and of longitude at the places.
    """
    out = np.empty(len(places))
    for k in range(len(places)):
        lat, lon = places[k]
        north, east = metres[k]
        centre = value_and_gradient(grid, lat, lon)[0]
        total, count = 0.0, 0
        for up, right in template:
            value = value_and_gradient(grid, lat + up / north, lon + right / east)[0]
            difference = value - centre
            if not math.isnan(difference):
                total += difference * difference
                count += 1
        enough = 2 * count >= len(template) and count > 0
        out[k] = total / count if enough else math.nan
    return out


def feature_variability(
    field_map: ScalarMap,
    latitude: ArrayLike,
    longitude: ArrayLike,
    half_width: float = WINDOW,
    points: int = POINTS,
) -> Array:
    """Return C (paper eq. CV) at many places.

    Parameters
    ----------
    field_map : FieldMap or TiledMap
    latitude, longitude : rad
        Places, any shapes that broadcast.
    half_width, points
        The template.

    Returns
    -------
    array of the shape of the places
        Unit of the map squared; NaN where the map has no value at the place or at more than half
        of its template.
    """
    offsets = np.stack(template(half_width, points), axis=1)
    flat_lat, flat_lon, shape = flat_points(latitude, longitude)
    places = np.stack([flat_lat, flat_lon], axis=1)
    metres = np.stack(metres_per_radian(flat_lat), axis=1)
    out = np.full(flat_lat.size, np.nan)
    for rows, part in field_map.split(flat_lat, flat_lon, 2.0 * half_width):
        out[rows] = _variabilities(part.grid, places[rows], offsets, metres[rows])
    return out.reshape(shape)


def normalised_variability(variability: ArrayLike, samples: int = SAMPLES) -> Array:
    """Return a sequence of C along a track divided by its mean over the last places.

    Parameters
    ----------
    variability : (..., K)
        C at successive places; NaN places are skipped in the mean and stay NaN.
    samples : int
        How many places, up to and with the present one, the mean is taken over.

    Returns
    -------
    (..., K)
        No unit. Where the mean is zero (a flat map) the result is zero.
    """
    c = np.asarray(variability, dtype=np.float64)
    if samples < 1:
        raise InputError(f"variability samples must be at least 1, is {samples}")
    known = np.isfinite(c)
    sums = np.cumsum(np.where(known, c, 0.0), axis=-1)
    counts = np.cumsum(known, axis=-1)
    sums[..., samples:] = sums[..., samples:] - sums[..., :-samples]
    counts[..., samples:] = counts[..., samples:] - counts[..., :-samples]
    mean = sums / np.maximum(counts, 1)
    return np.where(known, np.divide(c, mean, out=np.zeros_like(c), where=mean > 0.0), np.nan)
