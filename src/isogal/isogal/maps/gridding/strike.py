"""In which direction a field is longer, place by place: the local strike.

A field whose correlation is c(sqrt(v' S⁻¹ v)) at a distance v, S with determinant 1, has gradients
g with E[g g'] proportional to S⁻¹. So S is taken from the structure tensor, the mean of g g' about
a place (Bigün & Granlund 1987), and since gradients between the lines of a survey are not known,
from its expectation given the readings, with the covariance of their error by kriging:

    S⁻¹ ~ mean of E[g] E[g]' + Cov[g].

Where readings tell nothing this is the S that was assumed. Assumed is first the strike of the
whole survey, then what was found (expectation maximisation; Dempster, Laird & Rubin 1977)."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.maps.gridding.covariance import Covariance, Readings
from isogal.maps.gridding.kriging import Kriging

_STEP, _WIDTH = 0.5, 1.0
"""Of places with a strike of their own, and 1-sigma of the Gaussian weights of the mean, both in
gaps between lines."""
_DIFFERENCE = 0.05
"""Of the gap, over which gradients are taken."""
_MOST = 3000
"""Places with a strike of their own, in the rectangle round a survey."""
_NEIGHBOURS = 200
"""Readings that gradients are kriged from."""
_ROUNDS = 5
_NEAR = 9
"""Places that a strike is interpolated between."""
_LONGEST = 1.5
"""Of the logarithm of S's larger eigenvalue."""


def local_strike(centre: Array, shape: Array, width: float) -> Callable[[Array], Array]:
    """Return what gives (P, 3) the elements north-north, north-east and east-east of S at places
    (P, 2+), m.

    Parameters
    ----------
    centre : (C, 2) array
        m, of places at which it is known.
    shape : (C, 2) array
        Elements east-east (less north-north) and east-north of log S there, whose trace is 0.
    width : float
        1-sigma of the Gaussian weights between them, m.
    """
    from scipy.spatial import cKDTree

    tree, most = cKDTree(centre), min(_NEAR, len(centre))

    def at(places: Array) -> Array:
        distance, near = (x.reshape(-1, most) for x in tree.query(places[:, :2], most))
        weight = np.exp(-0.5 * (distance**2 - distance[:, :1] ** 2) / width**2)
        each = np.einsum("pk,pkc->cp", weight, shape[near]) / weight.sum(axis=1)
        return _exponential(*each)

    return at


def _exponential(even: Array, odd: Array) -> Array:
    """Return (P, 3) S whose logarithm is [[even, odd], [odd, -even]], east first."""
    size = np.hypot(even, odd)
    ratio = np.sinh(size) / np.maximum(size, 1e-12)
    north, east = np.cosh(size) - even * ratio, np.cosh(size) + even * ratio
    return np.stack([north, odd * ratio, east], axis=-1)


def with_local_strike(
    readings: Readings, covariance: Covariance, gap: float, left_out: Booleans | None = None
) -> Kriging:
    """Return kriging with the strike of each place, which is learnt without some readings (N,).

    Parameters
    ----------
    readings : Readings
    covariance : Covariance
        With one strike, of the kind `matern`.
    gap : float
        m between lines.
    """
    centre = _centres(readings.places, gap)
    seen = readings if left_out is None else readings.part(~left_out)
    for _ in range(_ROUNDS):
        tensor = _tensor(Kriging(seen, covariance, _NEIGHBOURS), centre, _DIFFERENCE * gap)
        covariance = replace(covariance, local=_strike_of(centre, tensor, _WIDTH * gap))
    return Kriging(readings, covariance)


def can_be_local(places: Array, gap: float) -> bool:
    """Whether a survey (N, 3) m is small enough for places with a strike of their own to lie
    within two gaps between its lines (m): the structure tensor is averaged over one."""
    return _step(places, gap) <= 2.0 * gap


def _step(places: Array, gap: float) -> float:
    area = float(np.prod(np.ptp(places[:, :2], axis=0)))
    return max(_STEP * gap, math.sqrt(area / _MOST), 1.0)


def _centres(places: Array, gap: float) -> Array:
    """Return (C, 2) nodes of a grid next to which there are readings."""
    from scipy.spatial import cKDTree

    tree = cKDTree(places[:, :2])
    low, extent = places[:, :2].min(axis=0), np.ptp(places[:, :2], axis=0)
    step = _step(places, gap)
    count = np.ceil(extent / step).astype(int) + 1
    first = low + 0.5 * (extent - (count - 1) * step)
    axes = (a + step * np.arange(n) for a, n in zip(first, count, strict=True))
    nodes = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    return np.asarray(nodes[tree.query(nodes)[0] < max(step, gap)])


def _tensor(kriging: Kriging, centre: Array, step: float) -> Array:
    """Return (3, C) the expected elements east-east, east-north and north-north of g g'."""
    height = float(np.median(kriging.readings.places[:, 2]))
    corner = step * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    slope = np.array([[-1.0, 1.0, 0.0], [-1.0, 0.0, 1.0]]) / step
    found = np.empty((3, len(centre)))
    places = np.column_stack([centre, np.full(len(centre), height)])
    for rows in kriging.groups(places):
        mean, covariance = kriging.together((places[rows][:, None] + corner).reshape(-1, 3))
        each = np.arange(rows.size)
        own = covariance.reshape(rows.size, 3, rows.size, 3)[each, :, each]
        g = mean.reshape(-1, 3) @ slope.T
        square = g[:, :, None] * g[:, None] + slope @ own @ slope.T
        found[:, rows] = square[:, 0, 0], square[:, 0, 1], square[:, 1, 1]
    return found


def _strike_of(centre: Array, tensor: Array, width: float) -> Callable[[Array], Array]:
    """Return the strike of places (C, 2) by the tensor at each (3, C)."""
    square = ((centre[:, None] - centre) ** 2).sum(axis=-1)
    weight = np.exp(-0.5 * square / width**2)
    ee, en, nn = tensor @ weight
    # S is the inverse, with determinant 1, so cosh of its logarithm's size is half of its trace
    root = np.sqrt(np.maximum(ee * nn - en**2, 1e-12 * (ee + nn) ** 2))
    size = np.arccosh(np.maximum(0.5 * (ee + nn) / root, 1.0))
    turn = np.arctan2(-2.0 * en, nn - ee)
    size = np.minimum(size, _LONGEST)
    nearest = np.sqrt(np.sort(square, axis=1)[:, min(1, len(centre) - 1)])
    return local_strike(
        centre,
        np.stack([size * np.cos(turn), size * np.sin(turn)], axis=1),
        max(float(np.median(nearest)), 1.0),
    )
