"""How probable a second place is, at many nodes: compiled functions.

A leg of readings fits the map at a place d m off the true one, for a navigator that knows its
place to a 1-sigma s, by the chi-square f(d) = |w(d) - w(0)|² + |d|² / s², w the whitened readings
to be expected there. With the noise of readings and prior, log p(d) / p(0) is N(-f / 2, f), and
that of the whole posterior about two places, Gaussians whose widths are by the Hessians H of
f / 2, has the mean -f / 2 + log(|H(0)| / |H(d)|) / 2. A second place is a minimum of f that is a
place of its own: as far from the true one as two places are that are told apart, and between
them the density goes down as between two Gaussians so far apart. Of several second places odds add
up (Luce 1959, Individual Choice Behavior): exact for places that are all as likely."""

import math

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.evaluation.navigability.kernels import SIDE_BY_SIDE, shifted

_PROMISING = 60.0
"""Chi-square that a minimum between points of the grid may have by a parabola through them."""
_NEGLIGIBLE = 36.0
"""Chi-square from which a second place is the likelier one in less than 0.15 % of all cases."""
_STEPS = 3
"""Of Gauss and Newton to a minimum."""
_REACH = 1.0
"""Cells of the grid that these may lead away from its point."""
_BETWEEN = (0.22, 0.5, 0.81)
"""Shares of the way between two places where it is asked whether readings fit worse; not evenly,
for a field that repeats itself."""
_MOST = 16
"""Second places of a node at most."""


@kernel(error_model="numpy")
def second_places(  # type: ignore[no-untyped-def]
    rows: Integers,
    columns: Integers,
    values: Array,
    cell: Array,
    offset: Array,
    constants: Array,
    by_place: Array,
    grid: Array,
    sigma: Array,
    length: Array,
):
    """Return (N, M) the probability that a second place is likelier than the true one, by a leg.

    Parameters
    ----------
    constants : (5,) noise and step of the readings that are given, 1-sigma of the prior and step
        of derivatives, m, and how far apart two places are, in 1-sigmas
    by_place : (2,) what the reading gets from a place north and east beside the map, per m
    grid : (K,) m, places tried to the north and, likewise, to the east; evenly spaced
    others
        See `kernels.errors_on_arrival`.
    """
    T, K = offset.shape[0], grid.shape[0]
    noise, step, prior = constants[0], constants[1], constants[2]
    out = np.full((rows.size, columns.size), math.nan)
    here, there = np.empty((T, SIDE_BY_SIDE)), np.empty((T, SIDE_BY_SIDE))
    gain, weight = np.empty((T, SIDE_BY_SIDE)), np.empty((T, SIDE_BY_SIDE))
    correlation = np.empty(SIDE_BY_SIDE)
    fit = np.empty((K, K, SIDE_BY_SIDE))
    for a in range(rows.size):
        i = rows[a]
        for first in range(0, columns.size, SIDE_BY_SIDE):
            chosen = columns[first : first + SIDE_BY_SIDE]
            B = chosen.size
            for b in range(B):
                variance = sigma[i, chosen[b]] ** 2
                correlation[b] = math.exp(-step / length[i, chosen[b]])
                left = variance
                for t in range(T):
                    gain[t, b], weight[t, b] = left / (left + noise), 1.0 / (left + noise)
                    square = correlation[b] ** 2
                    left = square * left * (1.0 - gain[t, b]) + (1.0 - square) * variance
            shifted(values, i, chosen, offset, cell[i], 0.0, 0.0, here)
            for p in range(K):
                for q in range(K):
                    distance = (grid[p] ** 2 + grid[q] ** 2) / prior**2
                    if distance > _NEGLIGIBLE:
                        fit[p, q] = math.inf
                        continue
                    shifted(values, i, chosen, offset, cell[i], grid[p], grid[q], there)
                    more = by_place[0] * grid[p] + by_place[1] * grid[q]
                    _misfits(here, there, more, correlation, gain, weight, fit[p, q], B)
                    for b in range(B):
                        fit[p, q, b] += distance
            for b in range(B):
                if not math.isnan(values[i, chosen[b]]):
                    out[a, first + b] = _of_node(
                        values,
                        i,
                        chosen[b],
                        offset,
                        cell[i],
                        constants,
                        by_place,
                        grid,
                        fit[:, :, b],
                        correlation[b],
                        gain[:, b],
                        weight[:, b],
                    )
    return out


