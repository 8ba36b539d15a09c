"""The compiled loops of the batch likelihood (`likelihood`)."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Booleans, Integers
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature
from isogal.maps.interpolation import look_up, value_and_gradient
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.filtered import path_nodes
from isogal.matrices import lower


class Readings(NamedTuple):
    """The T readings of a batch, as kernels take them."""

    channel: Integers
    """(T,) index of each reading's map."""
    latitude: Array
    """(T,) rad, where the navigator believes it was taken."""
    longitude: Array
    """(T,) rad."""
    radian: Array
    """(T, 2) radians of latitude and longitude per metre north and east."""
    level: Array
    """(T,) reading less its known offset."""
    transition: Array
    """(T, 2, 4) position error per unit of xi."""
    jacobian: Array
    """(T, 4) d(reading)/d(xi) by the reduction."""
    nodes: Array
    """(T, K, 3) what the reading is a mean over (`filtered.path_nodes`)."""

    @classmethod
    def of(cls, batch: Batch, rows: Integers, channel: Integers) -> "Readings":
        """Return those of some rows (T,) of a batch."""
        latitude = batch.latitude[rows]
        return cls(
            channel,
            latitude,
            batch.longitude[rows],
            radians_per_metre(latitude),
            batch.reading[rows] - batch.offset[rows],
            rows_of(batch.transition, rows),
            rows_of(batch.reading_jacobian, rows),
            path_nodes(batch, rows),
        )

    def part(self, rows: Integers | Booleans) -> "Readings":
        """Return some of them."""
        return Readings._make(rows_of(array, rows) for array in self)


def rows_of(array: NDArray[Any], rows: Integers | Booleans) -> NDArray[Any]:
    """Return some rows of an array in the one memory layout that kernels are compiled for."""
    return np.ascontiguousarray(array[rows])


@kernel
def radians_per_metre(latitude):  # type: ignore[no-untyped-def]
    """Return (T, 2) radians of latitude and longitude per metre north and east at latitudes (T,)
    in rad."""
    out = np.empty((latitude.shape[0], 2))
    for t in range(latitude.shape[0]):
        north, east = curvature(math.sin(latitude[t]))
        out[t, 0], out[t, 1] = 1.0 / north, 1.0 / (east * math.cos(latitude[t]))
    return out


@kernel
def sensed(grid, lat, lon, nodes, channel):  # type: ignore[no-untyped-def]
    """Return the mean of the map's value over the nodes (K, 3) of a place, and its derivatives by
    latitude and longitude."""
    value, by_lat, by_lon = 0.0, 0.0, 0.0
    for k in range(nodes.shape[0]):
        v, a, b = value_and_gradient(grid, lat + nodes[k, 0], lon + nodes[k, 1], channel)
        value += nodes[k, 2] * v
        by_lat += nodes[k, 2] * a
        by_lon += nodes[k, 2] * b
    return value, by_lat, by_lon


@kernel
def nuisance(grid, readings, position, reading, xi):  # type: ignore[no-untyped-def]
    """Return (T, M) what each nuisance parameter takes off the residuals at an error xi (4,), if
    it moves positions by (T, 2, M) and readings by (T, M); by the latter alone where the map has
    no gradient."""
    channel, latitude, longitude, radian, _, transition, _, nodes = readings
    rows, count = reading.shape
    out = np.empty((rows, count))
    for t in range(rows):
        north = 0.0
        east = 0.0
        for i in range(4):
            north += transition[t, 0, i] * xi[i]
            east += transition[t, 1, i] * xi[i]
        lat, lon = latitude[t] - north * radian[t, 0], longitude[t] - east * radian[t, 1]
        _, by_lat, by_lon = sensed(grid, lat, lon, nodes[t], channel[t])
        by_north, by_east = by_lat * radian[t, 0], by_lon * radian[t, 1]
        if not (math.isfinite(by_north) and math.isfinite(by_east)):
            by_north, by_east = 0.0, 0.0
        for m in range(count):
            out[t, m] = by_north * position[t, 0, m] + by_east * position[t, 1, m] - reading[t, m]
    return out


