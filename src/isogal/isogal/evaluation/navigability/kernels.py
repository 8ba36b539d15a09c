"""The bound, and how probable a second place is, at many nodes: compiled functions.

Along a leg the noise of readings is white noise and a map error that is a first-order Gauss-Markov
process. A scalar Kalman filter of the map error turns readings into independent ones (innovations;
Kailath 1968, IEEE Trans. Automatic Control 13(6)). The squares of their derivatives by the
coefficients of `isogal.evaluation.navigability.leg` add up to the Fisher information.

A leg of readings fits the map at a place d m off the true one, for a navigator that knows its
place to a 1-sigma s, by the chi-square f(d) = |w(d) - w(0)|² + |d|² / s², w the whitened readings
to be expected there. With the noise of readings and prior, log p(d) / p(0) is N(-f / 2, f), and
that of the whole posterior about two places, Gaussians whose widths are by the Hessians H of
f / 2, has the mean -f / 2 + log(|H(0)| / |H(d)|) / 2. A second place is a minimum of f that is a
place of its own: as far from the true one as two places are that are told apart, and between
them the density goes down as between two Gaussians so far apart. Of several second places odds add
up (Luce 1959, Individual Choice Behavior): exact for places that are all as likely."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Booleans, Integers, Values
from isogal.compiled import kernel
from isogal.maps.error_model import markov_step
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matrices import inverse_of_lower, lower

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


class Ground(NamedTuple):
    """The map under legs."""

    grid: Grid
    """Of one map of n rows and m columns, whose axes count these."""
    cell: Array
    """(n, 2) m between nodes to the north and to the east, by row."""
    sigma: Array
    """(n, m) 1-sigma of the map's error."""
    length: Array
    """(n, m) m, its correlation length."""


class Approach(NamedTuple):
    """T readings of a leg on one heading, the last at its end, where a node is."""

    offset: Array
    """(T, 2) m north and east of each from the end."""
    step: float
    """m between readings."""
    noise: float
    """Variance of a reading's noise."""
    by_place: Array
    """(2,) reading by the place, per m north and east, without the part of the map's gradient."""


class Leg(NamedTuple):
    """A leg on one heading (`isogal.evaluation.navigability.leg`)."""

    approach: Approach
    position: Array
    """(T, 2, m) position error (m) by the coefficients."""
    reduction: Array
    """(T, m) reading by the coefficients, without the part of the map's gradient."""
    rest: float
    """m², variance of the position at the end that is left out."""


class _Node(NamedTuple):
    """A node at the end of a leg: what `_white` takes besides a place."""

    values: Values
    """(n, m) of the map."""
    row: int
    column: int
    cell: Array
    """(2,) m between nodes."""
    offset: Array
    """(T, 2) m, as of `Approach`."""
    by_place: Array
    """(2,) as of `Approach`."""
    prior: float
    """m, 1-sigma of the place."""
    step: float
    """m, of derivatives."""
    correlation: float
    """Of the map's error from reading to reading."""
    gain: Array
    """(T,) of a scalar filter of the map's error."""
    weight: Array
    """(T,) 1 / variance of what it does not foretell."""


@kernel(error_model="numpy")
def _filter(
    ground: Ground, approach: Approach, i: int, j: int, known: Booleans, gain: Array, weight: Array
) -> float:
    """Write gain (T,) and 1 / innovation variance (T,) of the scalar filter of the map's error at
    node (i, j), for readings of which some are known (T,); return that error's correlation from
    reading to reading."""
    correlation, joins = markov_step(approach.step, ground.length[i, j])
    variance = ground.sigma[i, j] ** 2
    left = variance
    for t in range(len(gain)):
        weight[t] = 1.0 / (left + approach.noise)
        gain[t] = left * weight[t] if known[t] else 0.0
        left = correlation**2 * left * (1.0 - gain[t]) + joins * variance
    return correlation


