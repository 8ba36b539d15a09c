"""Symmetric matrices: what several places need of them."""

import math

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.compiled import kernel

_MOST_STEPS = 50
"""For an eigenvalue; it takes one or two."""


def symmetric(matrix: NDArray[np.floating]) -> Array:
    """Return the symmetric part of a matrix (..., n, n), against rounding."""
    return 0.5 * (matrix + matrix.swapaxes(-1, -2))


def square_root(covariance: Array) -> Array:
    """Return A (n, n) with A A' = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


# Of 7 x 7 LAPACK's factors and eigenvalues take 1.5 times as long from compiled code as these.
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


@kernel
def eigen(matrix: Array) -> tuple[Array, Array]:
    """Return eigenvalues (n,), in rising order, and eigenvectors, the columns of (n, n), of the
    symmetric part of a small matrix (n, n): Householder's reduction and QL steps (Bowdler, Martin,
    Reinsch & Wilkinson 1968, Numer. Math. 11:293). NaN where it is not finite."""
    n = matrix.shape[0]
    vectors, d, e = np.empty((n, n)), np.empty(n), np.zeros(n)
    total = 0.0
    for i in range(n):
        for j in range(n):
            vectors[i, j] = 0.5 * (matrix[i, j] + matrix[j, i])
            total += vectors[i, j]
    if not math.isfinite(total):
        return np.full(n, np.nan), vectors
    _tridiagonal(vectors, d, e)
    for k in range(n):
        size = 0.0
        for _ in range(_MOST_STEPS):
            last = k
            while last < n - 1:
                size = abs(d[last]) + abs(d[last + 1])
                if abs(e[last]) <= 1e-16 * size:
                    break
                last += 1
            if last == k:
                break
            g = 0.5 * (d[k + 1] - d[k]) / e[k]
            g = d[last] - d[k] + e[k] / (g + math.copysign(math.sqrt(1.0 + g * g), g))
            s = c = 1.0
            p = 0.0
            for i in range(last - 1, k - 1, -1):
                f, b = s * e[i], c * e[i]
                r = math.sqrt(f * f + g * g)
                e[i + 1] = r
                if r == 0.0:
                    d[i + 1] -= p
                    break
                s, c = f / r, g / r
                g = d[i + 1] - p
                r = (d[i] - g) * s + 2.0 * c * b
                p = s * r
                d[i + 1] = g + p
                g = c * r - b
                for j in range(n):
                    f = vectors[j, i + 1]
                    vectors[j, i + 1] = s * vectors[j, i] + c * f
                    vectors[j, i] = c * vectors[j, i] - s * f
            else:
                d[k] -= p
                e[k] = g
            e[last] = 0.0
    for i in range(1, n):
        for j in range(i, 0, -1):
            if d[j] < d[j - 1]:
                d[j], d[j - 1] = d[j - 1], d[j]
                for k in range(n):
                    vectors[k, j], vectors[k, j - 1] = vectors[k, j - 1], vectors[k, j]
    return d, vectors


@kernel
def _tridiagonal(v: Array, d: Array, e: Array) -> None:
    """Turn a symmetric matrix (n, n) into the orthogonal one that makes it tridiagonal, in place,
    and write its diagonal and, in the first n - 1, what is beside that."""
    n = v.shape[0]
    for i in range(n - 1, 0, -1):
        h = 0.0
        for k in range(i - 1):
            h += v[i, k] * v[i, k]
        if h == 0.0:
            e[i] = v[i, i - 1]
        else:
            f = v[i, i - 1]
            h += f * f
            g = -math.copysign(math.sqrt(h), f)
            e[i] = g
            h -= f * g
            v[i, i - 1] = f - g
            f = 0.0
            for j in range(i):
                v[j, i] = v[i, j] / h
                g = 0.0
                for k in range(j + 1):
                    g += v[j, k] * v[i, k]
                for k in range(j + 1, i):
                    g += v[k, j] * v[i, k]
                e[j] = g / h
                f += e[j] * v[i, j]
            f /= h + h
            for j in range(i):
                e[j] -= f * v[i, j]
                for k in range(j + 1):
                    v[j, k] -= v[i, j] * e[k] + e[j] * v[i, k]
        d[i] = h
    d[0] = 0.0
    for i in range(n):
        if d[i] != 0.0:
            for j in range(i):
                g = 0.0
                for k in range(i):
                    g += v[i, k] * v[k, j]
                for k in range(i):
                    v[k, j] -= g * v[k, i]
        d[i] = v[i, i]
        v[i, i] = 1.0
        for j in range(i):
            v[j, i] = v[i, j] = 0.0
    for i in range(1, n):
        e[i - 1] = e[i]
    e[n - 1] = 0.0
