"""Symmetric matrices: what several places need of them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array


def symmetric(matrix: NDArray[Any]) -> Array:
    """Return the symmetric part of a matrix (..., n, n), against rounding."""
    return np.asarray(0.5 * (matrix + np.swapaxes(matrix, -1, -2)), dtype=np.float64)


def positive_part(matrix: Array, scale: Array | None = None) -> Array:
    """Return a symmetric matrix (n, n) without its negative part.

    Parameters
    ----------
    matrix : (n, n) array
    scale : (n,) array, optional
        Unit of each state, in which eigenvalues are compared; default 1.
    """
    scale = np.ones(len(matrix)) if scale is None else scale
    values, vectors = np.linalg.eigh(matrix / scale / scale[:, None])
    back = vectors * scale[:, None]
    return np.asarray((back * np.maximum(values, 0.0)) @ back.T, dtype=np.float64)


def square_root(covariance: Array) -> Array:
    """Return A (n, n) with A A' = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(symmetric(covariance))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)
