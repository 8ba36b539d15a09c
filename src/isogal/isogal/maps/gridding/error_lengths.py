"""Over which distance, and in which direction further, the errors of a map hold together."""

import numpy as np

from isogal.arrays import Array

_WIDTH = 0.5
"""1-sigma of the weight of a pair of places, of the logarithm of -log correlation: pairs count
whose correlation is next to exp(-1)."""
_ROUND = 2.0
"""Pairs of places that the same length in all directions counts for: keeps an ellipse defined
where few places lie around."""
_MOST = 8.0
"""Factor at most of an ellipse's axes on the length of all directions."""


def error_lengths(places: Array, covariance: Array) -> Array:
    """Return (P,) the distance (m) at which the errors at places hold together as exp(-d / L)
    does, by their covariance (P, P) among each other.

    It is matched where the correlation is next to exp(-1), in the mean of the places around.
    """
    decay, weight, apart = _pairs(places, covariance)
    distance = np.hypot(apart[..., 0], apart[..., 1])
    far = np.where(np.eye(len(places), dtype=np.bool_), np.inf, distance)
    nearest = np.argmin(far, axis=1)
    index = np.arange(len(places))
    single = far[index, nearest] / decay[index, nearest]
    total = weight.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (weight * distance / decay).sum(axis=1) / total
    return np.where(total > 1.0, mean, single).astype(np.float64)


def error_ellipses(places: Array, covariance: Array, length: Array) -> Array:
    """Return (P, 3) m² the north-north, north-east and east-east elements of the matrix E by which
    the errors at places hold together as exp(-sqrt(v' E⁻¹ v)) does at a distance v.

    E⁻¹ is fitted by least squares of v' E⁻¹ v / (log correlation)² - 1 over pairs whose
    correlation is next to exp(-1), with a few pairs of the length (P,) of all directions.

    Parameters
    ----------
    places : (P, 2+) east, north, m
    covariance : (P, P)
    length : (P,) m, see `error_lengths`
    """
    decay, weight, apart = _pairs(places, covariance)
    east, north = apart[..., 0] / length[:, None], apart[..., 1] / length[:, None]
    rows = np.stack([north**2, 2.0 * north * east, east**2]) / decay**2
    normal = np.einsum("aij,bij,ij->iab", rows, rows, weight, optimize=True)
    right = np.einsum("aij,ij->ia", rows, weight)
    # rows of pairs at the distance `length` in all directions, whose mean this is
    around = _ROUND * np.array([[0.375, 0.0, 0.125], [0.0, 0.5, 0.0], [0.125, 0.0, 0.375]])
    found = np.linalg.solve(
        normal + around, (right + _ROUND * np.array([0.5, 0.0, 0.5]))[..., None]
    )
    nn, ne, ee = found[..., 0].T
    values, axes = np.linalg.eigh(np.stack([nn, ne, ne, ee], axis=1).reshape(-1, 2, 2))
    values = length[:, None] ** 2 / np.clip(values, _MOST**-2, _MOST**2)
    ellipse = np.einsum("iak,ik,ibk->iab", axes, values, axes)
    return np.stack([ellipse[:, 0, 0], ellipse[:, 0, 1], ellipse[:, 1, 1]], axis=1)


def _pairs(places: Array, covariance: Array) -> tuple[Array, Array, Array]:
    """Return -log correlation (P, P), the weight (P, P) of each pair, and how far (P, P, 2) the
    second is east and north of the first, m."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    correlation = np.clip(covariance / np.outer(sigma, sigma), 1e-3, 1.0 - 1e-9)
    decay = -np.log(correlation)
    weight = np.exp(-((np.log(decay) / _WIDTH) ** 2))
    np.fill_diagonal(weight, 0.0)
    return decay, weight, places[:, None, :2] - places[:, :2]
