"""Compiled loops over the hypotheses of a Gaussian sum: where the map bends too much for one of
them, and which are one place (docs/mathematics.md, section 6.4)."""

import math

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.compiled import kernel
from isogal.maps.error_model import markov_step
from isogal.maps.interpolation import Grid
from isogal.matching.pmht.kernels import predicted
from isogal.matching.pmht.models import Models
from isogal.matching.pmht.rows import Rows

MOST_LOOKED_AT = 10
"""Rows of which it is asked how far they depart from linear."""


@kernel(error_model="numpy")
def curvature(
    grid: Grid,
    rows: Rows,
    models: Models,
    which: Integers,
    asked: Booleans,
    mean: Array,
    axes: Array,
    worst: Array,
) -> None:
    """Write (K, 2) how far readings depart from linear between the ends of two axes about the
    place they were taken at by a hypothesis: in 1-sigma of the noise and, where that is more, in
    units of their change; 0 of those that are not `asked` for.

    Parameters
    ----------
    asked : (K,) array of bool
    axes : (K, 2, 2) array
        m, north and east of each.
    """
    stride = 1 + rows.level.shape[0] // MOST_LOOKED_AT
    departure, change = np.empty(2), np.empty(2)
    for k in range(which.shape[0]):
        worst[k] = 0.0
        if not asked[k]:
            continue
        m = which[k]
        lag = models.lag[m]
        for axis in range(2):
            departure[axis] = change[axis] = 0.0
        for t in range(0, rows.level.shape[0], stride):
            north = east = 0.0
            for i in range(models.sizes[m]):
                state = models.used[m, i]
                north += rows.place[t, 0, state] * mean[k, state]
                east += rows.place[t, 1, state] * mean[k, state]
            _, joins = markov_step(rows.travelled[t], models.length[m])
            R = rows.noise[t] * models.noise[m]
            load = rows.load[models.shape[m]]
            for j in range(load.shape[1]):
                R += (models.sigma[m] * load[t, j]) ** 2 * joins
            g0, _, _ = predicted(grid, rows, t, north, east, lag)
            for axis in range(2):
                u, v = axes[k, axis, 0], axes[k, axis, 1]
                g1, _, _ = predicted(grid, rows, t, north - u, east - v, lag)
                g2, _, _ = predicted(grid, rows, t, north + u, east + v, lag)
                departure[axis] += (0.5 * (g1 + g2) - g0) ** 2 / R
                change[axis] += (0.5 * (g1 - g2)) ** 2 / R
        for axis in range(2):
            of_change = max(math.sqrt(stride * change[axis]), 1.0)
            worst[k, axis] = math.sqrt(stride * departure[axis]) / of_change


@kernel(error_model="numpy")
def merged(
    which: Integers,
    log_weight: Array,
    mean: Array,
    covariance: Array,
    place: Array,
    spreads: Array,
) -> Integers:
    """Merge hypotheses of one model whose places are within one 1-sigma of each other by their
    moments, in place, and return the indices of those that stay.

    Parameters
    ----------
    which : (K,) array
        Sorted; within a model by falling weight.
    place, spreads : (K, 2) and (K, 2, 2) arrays
        See `Hypotheses.places`, m.
    """
    count, size = mean.shape
    kept = np.ones(count, np.bool_)
    for a in range(count):
        if not kept[a]:
            continue
        p, q, r = spreads[a, 0, 0], spreads[a, 0, 1], spreads[a, 1, 1]
        det = p * r - q * q
        n0, e0 = place[a, 0], place[a, 1]
        b = a + 1
        while b < count and which[b] == which[a]:
            n, e = place[b, 0] - n0, place[b, 1] - e0
            if kept[b] and r * n * n - 2.0 * q * n * e + p * e * e < det:
                kept[b] = False
                total = np.logaddexp(log_weight[a], log_weight[b])
                w = math.exp(log_weight[b] - total)
                for i in range(size):
                    apart = w * (1.0 - w) * (mean[b, i] - mean[a, i])
                    for j in range(size):
                        P, Q = covariance[a, i, j], covariance[b, i, j]
                        covariance[a, i, j] = P + w * (Q - P) + apart * (mean[b, j] - mean[a, j])
                for i in range(size):
                    mean[a, i] += w * (mean[b, i] - mean[a, i])
                log_weight[a] = total
            b += 1
    return np.flatnonzero(kept)
