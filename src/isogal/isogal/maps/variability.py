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
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps.field_map import flat_points
from isogal.maps.tiled_map import ScalarMap

WINDOW = 2000.0
"""Half width of the template, m: about the 1-sigma horizontal error of an unaided navigator after
some hours."""
POINTS = 9
"""Points of the template along each side."""
SAMPLES = 100
"""Places that the normalisation looks back over: about 1000 s of scans every 10 s, the stretch of
a few batches."""
MOST_POINTS = 1001
"""Along each side of a template: a million values of the map for each place."""
_TOGETHER = 1_600_000
"""Values of the map that are looked up at once."""


@lru_cache(maxsize=4)
def template(half_width: float = WINDOW, points: int = POINTS) -> tuple[Array, Array]:
    """Return the window template: a square lattice without its centre.

    Parameters
    ----------
    half_width : float
        m.
    points : int
        Along each side, odd, 3 to `MOST_POINTS`.

    Returns
    -------
    north, east : (n,) m
        n = points² - 1. Not to be written to.
    """
    if not 3 <= points <= MOST_POINTS or points % 2 == 0 or not 0.0 < half_width < math.inf:
        raise InputError(
            f"variability points (--points) must be odd, 3 to {MOST_POINTS}, and the half width >"
            f" 0 m; they are {points} and {half_width}"
        )
    side = np.linspace(-half_width, half_width, points)
    north, east = (grid.reshape(-1) for grid in np.meshgrid(side, side, indexing="ij"))
    keep = np.arange(north.size) != north.size // 2
    return north[keep], east[keep]


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
    north, east = (np.append(0.0, side) for side in template(half_width, points))
    flat_lat, flat_lon, shape = flat_points(latitude, longitude)
    out = np.full(flat_lat.size, np.nan)
    together = max(1, _TOGETHER // north.size)
    for first in range(0, out.size, together):
        lat, lon = (one[first : first + together, None] for one in (flat_lat, flat_lon))
        metres_north, metres_east = metres_per_radian(lat)
        value = field_map.value(lat + north / metres_north, lon + east / metres_east)
        square = (value[:, 1:] - value[:, :1]) ** 2
        known = np.isfinite(square)
        count = known.sum(axis=1)
        mean = np.where(known, square, 0.0).sum(axis=1) / np.maximum(count, 1)
        out[first : first + together] = np.where(2 * count >= square.shape[1], mean, np.nan)
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