@kernel(error_model="numpy")
def _of_node(  # type: ignore[no-untyped-def]
    values, i, j, offset, cell, constants, by_place, grid, fit, correlation, gain, weight
):
    """Return the probability at one node, from the chi-square (K, K) on the grid."""
    K = grid.shape[0]
    size = grid[1] - grid[0]
    apart = constants[4] ** 2
    found = np.empty((_MOST + 1, 6))  # north, east, chi-square, Hessian
    w, j_n, j_e = np.empty((3, offset.shape[0]))
    hessian = np.empty(3)
    own = np.empty(offset.shape[0])
    _white(values, i, j, offset, cell, by_place, 0.0, 0.0, correlation, gain, weight, own)
    found[0, :3] = 0.0
    _slopes(
        values, i, j, offset, cell, constants, by_place, 0.0, 0.0, correlation, gain, weight,
        w, j_n, j_e, hessian,
    )  # fmt: skip
    found[0, 3:] = hessian
    count = 1
    for p in range(1, K - 1):
        for q in range(1, K - 1):
            middle = fit[p, q]
            if not _least(fit, p, q) or middle - _below(fit, p, q) > _PROMISING:
                continue
            north, east = grid[p], grid[q]
            for _ in range(_STEPS):
                _slopes(
                    values, i, j, offset, cell, constants, by_place, north, east, correlation,
                    gain, weight, w, j_n, j_e, hessian,
                )  # fmt: skip
                g_n, g_e = north / constants[2] ** 2, east / constants[2] ** 2
                for t in range(w.shape[0]):
                    g_n += j_n[t] * (w[t] - own[t])
                    g_e += j_e[t] * (w[t] - own[t])
                determinant = hessian[0] * hessian[2] - hessian[1] ** 2
                north -= (hessian[2] * g_n - hessian[1] * g_e) / determinant
                east -= (hessian[0] * g_e - hessian[1] * g_n) / determinant
                north = min(max(north, grid[p] - _REACH * size), grid[p] + _REACH * size)
                east = min(max(east, grid[q] - _REACH * size), grid[q] + _REACH * size)
            _white(values, i, j, offset, cell, by_place, north, east, correlation, gain, weight, w)
            value = min(_misfit(w, own, north, east, constants[2]), middle)
            if not value < _NEGLIGIBLE:
                continue
            place = count
            for k in range(count):
                d_n, d_e = north - found[k, 0], east - found[k, 1]
                spread = _spread(found[k, 3:], d_n, d_e) + _spread(hessian, d_n, d_e)
                least = 0.5 * (value + found[k, 2]) + 0.25 * apart
                if not (2.0 * (d_n**2 + d_e**2) > apart * spread and _worse_between(
                    values, i, j, offset, cell, by_place, correlation, gain, weight, w, own,
                    north, east, d_n, d_e, constants[2], least,
                )):  # fmt: skip
                    place = k
                    break
            if place < count and (place == 0 or value >= found[place, 2]):
                continue
            if place == count:
                if count > _MOST:
                    continue
                count += 1
            found[place, 0], found[place, 1], found[place, 2] = north, east, value
            found[place, 3:] = hessian
    return _probability(found[:count])


@kernel(error_model="numpy")
def _worse_between(  # type: ignore[no-untyped-def]
    values, i, j, offset, cell, by_place, correlation, gain, weight, w, own,
    north, east, d_n, d_e, prior, least,
):  # fmt: skip
    """Whether the chi-square is above `least` somewhere between a place and that (d_n, d_e) before
    it; `w` is work space."""
    for part in _BETWEEN:
        n, e = north - part * d_n, east - part * d_e
        _white(values, i, j, offset, cell, by_place, n, e, correlation, gain, weight, w)
        if _misfit(w, own, n, e, prior) > least:
            return True
    return False


@kernel(error_model="numpy")
def _misfit(w, own, north, east, prior):  # type: ignore[no-untyped-def]
    """Return the chi-square of a place, by whitened readings (T,) there and at the true one."""
    out = (north**2 + east**2) / prior**2
    for t in range(w.shape[0]):
        out += (w[t] - own[t]) ** 2
    return out


@kernel(error_model="numpy")
def _probability(found):  # type: ignore[no-untyped-def]
    """Return the probability that any but the first of places (K, 6) is the likeliest."""
    odds = 0.0
    size_0 = math.log(found[0, 3] * found[0, 5] - found[0, 4] ** 2)
    for k in range(1, found.shape[0]):
        size_k = math.log(found[k, 3] * found[k, 5] - found[k, 4] ** 2)
        mean = 0.5 * (found[k, 2] - size_0 + size_k)
        wrong = 0.5 * math.erfc(mean / math.sqrt(2.0 * max(found[k, 2], 1e-12)))
        odds += wrong / max(1.0 - wrong, 1e-12)
    return odds / (1.0 + odds)


