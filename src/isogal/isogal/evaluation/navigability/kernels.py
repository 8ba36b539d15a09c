"""The bound at many nodes: compiled functions.

Along a leg the noise of readings is white noise and a map error that is a first-order Gauss-Markov
process. A scalar Kalman filter of the map error turns readings into independent ones (innovations;
Kailath 1968, IEEE Trans. Automatic Control 13(6)), here the derivatives of readings by the
coefficients of `isogal.evaluation.navigability.leg`. Their squares add up to the Fisher
information.

A reading lies as far from one node of a row as from another of that row. So the weights of the
interpolation (those of `isogal.maps.interpolation`) are the same along the row, and nodes of a row
are computed side by side, in short stretches."""

import math

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel

SIDE_BY_SIDE = 64
"""Nodes of a row that are computed together."""


@kernel(error_model="numpy")
def _cubic(weights, slopes, u):  # type: ignore[no-untyped-def]
    """Write the weights of four nodes, and those of the derivative, at fraction u between the
    second and the third (Keys 1981, a = -1/2)."""
    weights[0] = ((-0.5 * u + 1.0) * u - 0.5) * u
    weights[1] = (1.5 * u - 2.5) * u * u + 1.0
    weights[2] = ((-1.5 * u + 2.0) * u + 0.5) * u
    weights[3] = (0.5 * u - 0.5) * u * u
    slopes[0] = (-1.5 * u + 2.0) * u - 0.5
    slopes[1] = (4.5 * u - 5.0) * u
    slopes[2] = (-4.5 * u + 4.0) * u + 0.5
    slopes[3] = (1.5 * u - 1.0) * u


@kernel(error_model="numpy")
def _interpolate(values, row, column, columns, out):  # type: ignore[no-untyped-def]
    """Write value, derivative by row and by column (3, B) at `column` columns from each of some
    columns (B,), in fractional row `row`; NaN outside."""
    n, m = values.shape
    i, shift = math.floor(row), math.floor(column)
    weights, slopes = np.empty((2, 4)), np.empty((2, 4))
    _cubic(weights[0], slopes[0], row - i)
    _cubic(weights[1], slopes[1], column - shift)
    for b in range(columns.shape[0]):
        out[0, b] = out[1, b] = out[2, b] = math.nan
    if i < 1 or i + 2 > n - 1:
        return
    for b in range(columns.shape[0]):
        j = columns[b] + shift
        if j < 1 or j + 2 > m - 1:
            continue
        value, by_row, by_column = 0.0, 0.0, 0.0
        for q in range(4):
            along, steep = 0.0, 0.0
            for p in range(4):
                node = values[i + p - 1, j + q - 1]
                along += weights[0, p] * node
                steep += slopes[0, p] * node
            value += weights[1, q] * along
            by_row += weights[1, q] * steep
            by_column += slopes[1, q] * along
        out[0, b], out[1, b], out[2, b] = value, by_row, by_column


@kernel(error_model="numpy")
def errors_on_arrival(  # type: ignore[no-untyped-def]
    rows: Integers,
    columns: Integers,
    values: Array,
    cell: Array,
    offset: Array,
    position: Array,
    reduction: Array,
    constants: Array,
    sigma: Array,
    length: Array,
):
    """Return (N, M) the RMS horizontal error (m) at nodes, by one leg.

    Parameters
    ----------
    rows, columns : (N,), (M,) nodes of the map
    values : (n, m) the map
    cell : (n, 2) m between nodes to the north and to the east, by row
    offset, position, reduction
        See `Leg`.
    constants : (3,) noise, step and rest of the leg
    sigma, length : (n, m)
        1-sigma and correlation length of the map's error.
    """
    T, m = reduction.shape
    noise, step, rest = constants
    out = np.full((rows.size, columns.size), math.nan)
    at = np.empty((3, SIDE_BY_SIDE))
    correlation, variance, left = np.empty((3, SIDE_BY_SIDE))
    information = np.empty((m, m, SIDE_BY_SIDE))
    forecast, h = np.empty((m, SIDE_BY_SIDE)), np.empty((m, SIDE_BY_SIDE))
    for a in range(rows.size):
        i = rows[a]
        for first in range(0, columns.size, SIDE_BY_SIDE):
            chosen = columns[first : first + SIDE_BY_SIDE]
            B = chosen.size
            for b in range(B):
                variance[b] = sigma[i, chosen[b]] ** 2
                correlation[b] = math.exp(-step / length[i, chosen[b]])
                left[b] = variance[b]  # of the map error given the readings so far
            information[:] = 0.0
            forecast[:] = 0.0
            for p in range(m):
                information[p, p] = 1.0
            for t in range(T):
                row = i + offset[t, 0] / cell[i, 0]
                _interpolate(values, row, offset[t, 1] / cell[i, 1], chosen, at)
                _whiten(t, at, cell[i], reduction[t], position[t], forecast, h, correlation)
                _learn(t, noise, at, h, forecast, information, correlation, variance, left, B)
            _arrive(information, position[T - 1], rest, h, left, B)
            for b in range(B):
                if not math.isnan(values[i, chosen[b]]):
                    out[a, first + b] = left[b]
    return out