@kernel(error_model="numpy")
def last_rows(factor, first):  # type: ignore[no-untyped-def]
    """Return (T, n) the transpose of the rows from `first` on of a Cholesky factor's inverse."""
    rows = factor.shape[0]
    out = np.zeros((rows, rows - first))
    for s in range(rows - 1, -1, -1):
        here = out[s]
        if s >= first:
            here[s - first] = 1.0
        scale = 1.0 / factor[s, s]
        for k in range(here.shape[0]):
            here[k] *= scale
        for t in range(s):
            weight, there = factor[s, t], out[t]
            for k in range(here.shape[0]):
                there[k] -= weight * here[k]
    return out


@kernel
def reducing(whitening, effect):  # type: ignore[no-untyped-def]
    """Return (T, n) W C'⁻¹, C C' = 1 + D D', of a whitening W (T, n) of the n new readings and
    nuisance parameters with effects (T, M), whitened D = W' effect."""
    rows, new = whitening.shape
    count = effect.shape[1]
    white = np.zeros((new, count))
    for t in range(rows):
        for k in range(max(t - rows + new, 0), new):
            for m in range(count):
                white[k, m] += whitening[t, k] * effect[t, m]
    inner = np.eye(new)
    for a in range(new):
        for b in range(a + 1):
            for m in range(count):
                inner[a, b] += white[a, m] * white[b, m]
    root = lower(inner)
    out = np.zeros((rows, new))
    for t in range(rows):
        first = max(t - rows + new, 0)  # W is zero before it, as the inverse of a triangle
        for k in range(first, new):
            value = whitening[t, k]
            for b in range(first, k):
                value -= root[k, b] * out[t, b]
            out[t, k] = value / root[k, k]
    return out


@kernel(error_model="numpy")
def whitened(grid, readings, whitening, xi):  # type: ignore[no-untyped-def]
    """Return (n, S) the whitened residuals of the n new readings at errors xi (S, 4); `whitening`
    is that of `likelihood.BatchLikelihood` or its `reduction`."""
    channel, latitude, longitude, radian, level, transition, jacobian, nodes = readings
    samples, rows, new = xi.shape[0], level.shape[0], whitening.shape[1]
    first_new = rows - new
    x = np.empty((4, samples))
    for s in range(samples):
        for i in range(4):
            x[i, s] = xi[s, i]
    a, b, c, d = x[0], x[1], x[2], x[3]
    out = np.zeros((new, samples))
    lat, lon, value = np.empty(samples), np.empty(samples), np.empty(samples)
    row, column = np.empty(samples, np.int64), np.empty(samples, np.int64)
    residual = np.empty(samples)
    for t in range(rows):
        counts = t >= first_new
        for k in range(new):
            counts = counts or whitening[t, k] != 0.0
        if not counts:  # without correlation the older rows say nothing about the new
            continue
        f, j = transition[t], jacobian[t]
        for s in range(samples):
            residual[s] = level[t]
        for k in range(nodes.shape[1]):
            for s in range(samples):
                north = f[0, 0] * a[s] + f[0, 1] * b[s] + f[0, 2] * c[s] + f[0, 3] * d[s]
                east = f[1, 0] * a[s] + f[1, 1] * b[s] + f[1, 2] * c[s] + f[1, 3] * d[s]
                lat[s] = latitude[t] - north * radian[t, 0] + nodes[t, k, 0]
                lon[s] = longitude[t] - east * radian[t, 1] + nodes[t, k, 1]
            look_up(grid, lat, lon, channel[t], row, column, value)
            for s in range(samples):
                residual[s] -= nodes[t, k, 2] * value[s]
        for s in range(samples):
            residual[s] -= j[0] * a[s] + j[1] * b[s] + j[2] * c[s] + j[3] * d[s]
        for k in range(max(t - first_new, 0), new):
            weight, total = whitening[t, k], out[k]
            for s in range(samples):
                total[s] += weight * residual[s]
    return out


@kernel(error_model="numpy")
def log_likelihood(grid, readings, reduction, xi):  # type: ignore[no-untyped-def]
    """Return (S,) log-likelihood, without its constant, of the new readings at errors xi (S, 4);
    -inf off the map. `reduction` as in `likelihood.BatchLikelihood`.
    """
    out = np.zeros(xi.shape[0])
    # so many at once that what is computed of them stays in the processor's cache
    for first in range(0, out.shape[0], 512):
        part = out[first : first + 512]
        white = whitened(grid, readings, reduction, xi[first : first + 512])
        for k in range(white.shape[0]):
            row = white[k]
            for s in range(part.shape[0]):
                part[s] += row[s] * row[s]
        for s in range(part.shape[0]):
            part[s] = -0.5 * part[s] if math.isfinite(part[s]) else -np.inf
    return out