@kernel(error_model="numpy")
def _slope(ground: Ground, offset: Array, i: int, j: int, slope: Array) -> bool:
    """Write the map's slopes to the north and to the east (2,), per m, at an offset (2,) from a
    node, zero where it has none; return whether it has them."""
    n, m = ground.grid.values.shape
    north, east = ground.cell[i]
    row, column = i + offset[0] / north, j + offset[1] / east
    slope[0] = slope[1] = 0.0
    if not (1.0 <= row <= n - 2 and 1.0 <= column <= m - 2):
        return False
    _, by_row, by_column = value_and_gradient(ground.grid, row, column)
    if math.isnan(by_row):
        return False
    slope[0], slope[1] = by_row / north, by_column / east
    return True


@kernel(error_model="numpy")
def errors_on_arrival(rows: Integers, columns: Integers, ground: Ground, leg: Leg) -> Array:
    """Return (N, M) the RMS horizontal error (m) at nodes of the map, by rows (N,) and columns
    (M,); NaN where it has no value."""
    approach, position = leg.approach, leg.position
    T, m = leg.reduction.shape
    out = np.full((rows.size, columns.size), math.nan)
    slope, known = np.empty((T, 2)), np.empty(T, dtype=np.bool_)
    gain, weight, h, forecast = np.empty(T), np.empty(T), np.empty(m), np.empty(m)
    information = np.empty((m, m))
    for a in range(rows.size):
        for b in range(columns.size):
            i, j = rows[a], columns[b]
            if math.isnan(ground.grid.values[i, j]):
                continue
            for t in range(T):
                known[t] = _slope(ground, approach.offset[t], i, j, slope[t])
            correlation = _filter(ground, approach, i, j, known, gain, weight)
            for p in range(m):
                forecast[p] = 0.0
                for q in range(m):
                    information[p, q] = 1.0 if q == p else 0.0
            for t in range(T):
                root = math.sqrt(weight[t]) if known[t] else 0.0
                for p in range(m):
                    by_map = slope[t, 0] * position[t, 0, p] + slope[t, 1] * position[t, 1, p]
                    new = leg.reduction[t, p] - by_map - forecast[p]
                    forecast[p] = correlation * (forecast[p] + gain[t] * new)
                    h[p] = root * new
                    for q in range(p + 1):
                        information[p, q] += h[p] * h[q]
            variance, inverse = leg.rest, inverse_of_lower(lower(information))
            for axis in range(2):
                for p in range(m):
                    part = 0.0
                    for q in range(p + 1):
                        part += inverse[p, q] * position[T - 1, axis, q]
                    variance += part**2
            out[a, b] = math.sqrt(variance)
    return out


@kernel(error_model="numpy")
def second_places(
    rows: Integers,
    columns: Integers,
    ground: Ground,
    approach: Approach,
    prior: float,
    separation: float,
    places: Array,
    step: float,
) -> Array:
    """Return (N, M) the probability that a second place is likelier than the true one.

    Parameters
    ----------
    rows, columns : (N,), (M,) arrays of int
        Nodes of the map.
    ground : Ground
    approach : Approach
        With the readings that are given.
    prior : float
        m, 1-sigma of the place.
    separation : float
        How far apart two places are, in 1-sigmas.
    places : (K,) array
        m, places tried to the north and, likewise, to the east; evenly spaced.
    step : float
        m, of derivatives.
    """
    T, K = approach.offset.shape[0], places.shape[0]
    out = np.full((rows.size, columns.size), math.nan)
    gain, weight, known = np.empty(T), np.empty(T), np.ones(T, dtype=np.bool_)
    own, w, fit = np.empty(T), np.empty(T), np.empty((K, K))
    for a in range(rows.size):
        i = rows[a]
        for b in range(columns.size):
            j = columns[b]
            if math.isnan(ground.grid.values[i, j]):
                continue
            correlation = _filter(ground, approach, i, j, known, gain, weight)
            node = _Node(
                ground.grid.values, i, j, ground.cell[i], approach.offset, approach.by_place,
                prior, step, correlation, gain, weight,
            )  # fmt: skip
            _white(node, 0.0, 0.0, own)
            for p in range(K):
                for q in range(K):
                    _white(node, places[p], places[q], w)
                    fit[p, q] = _misfit(node, w, own, places[p], places[q])
            out[a, b] = _of_node(node, own, places, fit, separation**2)
    return out


