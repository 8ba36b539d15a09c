"""Symmetric matrices: what several places need of them."""

import math

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.compiled import kernel


def symmetric(matrix: NDArray[np.floating]) -> Array:
    """Return the symmetric part of a matrix (..., n, n), against rounding."""
    return 0.5 * (matrix + matrix.swapaxes(-1, -2))


def square_root(covariance: Array) -> Array:
    """Return A (n, n) with A A' = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


# Of 7 x 7 LAPACK's factors take 1.5 times as long from compiled code as these.
@kernel
def lower(matrix: Array) -> Array:
    """Return the lower Cholesky factor (n, n) of a small matrix; NaN where the matrix is not
    positive definite."""
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
                return np.full((n, n), np.nan)
    return factor


@kernel
def inverse_of_lower(factor: Array) -> Array:
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


@kernel
def product(a: Array, b: Array) -> Array:
    """Return a b of small matrices (n, k), (k, m)."""
    out = np.zeros((a.shape[0], b.shape[1]))
    for i in range(a.shape[0]):
        for c in range(a.shape[1]):
            for j in range(b.shape[1]):
                out[i, j] += a[i, c] * b[c, j]
    return out


@kernel
def product_transposed(a: Array, b: Array) -> Array:
    """Return a b' of small matrices (n, k), (m, k): `product` of a transposed array would be
    compiled anew."""
    out = np.empty((a.shape[0], b.shape[0]))
    for i in range(a.shape[0]):
        for j in range(b.shape[0]):
            total = 0.0
            for c in range(a.shape[1]):
                total += a[i, c] * b[j, c]
            out[i, j] = total
    return out