@kernel(error_model="numpy")
def _least(fit, p, q):  # type: ignore[no-untyped-def]
    """Whether a point of a grid is not above its neighbours."""
    for d in range(-1, 2):
        for e in range(-1, 2):
            if not fit[p + d, q + e] >= fit[p, q]:
                return False
    return True


@kernel(error_model="numpy")
def _below(fit, p, q):  # type: ignore[no-untyped-def]
    """Return by how much parabolas through a point's neighbours go below it."""
    out = 0.0
    for d, e in ((1, 0), (0, 1)):
        low, high = fit[p - d, q - e], fit[p + d, q + e]
        bend = low + high - 2.0 * fit[p, q]
        if bend > 0.0 and bend < math.inf:
            out += (high - low) ** 2 / (8.0 * bend)
    return out


@kernel(error_model="numpy")
def _spread(hessian, north, east):  # type: ignore[no-untyped-def]
    """Return the variance of a place along a direction, which need not be of length one."""
    determinant = hessian[0] * hessian[2] - hessian[1] ** 2
    square = hessian[2] * north**2 - 2.0 * hessian[1] * north * east + hessian[0] * east**2
    return square / (determinant * max(north**2 + east**2, 1e-12))


@kernel(error_model="numpy")
def _slopes(  # type: ignore[no-untyped-def]
    values, i, j, offset, cell, constants, by_place, north, east, correlation, gain, weight,
    w, j_n, j_e, hessian,
):  # fmt: skip
    """Write the whitened readings (T,) at a place, their slopes, and half the Hessian of the
    chi-square (north north, north east, east east)."""
    h = constants[3]
    _white(values, i, j, offset, cell, by_place, north - h, east, correlation, gain, weight, w)
    _white(values, i, j, offset, cell, by_place, north + h, east, correlation, gain, weight, j_n)
    for t in range(w.shape[0]):
        j_n[t] = (j_n[t] - w[t]) / (2.0 * h)
    _white(values, i, j, offset, cell, by_place, north, east - h, correlation, gain, weight, w)
    _white(values, i, j, offset, cell, by_place, north, east + h, correlation, gain, weight, j_e)
    for t in range(w.shape[0]):
        j_e[t] = (j_e[t] - w[t]) / (2.0 * h)
    _white(values, i, j, offset, cell, by_place, north, east, correlation, gain, weight, w)
    hessian[0] = hessian[2] = 1.0 / constants[2] ** 2
    hessian[1] = 0.0
    for t in range(w.shape[0]):
        hessian[0] += j_n[t] ** 2
        hessian[1] += j_n[t] * j_e[t]
        hessian[2] += j_e[t] ** 2


@kernel(error_model="numpy")
def _white(  # type: ignore[no-untyped-def]
    values, i, j, offset, cell, by_place, north, east, correlation, gain, weight, out
):
    """Write the readings (T,) of a leg that ends some way (m) off a node, in units of the noise
    and without what the ones before say of it; NaN off the map."""
    n, m = values.shape
    before, more = 0.0, by_place[0] * north + by_place[1] * east
    for t in range(offset.shape[0]):
        row, column = i + (offset[t, 0] + north) / cell[0], j + (offset[t, 1] + east) / cell[1]
        k, c = math.floor(row), math.floor(column)
        if k < 0 or k + 1 > n - 1 or c < 0 or c + 1 > m - 1:
            out[:] = math.nan
            return
        v, u = row - k, column - c
        value = (1.0 - v) * ((1.0 - u) * values[k, c] + u * values[k, c + 1]) + v * (
            (1.0 - u) * values[k + 1, c] + u * values[k + 1, c + 1]
        )
        expected = correlation * before
        difference = value - more - expected
        before = expected + gain[t] * difference
        out[t] = math.sqrt(weight[t]) * difference


@kernel(error_model="numpy")
def _misfits(  # type: ignore[no-untyped-def]
    here, there, more, correlation, gain, weight, out, count
):
    """Write (B,) the squared difference between values (T, B) in units of the noise, `more` taken
    off the second ones; NaN, which is not less than anything, where one is missing."""
    before = np.zeros(count)
    for b in range(count):
        out[b] = 0.0
    for t in range(here.shape[0]):
        for b in range(count):
            expected = correlation[b] * before[b]
            difference = there[t, b] - more - here[t, b] - expected
            before[b] = expected + gain[t, b] * difference
            out[b] += weight[t, b] * difference * difference
