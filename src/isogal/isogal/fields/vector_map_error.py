"""The map error as a gravity vector: horizontal parts of the same realisation.

Where the disturbance differs from its map by a field with covariance C(d) = sigma² exp(-d / L),
the disturbing potential that causes it pulls horizontally, too. Above flat ground, with the wave
vector k, g_i = i k_i / |k| dg, so the field's two-point functions follow from C alone (spectral
relations: Heiskanen & Moritz 1967, section 7-4; Jordan 1972, J. Geophys. Res. 77:3660). With the
unit vector e from x to y, d = |y - x| and y' = d / 2L,

    E g_i(x) g_j(y) = (C - M/d²) e_i e_j + M/d² (delta_ij - e_i e_j),
                      M = sigma² L² (1 - (1 + d/L) exp(-d/L)),
    E dg(x) g_i(y)  = -sigma² y' (I0 K0 - I1 K1)(y') e_i,

I and K the modified Bessel functions. The horizontal components have half the variance of the
disturbance each.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.fields.error_root import KEPT_PLACES
from isogal.scenario import Truth
from isogal.seeds import generator
from isogal.sensors.trajectory import Trajectory

_EVERY = 3
"""Scans from one horizontal draw to the next."""
_JITTER = 1e-6
"""Of the variance, against rounding: the places of the disturbance's draws are on the sphere,
these in a plane."""


def horizontal_covariance(apart: Array, length: float) -> Array:
    """Return (..., 2, 2) covariance of the horizontal components at two points, sigma = 1.

    Parameters
    ----------
    apart : (..., 2) array
        From one point to the other, north and east, m.
    length : float
        L, m.
    """
    distance = np.sqrt((apart**2).sum(axis=-1))
    x = distance / length
    small = x < 1e-3
    safe = np.where(small, 1.0, x)
    across = np.where(small, 0.5 - x / 3.0, (1.0 - (1.0 + safe) * np.exp(-safe)) / safe**2)
    along = np.exp(-x) - across
    unit = apart / np.maximum(distance, 1e-9)[..., None]
    outer = unit[..., :, None] * unit[..., None, :]
    return along[..., None, None] * outer + across[..., None, None] * (np.eye(2) - outer)


def cross_covariance(apart: Array, length: float) -> Array:
    """Return (..., 2) covariance of the disturbance at a first point and the horizontal components
    at a second one, sigma = 1.

    Parameters
    ----------
    apart : (..., 2) array
        From the first point to the second, north and east, m.
    length : float
        L, m.
    """
    from scipy.special import ive, kve

    distance = np.sqrt((apart**2).sum(axis=-1))
    y = np.maximum(distance / (2.0 * length), 1e-12)
    # ive kve = I K: the exponential factors cancel
    size = y * (ive(0, y) * kve(0, y) - ive(1, y) * kve(1, y))
    return -size[..., None] * apart / np.maximum(distance, 1e-9)[..., None]


def draw_horizontal_error(
    scenario: Truth,
    trajectory: Trajectory,
    index: Integers,
    runs: Sequence[int],
    disturbance_error: Array,
) -> tuple[Integers, Array]:
    """Return where the horizontal map error is drawn, and what it is there.

    It is drawn given the error of the disturbance at the scans, so that both belong to one field.
    The horizontal components move a position only after two integrations: every third scan is
    enough, and in between they are taken as linear.

    Parameters
    ----------
    scenario : Truth
    trajectory : Trajectory
    index : (scans,) array
        Of the scans in the trajectory.
    runs : sequence of int
        They seed the random streams.
    disturbance_error : (R, scans) array
        What `simulator.draw_map_error` has drawn, m/s².

    Returns
    -------
    (stations,), (R, stations, 2) arrays
        Index in the trajectory; error to north and east, m/s².
    """
    sigma, length = scenario.map_error.sigma, scenario.map_error.correlation_length
    stations = np.unique(np.concatenate([[0], index[::_EVERY], index[-1:]]))
    count = 2 * len(stations)
    if sigma == 0.0:
        return stations, np.zeros((len(runs), len(stations), 2))
    plane = _plane(trajectory)
    given = _given if len(index) <= KEPT_PLACES else _given.__wrapped__
    gain, root = given(plane[index].tobytes(), plane[stations].tobytes(), length)
    drawn = [
        # a product for each run: its numbers must not depend on how many runs are computed
        error @ gain
        + sigma
        * root
        @ generator(scenario.seed, run, "map_error_horizontal").standard_normal(count)
        for run, error in zip(runs, disturbance_error, strict=True)
    ]
    return stations, np.stack(drawn).reshape(len(runs), len(stations), 2)


@lru_cache(maxsize=1)
def _given(scans: bytes, stations: bytes, length: float) -> tuple[Array, Array]:
    """Return (scans, 2 S) by which the disturbance's error at the scans makes the mean of the
    horizontal ones at S stations, and (2 S, 2 S) a square root of what is left of their
    covariance, sigma = 1; places (N, 2) m in a plane as bytes."""
    first, second = (np.frombuffer(places).reshape(-1, 2) for places in (scans, stations))
    count = 2 * len(second)
    known = np.exp(-np.sqrt((_apart(first, first) ** 2).sum(axis=-1)) / length)
    cross = cross_covariance(_apart(first, second), length).reshape(-1, count)
    own = horizontal_covariance(_apart(second, second), length)
    own = own.transpose(0, 2, 1, 3).reshape(count, count)
    gain = np.linalg.solve(known + _JITTER * np.eye(len(first)), cross)
    rest = own - cross.T @ gain
    root = np.linalg.cholesky(0.5 * (rest + rest.T) + _JITTER * np.eye(count))
    return np.asarray(gain), np.asarray(root)


def _plane(trajectory: Trajectory) -> Array:
    """Return (K + 1, 2) m, north and east, the points of the route in one plane."""
    latitude, longitude = trajectory.latitude, trajectory.longitude
    north, east = metres_per_radian(float(latitude.mean()))
    return np.stack([latitude * north, longitude * east], axis=-1)


def _apart(first: Array, second: Array) -> Array:
    """Return (n, m, 2) m, from points (n, 2) to others (m, 2)."""
    return np.asarray(second[None] - first[:, None])
