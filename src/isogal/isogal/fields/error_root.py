"""The square root of a map error's covariance, from which samples of it are drawn."""

from functools import lru_cache

import numpy as np

from isogal.arrays import Array

KEPT_PLACES = 2000
"""Places at most for a matrix to stay in memory (32 MB)."""


def error_root(latitude: Array, longitude: Array, sigma: float, length: float) -> Array:
    """Return (N, N) a square root of the covariance sigma² exp(-d / L) at places, rad, of any
    shape of size N; that of few places is kept for the next runs."""
    places = np.stack([latitude.ravel(), longitude.ravel()]).tobytes()
    root = _root if latitude.size <= KEPT_PLACES else _root.__wrapped__
    return root(places, sigma, length)


@lru_cache(maxsize=1)
def _root(places: bytes, sigma: float, length: float) -> Array:
    """Return (N, N) a square root of the map error's covariance at places, (2, N) rad as bytes."""
    from isogal.earth.frames import geodetic_to_ecef

    latitude, longitude = np.frombuffer(places).reshape(2, -1)
    points = geodetic_to_ecef(latitude, longitude, 0.0)
    distance = np.sqrt(np.maximum(((points[:, None, :] - points[None, :, :]) ** 2).sum(-1), 0.0))
    correlation = np.exp(-distance / length) + 1e-12 * np.eye(len(points))
    return np.asarray(np.linalg.cholesky(sigma**2 * correlation))
