"""The map lookup function: candidates for the place of a reading (paper eqs. s2-01, s2-02).

A search window about the prior position, the map points in it, and of these the n whose predicted
reading is nearest to the reading. Map points are the map's own cells, or a finer lattice
interpolated between them where a finer spacing is asked for: the paper's map has a point every 220
m, and on a coarser map its 5 x 5 km window would hold no more cells than the candidates wanted.
"""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.maps.interpolation import Grid, value_and_gradient


class Window(NamedTuple):
    """Search window about a prior position."""

    shape: Array
    """(2, 2) m⁻²: a point at offset d lies inside where d' shape d <= 1; zero for a rectangle."""
    half_width: Array
    """(2,) m, north and east, of the box round the window."""


@kernel
def search_window(covariance: Array, gamma: float, minimum: float, rectangle: bool) -> Window:
    """Search window of paper eq. s2-02 about the prior position.

    Parameters
    ----------
    covariance : (2, 2) array
        Prior covariance of the position, north-east, m².
    gamma : float
        Threshold of the squared Mahalanobis distance.
    minimum : float
        Least half-width in any direction, m: the principal semi-axes of the ellipse are raised to
        it.
    rectangle : bool
        The paper's cheaper window: the box round the ellipse, sides north and east.
    """
    # closed form of the eigenvalues of a symmetric 2 x 2 matrix
    centre = 0.5 * (covariance[0, 0] + covariance[1, 1])
    half = 0.5 * (covariance[0, 0] - covariance[1, 1])
    off = 0.5 * (covariance[0, 1] + covariance[1, 0])
    radius = math.hypot(half, off)
    floor = minimum * minimum
    large = max(gamma * (centre + radius), floor)
    small = max(gamma * (centre - radius), floor)
    middle, stretch = 0.5 * (large + small), 0.5 * (large - small)
    cosine, sine = (half / radius, off / radius) if radius > 0.0 else (1.0, 0.0)
    nn, ee, ne = middle + stretch * cosine, middle - stretch * cosine, stretch * sine
    shape = np.zeros((2, 2))
    if not rectangle:
        determinant = large * small
        shape[0, 0] = ee / determinant
        shape[1, 1] = nn / determinant
        shape[0, 1] = -ne / determinant
        shape[1, 0] = shape[0, 1]
    return Window(shape, np.array([math.sqrt(nn), math.sqrt(ee)]))


@kernel
def subdivision(step: float, spacing: float) -> int:
    """Number of lattice steps in a cell of width ``step`` (m) so that none is wider than
    ``spacing`` (m)."""
    return max(1, math.ceil(step / spacing - 1e-9))


@kernel
def lattice_spacing(grid: Grid, metres: tuple[float, float], spacing: float) -> float:
    """Mean distance, m, between the map points that `lookup` uses."""
    north, east = grid.latitude_step * metres[0], grid.longitude_step * metres[1]
    return 0.5 * (north / subdivision(north, spacing) + east / subdivision(east, spacing))


@kernel
def lookup(
    grid: Grid,
    place: tuple[float, float],
    metres: tuple[float, float],
    window: Window,
    reading: float,
    slope: tuple[float, float],
    spacing: float,
    wanted: int,
) -> tuple[Array, Array]:
    """Find the map points whose predicted reading is nearest to the reading.

    The reading predicted at a point at offset (n, e) from the window's centre is map - slope . (n,
    e): the reading was reduced at the centre's position, and at the point its reduction would have
    been another (`Batch.reading_jacobian`).

    Parameters
    ----------
    grid : Grid
        The map's.
    place : (float, float)
        Latitude and longitude of the window's centre, rad.
    metres : (float, float)
        Metres per radian of latitude and of longitude.
    window : Window
        See `search_window`.
    reading : float
        The reading less the known offset of its scan, map's unit.
    slope : (float, float)
        d(reading)/d(position error) north and east, unit/m.
    spacing : float
        Widest lattice step, m; infinite = the map's cells as they are.
    wanted : int
        The n of the paper, 20 there.

    Returns
    -------
    offset : (n, 2) array
        North and east offset of each candidate from the centre, m; by increasing mismatch; n <=
        wanted. Empty where the window has no map point with a value and a gradient.
    gradient : (n, 2) array
        d(predicted reading)/d(north), /d(east), unit/m.
    """
    _, _, lat0, dlat, lon0, dlon = grid
    shape, half_width = window
    step_lat = dlat / subdivision(dlat * metres[0], spacing)
    step_lon = dlon / subdivision(dlon * metres[1], spacing)
    # lattice index (0, 0) is the map's cell (0, 0)
    row, column = (place[0] - lat0) / step_lat, (place[1] - lon0) / step_lon
    rows, columns = half_width[0] / (step_lat * metres[0]), half_width[1] / (step_lon * metres[1])
    mismatch = np.full(wanted, np.inf)
    offset, gradient = np.empty((wanted, 2)), np.empty((wanted, 2))
    found = 0
    for i in range(math.ceil(row - rows), math.floor(row + rows) + 1):
        north = (i - row) * step_lat * metres[0]
        for j in range(math.ceil(column - columns), math.floor(column + columns) + 1):
            east = (j - column) * step_lon * metres[1]
            inside = shape[0, 0] * north * north + 2.0 * shape[0, 1] * north * east
            if inside + shape[1, 1] * east * east > 1.0:
                continue
            value, by_lat, by_lon = value_and_gradient(
                grid, lat0 + i * step_lat, lon0 + j * step_lon
            )
            difference = abs(reading - (value - slope[0] * north - slope[1] * east))
            if not difference < mismatch[wanted - 1]:  # also where the map has no value
                continue
            k = min(found, wanted - 1)
            while k > 0 and mismatch[k - 1] > difference:
                mismatch[k] = mismatch[k - 1]
                for axis in range(2):
                    offset[k, axis], gradient[k, axis] = offset[k - 1, axis], gradient[k - 1, axis]
                k -= 1
            mismatch[k], offset[k, 0], offset[k, 1] = difference, north, east
            gradient[k, 0] = by_lat / metres[0] - slope[0]
            gradient[k, 1] = by_lon / metres[1] - slope[1]
            found = min(found + 1, wanted)
    return offset[:found].copy(), gradient[:found].copy()