@kernel(error_model="numpy")
def _whiten(  # type: ignore[no-untyped-def]
    t, at, cell, reduction, position, forecast, h, correlation
):
    """Write the derivatives of a reading by the coefficients, less what the readings before let
    expect, in place."""
    for p in range(h.shape[0]):
        constant = reduction[p]
        by_row, by_column = position[0, p] / cell[0], position[1, p] / cell[1]
        for b in range(h.shape[1]):
            expected = forecast[p, b] * (correlation[b] if t > 0 else 0.0)
            forecast[p, b] = expected
            h[p, b] = constant - at[1, b] * by_row - at[2, b] * by_column - expected


@kernel(error_model="numpy")
def _learn(  # type: ignore[no-untyped-def]
    t, noise, at, h, forecast, information, correlation, variance, left, count
):
    """Add the information of a reading, in place; one that is missing has none."""
    for b in range(count):
        if t > 0:
            square = correlation[b] ** 2
            left[b] = square * left[b] + (1.0 - square) * variance[b]
        known = 0.0 if math.isnan(at[0, b]) else 1.0
        total = left[b] + noise
        at[1, b], at[2, b] = known * left[b] / total, math.sqrt(known / total)
        left[b] *= 1.0 - at[1, b]
    for p in range(h.shape[0]):
        for b in range(count):
            value = h[p, b] if at[2, b] > 0.0 else 0.0
            forecast[p, b] += at[1, b] * value
            h[p, b] = at[2, b] * value
    for p in range(h.shape[0]):
        for q in range(p + 1):
            for b in range(count):
                information[p, q, b] += h[p, b] * h[q, b]


@kernel(error_model="numpy")
def _arrive(A, position, rest, solved, out, count):  # type: ignore[no-untyped-def]
    """Write the root of rest + trace(E A^-1 E'), with A given by its lower triangle, which its
    Cholesky factor L replaces: the sum of squares of L^-1 E'."""
    m = A.shape[0]
    for b in range(count):
        out[b] = rest
    for p in range(m):
        for q in range(p + 1):
            for r in range(q):
                for b in range(count):
                    A[p, q, b] -= A[p, r, b] * A[q, r, b]
            for b in range(count):
                A[p, q, b] = math.sqrt(A[p, p, b]) if p == q else A[p, q, b] / A[q, q, b]
    for axis in range(2):
        for p in range(m):
            for b in range(count):
                solved[p, b] = position[axis, p]
            for r in range(p):
                for b in range(count):
                    solved[p, b] -= A[p, r, b] * solved[r, b]
            for b in range(count):
                solved[p, b] /= A[p, p, b]
                out[b] += solved[p, b] ** 2
    for b in range(count):
        out[b] = math.sqrt(out[b])


@kernel(error_model="numpy")
def shifted(values, i, columns, offset, cell, north, east, out):  # type: ignore[no-untyped-def]
    """Write the map's values (T, B) at the readings of legs that end some way (m) off nodes of a
    row, linear between nodes."""
    n, m = values.shape
    for t in range(offset.shape[0]):
        row, column = i + (offset[t, 0] + north) / cell[0], (offset[t, 1] + east) / cell[1]
        k, shift = math.floor(row), math.floor(column)
        v, u = row - k, column - shift
        for b in range(columns.shape[0]):
            j = columns[b] + shift
            if k < 0 or k + 1 > n - 1 or j < 0 or j + 1 > m - 1:
                out[t, b] = math.nan
                continue
            out[t, b] = (1.0 - v) * ((1.0 - u) * values[k, j] + u * values[k, j + 1]) + v * (
                (1.0 - u) * values[k + 1, j] + u * values[k + 1, j + 1]
            )