@kernel(error_model="numpy")
def _of_node(node: _Node, own: Array, places: Array, fit: Array, apart: float) -> float:
    """Return the probability at one node, from the chi-square (K, K) at places; `own` (T,) is
    what `_white` writes of the node, `apart` the square of the separation."""
    K, size = places.shape[0], places[1] - places[0]
    found = np.empty((_MOST + 1, 6))  # north, east, chi-square, Hessian
    w, slopes, hessian = np.empty(own.size), np.empty((2, own.size)), np.empty(3)
    _slopes(node, 0.0, 0.0, w, slopes, hessian)
    for k in range(3):
        found[0, k], found[0, 3 + k] = 0.0, hessian[k]
    count = 1
    for p in range(1, K - 1):
        for q in range(1, K - 1):
            if not _least(fit, p, q) or fit[p, q] - _below(fit, p, q) > _PROMISING:
                continue
            north, east = places[p], places[q]
            for _ in range(_STEPS):
                _slopes(node, north, east, w, slopes, hessian)
                g_n, g_e = north / node.prior**2, east / node.prior**2
                for t in range(w.shape[0]):
                    g_n += slopes[0, t] * (w[t] - own[t])
                    g_e += slopes[1, t] * (w[t] - own[t])
                determinant = hessian[0] * hessian[2] - hessian[1] ** 2
                north -= (hessian[2] * g_n - hessian[1] * g_e) / determinant
                east -= (hessian[0] * g_e - hessian[1] * g_n) / determinant
                north = min(max(north, places[p] - _REACH * size), places[p] + _REACH * size)
                east = min(max(east, places[q] - _REACH * size), places[q] + _REACH * size)
            _white(node, north, east, w)
            value = min(_misfit(node, w, own, north, east), fit[p, q])
            if not value < _NEGLIGIBLE:
                continue
            place = count
            for k in range(count):
                d_n, d_e = north - found[k, 0], east - found[k, 1]
                spread = _spread(found[k, 3:], d_n, d_e) + _spread(hessian, d_n, d_e)
                least = 0.5 * (value + found[k, 2]) + 0.25 * apart
                clear = 2.0 * (d_n**2 + d_e**2) > apart * spread
                if not (clear and _worse_between(node, w, own, north, east, d_n, d_e, least)):
                    place = k
                    break
            if place == count:
                if count > _MOST:
                    continue
                count += 1
            elif place == 0 or value >= found[place, 2]:
                continue
            found[place, 0], found[place, 1], found[place, 2] = north, east, value
            for k in range(3):
                found[place, 3 + k] = hessian[k]
    return _probability(found[:count])


@kernel(error_model="numpy")
def _worse_between(
    node: _Node,
    w: Array,
    own: Array,
    north: float,
    east: float,
    d_n: float,
    d_e: float,
    least: float,
) -> bool:
    """Whether the chi-square is above `least` somewhere between a place and that (d_n, d_e) before
    it; `w` is work space."""
    for part in _BETWEEN:
        n, e = north - part * d_n, east - part * d_e
        _white(node, n, e, w)
        if _misfit(node, w, own, n, e) > least:
            return True
    return False


@kernel(error_model="numpy")
def _misfit(node: _Node, w: Array, own: Array, north: float, east: float) -> float:
    """Return the chi-square of a place, by whitened readings (T,) there and at the true one; NaN,
    which is not less than anything, where one is missing."""
    out = (north**2 + east**2) / node.prior**2
    for t in range(w.shape[0]):
        out += (w[t] - own[t]) ** 2
    return out


