"""Grids as compiled functions take them, and bicubic interpolation with gradient on them.

Cubic convolution with a = -1/2 (Keys 1981, IEEE Trans. ASSP 29(6):1153-1160, eq. 15), separable in
latitude and longitude: 4 x 4 nodes, passes through the nodes, continuous with its first
derivatives, third-order accurate. A grid that goes round the Earth (m columns with m times the
longitude step = 2 pi) wraps in longitude. Whatever needs a node that is missing (NaN) or outside
the grid is NaN: never an edge value."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Values
from isogal.compiled import kernel

TWO_PI = 2.0 * math.pi


class Grid(NamedTuple):
    """Maps on a regular grid, as kernels take them: numbers at nodes, and where the nodes are."""

    values: Values
    """(C rows, m): the maps of C channels (one, of a single map) below one another; latitude
    first, both axes increasing; NaN = missing."""
    rows: int
    """Rows of a map."""
    latitude0: float
    """Of the first row, rad."""
    latitude_step: float
    """From row to row, rad, > 0."""
    longitude0: float
    """Of the first column, rad."""
    longitude_step: float
    """From column to column, rad, > 0."""


@kernel(error_model="numpy")
def is_periodic(columns: int, dlon: float) -> bool:
    """Tell whether a grid of this many columns goes round the Earth exactly once."""
    return abs(columns * dlon - TWO_PI) < 1e-3 * dlon


@kernel(error_model="numpy")
def column_position(columns: int, lon0: float, dlon: float, lon: float) -> float:
    """Return the fractional column of a longitude, turned by whole circles into the grid where
    that is possible.

    Parameters
    ----------
    columns : int
        Of the grid.
    lon0, dlon : float
        Its first longitude and step, rad.
    lon : float
        rad.
    """
    x = (lon - lon0) / dlon
    if x < 0.0 or x > columns - 1.0:
        circle = TWO_PI / dlon
        x -= math.floor(x / circle) * circle
    return x


@kernel(error_model="numpy")
def _locate(columns: int, dlon: float, x: float) -> tuple[int, float, bool]:
    """Return the column left of fractional column x, the fraction, and whether the four columns
    exist."""
    if is_periodic(columns, dlon):
        j = math.floor(x) if math.isfinite(x) else -1
        return j, x - j, j >= 0
    if not (1.0 <= x <= columns - 2.0):
        return -1, 0.0, False
    j = min(int(x), columns - 3)
    return j, x - j, True


@kernel(error_model="numpy")
def _weights(u: float) -> tuple[float, float, float, float]:
    """Return the weights of the four nodes around a point at a fraction u between the middle
    ones."""
    return (
        ((-0.5 * u + 1.0) * u - 0.5) * u,
        (1.5 * u - 2.5) * u * u + 1.0,
        ((-1.5 * u + 2.0) * u + 0.5) * u,
        (0.5 * u - 0.5) * u * u,
    )


@kernel(error_model="numpy")
def _slopes(u: float) -> tuple[float, float, float, float]:
    """Return the derivatives of `_weights`."""
    return (
        (-1.5 * u + 2.0) * u - 0.5,
        (4.5 * u - 5.0) * u,
        (-4.5 * u + 4.0) * u + 0.5,
        (1.5 * u - 1.0) * u,
    )


@kernel(error_model="numpy")
def value_and_gradient(
    grid: Grid, lat: float, lon: float, channel: int = 0
) -> tuple[float, float, float]:
    """Interpolate at one point.

    Parameters
    ----------
    grid : Grid
        See there.
    lat, lon : float
        Point, rad; longitudes may differ from the grid's by whole circles.
    channel : int
        Which of the maps on the grid, from 0.

    Returns
    -------
    value, d(value)/d(latitude), d(value)/d(longitude) : float
        Unit of the values, and per rad. All NaN where a node is missing or outside.
    """
    values, n, lat0, dlat, lon0, dlon = grid
    m = values.shape[1]
    y = (lat - lat0) / dlat
    x = column_position(m, lon0, dlon, lon)
    j, u, inside = _locate(m, dlon, x)
    if not inside or not (1.0 <= y <= n - 2.0):
        return math.nan, math.nan, math.nan
    i = min(int(y), n - 3)
    t = y - i
    i += channel * n

    a0, a1, a2, a3 = _weights(u)
    b0, b1, b2, b3 = _slopes(u)
    c0, c1, c2, c3 = _weights(t)
    d0, d1, d2, d3 = _slopes(t)

    j0, j1, j2, j3 = j - 1, j, j + 1, j + 2
    if j0 < 0 or j3 >= m:  # only a grid that goes round the Earth gets here
        j0, j1, j2, j3 = j0 % m, j1 % m, j2 % m, j3 % m
    p0, p1, p2, p3 = values[i - 1, j0], values[i - 1, j1], values[i - 1, j2], values[i - 1, j3]
    q0, q1, q2, q3 = values[i, j0], values[i, j1], values[i, j2], values[i, j3]
    r0, r1, r2, r3 = values[i + 1, j0], values[i + 1, j1], values[i + 1, j2], values[i + 1, j3]
    s0, s1, s2, s3 = values[i + 2, j0], values[i + 2, j1], values[i + 2, j2], values[i + 2, j3]
    p = a0 * p0 + a1 * p1 + a2 * p2 + a3 * p3
    q = a0 * q0 + a1 * q1 + a2 * q2 + a3 * q3
    r = a0 * r0 + a1 * r1 + a2 * r2 + a3 * r3
    s = a0 * s0 + a1 * s1 + a2 * s2 + a3 * s3
    # A missing node spoils value and gradient alike, since 0 * NaN is NaN.
    value = c0 * p + c1 * q + c2 * r + c3 * s
    by_lat = (d0 * p + d1 * q + d2 * r + d3 * s) / dlat
    by_lon = (
        c0 * (b0 * p0 + b1 * p1 + b2 * p2 + b3 * p3)
        + c1 * (b0 * q0 + b1 * q1 + b2 * q2 + b3 * q3)
        + c2 * (b0 * r0 + b1 * r1 + b2 * r2 + b3 * r3)
        + c3 * (b0 * s0 + b1 * s1 + b2 * s2 + b3 * s3)
    ) / dlon
    return value, by_lat, by_lon


@kernel(error_model="numpy")
def values_and_gradients(grid: Grid, lat: Array, lon: Array) -> tuple[Array, Array, Array]:
    """Interpolate a single map at many points: ``value_and_gradient`` over ``lat`` and ``lon``,
    both (N,)."""
    count = lat.shape[0]
    value = np.empty(count)
    by_lat = np.empty(count)
    by_lon = np.empty(count)
    for k in range(count):
        value[k], by_lat[k], by_lon[k] = value_and_gradient(grid, lat[k], lon[k])
    return value, by_lat, by_lon


@kernel(error_model="numpy")
def values_at(grid: Grid, lat: Array, lon: Array) -> Array:
    """Interpolate a single map at many points, values only."""
    count = lat.shape[0]
    out = np.empty(count)
    for k in range(count):
        out[k] = value_and_gradient(grid, lat[k], lon[k])[0]
    return out


@kernel(error_model="numpy")
def look_up(grid, lat, lon, channel, row, column, out):  # type: ignore[no-untyped-def]
    """Write the values of one map at many points: those of ``value_and_gradient`` to the last
    digit, in loops that the compiler makes vector instructions of.

    Parameters
    ----------
    grid : Grid
    lat, lon : (N,) arrays
        rad; overwritten.
    channel : int
    row, column : (N,) arrays of int
        Work space.
    out : (N,) array
    """
    values, n, lat0, dlat, lon0, dlon = grid
    m = values.shape[1]
    if is_periodic(m, dlon):
        for k in range(lat.shape[0]):
            out[k] = value_and_gradient(grid, lat[k], lon[k], channel)[0]
        return
    first, circle = channel * n, TWO_PI / dlon
    for k in range(lat.shape[0]):
        y, x = (lat[k] - lat0) / dlat, (lon[k] - lon0) / dlon
        x = x - math.floor(x / circle) * circle if x < 0.0 or x > m - 1.0 else x
        inside = 1.0 <= y <= n - 2.0 and 1.0 <= x <= m - 2.0
        y, x = y if inside else 1.0, x if inside else 1.0
        i, j = min(math.floor(y), n - 3), min(math.floor(x), m - 3)
        lat[k], lon[k] = y - i, x - j
        row[k], column[k] = first + i - 1, j - 1
        out[k] = 0.0 if inside else math.nan
    for k in range(lat.shape[0]):
        t, u = lat[k], lon[k]
        a0, a1, a2, a3 = _weights(u)
        c0, c1, c2, c3 = _weights(t)
        # unsigned: else each index is asked whether it counts from the end
        i, j = np.uint64(row[k]), np.uint64(column[k])
        one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
        j1, j2, j3 = j + one, j + two, j + three
        p = a0 * values[i, j] + a1 * values[i, j1] + a2 * values[i, j2] + a3 * values[i, j3]
        i += one
        q = a0 * values[i, j] + a1 * values[i, j1] + a2 * values[i, j2] + a3 * values[i, j3]
        i += one
        r = a0 * values[i, j] + a1 * values[i, j1] + a2 * values[i, j2] + a3 * values[i, j3]
        i += one
        s = a0 * values[i, j] + a1 * values[i, j1] + a2 * values[i, j2] + a3 * values[i, j3]
        out[k] += c0 * p + c1 * q + c2 * r + c3 * s


@kernel(error_model="numpy")
def bilinear(grid: Grid, lat: float, lon: float, channel: int = 0) -> float:
    """Interpolate linearly between the four nodes around a point (rad); NaN where one is missing
    or outside.

    For fields that must not overshoot, such as a 1-sigma.
    """
    values, n, lat0, dlat, lon0, dlon = grid
    m = values.shape[1]
    y, x = (lat - lat0) / dlat, column_position(m, lon0, dlon, lon)
    periodic = is_periodic(m, dlon)
    if not (0.0 <= y <= n - 1.0 and x >= 0.0 and (x <= m - 1.0 or periodic)):
        return math.nan
    i = min(int(y), n - 2)
    j = int(x) if periodic else min(int(x), m - 2)
    t, u, right = y - i, x - j, (j + 1) % m
    j %= m
    i += channel * n
    return (1.0 - t) * ((1.0 - u) * values[i, j] + u * values[i, right]) + t * (
        (1.0 - u) * values[i + 1, j] + u * values[i + 1, right]
    )


@kernel(error_model="numpy")
def bilinear_at(grid: Grid, lat: Array, lon: Array) -> Array:
    """Interpolate a single map linearly at many points: `bilinear` over ``lat`` and ``lon``, both
    (N,)."""
    out = np.empty(lat.shape[0])
    for k in range(lat.shape[0]):
        out[k] = bilinear(grid, lat[k], lon[k])
    return out
