"""Symmetric matrices: what several places need of them."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.compiled import kernel


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


def inverse(matrix: NDArray[Any]) -> Array:
    """Return the inverse of a small matrix (n, n), in less time than NumPy takes to look at it.

    Raises
    ------
    LinAlgError
        It is singular, or not finite.
    """
    result = _inverse(np.ascontiguousarray(matrix, dtype=np.float64))
    if not np.isfinite(result[0, 0]):
        raise np.linalg.LinAlgError("Singular matrix")
    return np.asarray(result)


@kernel
def _inverse(matrix):  # type: ignore[no-untyped-def]
    """Gauss-Jordan elimination with pivots of each column; NaN where there is none."""
    n = matrix.shape[0]
    left, right = matrix.copy(), np.eye(n)
    for c in range(n):
        pivot = c
        for r in range(c + 1, n):
            if abs(left[r, c]) > abs(left[pivot, c]):
                pivot = r
        if not abs(left[pivot, c]) > 0.0:
            return np.full((n, n), np.nan)
        if pivot != c:
            for k in range(n):
                left[c, k], left[pivot, k] = left[pivot, k], left[c, k]
                right[c, k], right[pivot, k] = right[pivot, k], right[c, k]
        for k in range(n):
            right[c, k] /= left[c, c]
        for k in range(n - 1, c - 1, -1):
            left[c, k] /= left[c, c]
        for r in range(n):
            factor = left[r, c]
            if r != c and factor != 0.0:
                for k in range(n):
                    right[r, k] -= factor * right[c, k]
                for k in range(c, n):
                    left[r, k] -= factor * left[c, k]
    return right


@kernel
def lower(matrix):  # type: ignore[no-untyped-def]
    """Return the lower Cholesky factor (n, n) of a small matrix; its last element is NaN where
    the matrix is not positive definite."""
    n = matrix.shape[0]
    factor = np.zeros((n, n))
    for a in range(n):
        for b in range(a + 1):
            value = matrix[a, b]
            for c in range(b):
                value -= factor[a, c] * factor[b, c]
            if a > b:
                factor[a, b] = value / factor[b, b]
            elif value > 0.0:
                factor[a, a] = math.sqrt(value)
            else:
                factor[n - 1, n - 1] = np.nan
                return factor
    return factor


@kernel
def inverse_of_lower(factor):  # type: ignore[no-untyped-def]
    """Return the inverse of a lower triangle (n, n)."""
    n = factor.shape[0]
    out = np.zeros((n, n))
    for a in range(n):
        for b in range(a + 1):
            value = 1.0 if a == b else 0.0
            for c in range(b, a):
                value -= factor[a, c] * out[c, b]
            out[a, b] = value / factor[a, a]
    return out