@kernel
def linearise(grid, readings, xi):  # type: ignore[no-untyped-def]
    """Return residuals (T,) and their derivative by xi (T, 4) at one error xi (4,)."""
    channel, latitude, longitude, radian, level, transition, jacobian, nodes = readings
    rows = latitude.shape[0]
    residual = np.empty(rows)
    slope = np.empty((rows, 4))
    for t in range(rows):
        north = 0.0
        east = 0.0
        known = level[t]
        for i in range(4):
            north += transition[t, 0, i] * xi[i]
            east += transition[t, 1, i] * xi[i]
            known -= jacobian[t, i] * xi[i]
        lat, lon = latitude[t] - north * radian[t, 0], longitude[t] - east * radian[t, 1]
        value, by_lat, by_lon = sensed(grid, lat, lon, nodes[t], channel[t])
        residual[t] = known - value
        for i in range(4):
            slope[t, i] = (
                by_lat * radian[t, 0] * transition[t, 0, i]
                + by_lon * radian[t, 1] * transition[t, 1, i]
                - jacobian[t, i]
            )
    return residual, slope


@kernel
def mode(  # type: ignore[no-untyped-def]
    grid, readings, position, reading, whitening, mean, root, steps, tolerance
):
    """Return the mode of a posterior by Gauss-Newton steps.

    Parameters
    ----------
    position, reading, whitening : (T, 2, M), (T, M), (T, n) arrays
        As in `nuisance` and `reducing`.
    mean, root : (4,), (4, 4) arrays
        Of the prior, and a square root of its covariance.
    steps : int
        At most.
    tolerance : float
        Length of the last step in 1-sigmas of the posterior.

    Returns
    -------
    found : bool
        False off the map, and where the steps do not come to an end.
    z : (4,) array
        Mode, in units of the prior.
    slope : (n, 4) array
        Derivative of the reduced residuals by z, one step before it.
    precision : (4, 4) array
        Of z, there.
    reduction : (T, n) array
        There.
    """
    new = whitening.shape[1]
    z, step, x = np.zeros(4), np.empty(4), np.empty(4)
    slope, precision = np.empty((new, 4)), np.empty((4, 4))
    reduction = whitening
    for _ in range(steps):
        for i in range(4):
            x[i] = mean[i]
            for j in range(4):
                x[i] += root[i, j] * z[j]
        reduction = reducing(whitening, nuisance(grid, readings, position, reading, x))
        residual, by_xi = linearise(grid, readings, x)
        right = np.zeros(4)
        for i in range(4):
            for j in range(4):
                precision[i, j] = 1.0 if i == j else 0.0
        for k in range(new):
            off = 0.0
            of_xi = np.zeros(4)
            for t in range(residual.shape[0]):
                off -= reduction[t, k] * residual[t]
                for i in range(4):
                    of_xi[i] += reduction[t, k] * by_xi[t, i]
            for j in range(4):
                slope[k, j] = 0.0
                for i in range(4):
                    slope[k, j] += of_xi[i] * root[i, j]
                off += slope[k, j] * z[j]
            for i in range(4):
                right[i] += slope[k, i] * off
                for j in range(4):
                    precision[i, j] += slope[k, i] * slope[k, j]
        if not math.isfinite(right.sum()):
            return False, z, slope, precision, reduction
        length = _solve(precision, right, z, step)
        for i in range(4):
            z[i] += step[i]
        if length < tolerance * tolerance:
            return True, z, slope, precision, reduction
    return False, z, slope, precision, reduction


@kernel
def _solve(matrix, right, start, step):  # type: ignore[no-untyped-def]
    """Write what leads from `start` to the solution of matrix x = right, the matrix positive
    definite; return step' matrix step."""
    n = right.shape[0]
    factor = lower(matrix)
    for a in range(n):
        value = right[a]
        for b in range(a):
            value -= factor[a, b] * step[b]
        step[a] = value / factor[a, a]
    for a in range(n - 1, -1, -1):
        value = step[a]
        for b in range(a + 1, n):
            value -= factor[b, a] * step[b]
        step[a] = value / factor[a, a]
    length = 0.0
    for a in range(n):
        step[a] -= start[a]
    for a in range(n):
        for b in range(n):
            length += step[a] * matrix[a, b] * step[b]
    return length
