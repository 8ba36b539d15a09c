"""The compiled loops of the batch likelihood (`likelihood`)."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.maps.interpolation import value_and_gradient


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
def slopes(grid, channel, latitude, longitude, nodes):  # type: ignore[no-untyped-def]
    """Return (T,) the map's derivatives by latitude and longitude, each row in its channel."""
    by_lat, by_lon = np.empty(latitude.shape[0]), np.empty(latitude.shape[0])
    for t in range(latitude.shape[0]):
        _, by_lat[t], by_lon[t] = sensed(grid, latitude[t], longitude[t], nodes[t], channel[t])
    return by_lat, by_lon


@kernel(forceinline=True)
def _moved(readings, t, a, b, c, d):  # type: ignore[no-untyped-def]
    """Return where reading t was taken (rad) if the error is xi = (a, b, c, d), and what the
    reduction then adds to it. The map is looked up by the caller: only there does the compiler see
    that its derivatives are not needed, which is two thirds of the time."""
    f, j, radian = readings.transition[t], readings.jacobian[t], readings.radian
    north = f[0, 0] * a + f[0, 1] * b + f[0, 2] * c + f[0, 3] * d
    east = f[1, 0] * a + f[1, 1] * b + f[1, 2] * c + f[1, 3] * d
    return (
        readings.latitude[t] - north * radian[t, 0],
        readings.longitude[t] - east * radian[t, 1],
        j[0] * a + j[1] * b + j[2] * c + j[3] * d,
    )


@kernel
def log_likelihood(  # type: ignore[no-untyped-def]
    grid, readings, factor, projection, first_new, xi
):
    """Return (S,) log-likelihood, without its constant, of the new readings at errors xi (S, 4);
    -inf off the map. `factor`, `projection` and `first_new` as in `likelihood.BatchLikelihood`.
    """
    channel, level, nodes = readings.channel, readings.level, readings.nodes
    samples, rows, points = xi.shape[0], level.shape[0], nodes.shape[1] == 1
    out = np.empty(samples)
    whitened = np.empty(rows)
    inverse = np.empty(rows)
    diagonal = True
    for t in range(rows):
        inverse[t] = 1.0 / factor[t, t]
        for u in range(t):
            if factor[t, u] != 0.0:
                diagonal = False
    # without correlation the older rows say nothing about the new
    start = first_new if diagonal else 0
    for s in range(samples):
        a, b, c, d = xi[s, 0], xi[s, 1], xi[s, 2], xi[s, 3]
        total = 0.0
        for t in range(start, rows):
            lat, lon, reduced = _moved(readings, t, a, b, c, d)
            if points:
                value, _, _ = value_and_gradient(grid, lat, lon, channel[t])
            else:
                value, _, _ = sensed(grid, lat, lon, nodes[t], channel[t])
            r = level[t] - value - reduced
            if not diagonal:
                for u in range(t):
                    r -= factor[t, u] * whitened[u]
            r *= inverse[t]
            whitened[t] = r
            if t >= first_new:
                total += r * r
        for m in range(projection.shape[1]):
            explained = 0.0
            for t in range(first_new, rows):
                explained += projection[t - first_new, m] * whitened[t]
            total -= explained * explained
        out[s] = -0.5 * total if math.isfinite(total) else -np.inf
    return out


@kernel
def whitened(grid, readings, factor, first_new, xi):  # type: ignore[no-untyped-def]
    """Return (S, n) the whitened residuals of the n new readings at errors xi (S, 4)."""
    channel, level, nodes = readings.channel, readings.level, readings.nodes
    samples, rows, points = xi.shape[0], level.shape[0], nodes.shape[1] == 1
    out = np.empty((samples, rows - first_new))
    white = np.empty(rows)
    for s in range(samples):
        a, b, c, d = xi[s, 0], xi[s, 1], xi[s, 2], xi[s, 3]
        for t in range(rows):
            lat, lon, reduced = _moved(readings, t, a, b, c, d)
            if points:
                value, _, _ = value_and_gradient(grid, lat, lon, channel[t])
            else:
                value, _, _ = sensed(grid, lat, lon, nodes[t], channel[t])
            r = level[t] - value - reduced
            for u in range(t):
                r -= factor[t, u] * white[u]
            white[t] = r / factor[t, t]
            if t >= first_new:
                out[s, t - first_new] = white[t]
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