@kernel(error_model="numpy")
def _probability(found: Array) -> float:
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
def _least(fit: Array, p: int, q: int) -> bool:
    """Whether a point of a grid is not above its neighbours."""
    for d in range(-1, 2):
        for e in range(-1, 2):
            if not fit[p + d, q + e] >= fit[p, q]:
                return False
    return True


@kernel(error_model="numpy")
def _below(fit: Array, p: int, q: int) -> float:
    """Return by how much parabolas through a point's neighbours go below it."""
    out = 0.0
    for d, e in ((1, 0), (0, 1)):
        low, high = fit[p - d, q - e], fit[p + d, q + e]
        bend = low + high - 2.0 * fit[p, q]
        if bend > 0.0 and bend < math.inf:
            out += (high - low) ** 2 / (8.0 * bend)
    return out


@kernel(error_model="numpy")
def _spread(hessian: Array, north: float, east: float) -> float:
    """Return the variance of a place along a direction, which need not be of length one."""
    determinant = hessian[0] * hessian[2] - hessian[1] ** 2
    square = hessian[2] * north**2 - 2.0 * hessian[1] * north * east + hessian[0] * east**2
    return square / (determinant * max(north**2 + east**2, 1e-12))


@kernel(error_model="numpy")
def _slopes(
    node: _Node, north: float, east: float, w: Array, slopes: Array, hessian: Array
) -> None:
    """Write the whitened readings (T,) at a place, their slopes (2, T) to north and east, and half
    the Hessian of the chi-square (north north, north east, east east)."""
    h = node.step
    for axis in range(2):
        d_n, d_e = (h, 0.0) if axis == 0 else (0.0, h)
        _white(node, north - d_n, east - d_e, w)
        _white(node, north + d_n, east + d_e, slopes[axis])
        for t in range(w.shape[0]):
            slopes[axis, t] = (slopes[axis, t] - w[t]) / (2.0 * h)
    _white(node, north, east, w)
    hessian[0] = hessian[2] = 1.0 / node.prior**2
    hessian[1] = 0.0
    for t in range(w.shape[0]):
        hessian[0] += slopes[0, t] ** 2
        hessian[1] += slopes[0, t] * slopes[1, t]
        hessian[2] += slopes[1, t] ** 2


@kernel(error_model="numpy")
def _white(node: _Node, north: float, east: float, out: Array) -> None:
    """Write the readings (T,) of a leg that ends some way (m) off a node, linear between nodes of
    the map, in units of the noise and without what the ones before say of it; NaN off the map
    and from there on."""
    offset, cell = node.offset, node.cell
    before, more = 0.0, node.by_place[0] * north + node.by_place[1] * east
    for t in range(offset.shape[0]):
        row = node.row + (offset[t, 0] + north) / cell[0]
        column = node.column + (offset[t, 1] + east) / cell[1]
        expected = node.correlation * before
        difference = _linear(node.values, row, column) - more - expected
        before = expected + node.gain[t] * difference
        out[t] = math.sqrt(node.weight[t]) * difference


@kernel(error_model="numpy")
def _linear(values: Values, row: float, column: float) -> float:
    """Return the value at a place between nodes of a map, linear in either direction; NaN off the
    map."""
    n, m = values.shape
    k, c = min(max(math.floor(row), 0), n - 2), min(max(math.floor(column), 0), m - 2)
    v = row - k if 0.0 <= row < n - 1 else math.nan
    u = column - c if 0.0 <= column < m - 1 else math.nan
    return (1.0 - v) * ((1.0 - u) * values[k, c] + u * values[k, c + 1]) + v * (
        (1.0 - u) * values[k + 1, c] + u * values[k + 1, c + 1]
    )
