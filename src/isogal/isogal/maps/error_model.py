"""The error of a map as a random field, the same for simulator, matcher, bound and gridding.

Errors of a scalar map at places i and j have the covariance sigma_i sigma_j exp(-d / L) at a
distance d. Along a straight track that is a Gauss-Markov process: after a distance d the share
exp(-d / L) of an error is left, and 1 - exp(-2 d / L) of its variance joins (docs/mathematics.md,
section 5.2). What becomes of it in a transform of the map, `isogal.maps.error_spectrum`; where it
holds together further in one direction, `isogal.maps.error_ellipses`.

Errors of the components of the gravity gradient tensor all come from one wrong potential (section
12.4 there). The error of T_dd is a field with the covariance sigma² exp(-d / L), thus with the
spectrum S(k) = L² / (1 + k² L²)^(3/2), and the errors of the other components follow from it wave
by wave, as the components themselves do (`isogal.maps.potential`). With the wave vector
k (cos theta, sin theta) their factors are

    dd: 1,  nd: i cos theta,  ed: i sin theta,
    nn: -cos² theta,  ee: -sin² theta,  ne: -sin theta cos theta,

so that nn + ee + dd = 0. The product of two factors is a sum of p_m exp(i m theta), |m| <= 4, and
the mean over directions of exp(i m theta) exp(-i k r cos(theta - phi)) is (-i)^m J_m(k r)
exp(i m phi) (Jacobi-Anger; Abramowitz & Stegun 1964, 9.1.41 ff.). Hence, with r from a first place
to a second in the direction phi,

    E T_a(x) T_b(x + r) = sigma² sum over m of p_m (-i)^|m| exp(i m phi) C_|m|(r / L),
    C_m(x) = ∫ u / (1 + u²)^(3/2) J_m(u x) du,

the Hankel transforms of the spectrum. C_0 = exp(-x), C_1 = y (I0 K0 - I1 K1)(y) with y = x / 2,
and from 9.1.27 and 9.1.30 there

    C_2 = 2/x² ∫ s C_0 ds - C_0,   C_3 = 4/x³ ∫ s² C_1 ds - C_1,
    C_4 = C_0 + 4/x² ∫ s C_0 ds - 12/x⁴ ∫ s³ C_0 ds,    integrals from 0 to x.

Far away C_m falls as m / x². They are tabulated once, for all lengths."""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import geodetic_to_ecef

Complex = NDArray[np.complex128]
_ORDERS: Final = 5
_FACTORS: Final = {
    # Fourier coefficients of exp(i m theta), m = -2 ... 2
    "dd": (0.0, 0.0, 1.0, 0.0, 0.0),
    "nd": (0.0, 0.5j, 0.0, 0.5j, 0.0),
    "ed": (0.0, -0.5, 0.0, 0.5, 0.0),
    "nn": (-0.25, 0.0, -0.5, 0.0, -0.25),
    "ee": (0.25, 0.0, -0.5, 0.0, 0.25),
    "ne": (-0.25j, 0.0, 0.0, 0.0, 0.25j),
}
_NEAREST, _FARTHEST = 1e-4, 1e3
"""x of the table; nearer than that C_m is as good as at zero, farther m / x²."""
_STEPS = 8000
_TO_INVERSE_E: Final = 2.14619
"""x where (1 + x) exp(-x) = 1 / e."""
LEAST_STEP_M, NUGGET = 1.0, 1e-6
"""Nearer to the scan before map errors are the same; share of their variance that is each one's
own, against rounding."""


def decay(distance: Array | float, length: Array | float) -> Array:
    """Return exp(-d / L): the correlation of errors at a distance (...) m, and the share of an
    error that is left after it."""
    return np.asarray(np.exp(-distance / length))


@kernel
def markov_step(distance: float, length: float) -> tuple[float, float]:
    """Return what a distance (m) does to an error along a track: the share that is left of it, and
    that of its variance which joins, so that the variance stays."""
    left = math.exp(-distance / length)
    return left, 1.0 - left * left


def covariance(latitude: Array, longitude: Array, sigma: Array, length: float) -> Array:
    """Return (N, N) the covariance of a scalar map's errors.

    Parameters
    ----------
    latitude, longitude : (N,) arrays
        rad.
    sigma : (N,) array
        1-sigma of the errors there, unit of the map.
    length : float
        Their correlation length, m.
    """
    places = geodetic_to_ecef(latitude, longitude, 0.0)
    distance = np.sqrt(((places[:, None] - places) ** 2).sum(axis=-1))
    return np.asarray(np.outer(sigma, sigma) * decay(distance, length))


def displacements(latitude: Array, longitude: Array) -> Array:
    """Return (N, N, 2) m from place i to place j (rad), north and east, with the mean of the radii
    at both."""
    north, east = metres_per_radian(latitude)
    east_by = longitude - longitude[:, None]
    east_by -= 2.0 * np.pi * np.rint(east_by / (2.0 * np.pi))
    return np.stack(
        [
            0.5 * (north[:, None] + north) * (latitude - latitude[:, None]),
            0.5 * (east[:, None] + east) * east_by,
        ],
        axis=-1,
    )


def tensor_covariance(
    components: Sequence[str],
    channel: Integers,
    apart: Array,
    length: float,
    other: Integers | None = None,
) -> Array:
    """Return (N, M) the covariance of the map errors of N readings and M others, in units of the
    variance of T_dd's.

    Parameters
    ----------
    components : sequence of str
        Of `potential.COMPONENTS`, one for each channel.
    channel : (N,) array
        Of each reading.
    apart : (N, M, 2) array
        [i, j] from place i to place j, north and east, m.
    length : float
        L, m.
    other : (M,) array, optional
        Channels of the other readings; None = the same readings.
    """
    distance = np.hypot(apart[..., 0], apart[..., 1])
    safe = np.where(distance > 0.0, distance, 1.0)
    unit = (apart[..., 0] + 1j * apart[..., 1]) / safe
    second = channel if other is None else other
    table, x = products(tuple(components)), distance / length
    total, turned = np.zeros(distance.shape), np.ones_like(unit)
    for order in range(_ORDERS):
        if table[order][np.ix_(np.unique(channel), np.unique(second))].any():
            coefficient = table[order][channel[:, None], second]
            total += (coefficient * turned).real * _hankel(order, x)
        turned *= unit
    return total


@lru_cache(maxsize=8)
def products(components: tuple[str, ...]) -> Complex:
    """Return (5, C, C) by order m >= 0 the complex factor of exp(i m phi) C_m in the covariance of
    two components, of whose product the real part counts."""
    count = len(components)
    result = np.zeros((_ORDERS, count, count), dtype=complex)
    for a, first in enumerate(components):
        for b, second in enumerate(components):
            # conjugating turns the order of the harmonics about
            other = np.conj(np.array(_FACTORS[second]))[::-1]
            whole = np.convolve(np.array(_FACTORS[first]), other)
            result[0, a, b] = whole[4]
            for m in range(1, _ORDERS):
                # exp(-i m phi) comes with the conjugate of what belongs to exp(i m phi)
                result[m, a, b] = (-1j) ** m * whole[4 + m] + np.conj((-1j) ** m * whole[4 - m])
    return result


def wave_factors(components: Sequence[str], direction: Array) -> Complex:
    """Return (C, K) what waves of T_dd's error with directions (K,), rad from north to east, are
    multiplied by to be those of the components'."""
    harmonics = np.exp(1j * np.outer(np.arange(-2, 3), direction))
    return np.asarray(np.array([_FACTORS[name] for name in components]) @ harmonics)


def shares(components: Sequence[str]) -> Array:
    """Return (C,) the variance of each component's error in units of that of T_dd."""
    return np.array([float((np.abs(_FACTORS[name]) ** 2).sum()) for name in components])


def _hankel(order: int, x: Array) -> Array:
    """Return C_m(x) for an order m."""
    if order == 0:
        return np.exp(-x)
    log_x, table = _table()
    near = np.interp(np.log(np.maximum(x, 1e-300)), log_x, table[order], left=0.0)
    return np.where(x > _FARTHEST, order / np.maximum(x, _FARTHEST) ** 2, near)


@lru_cache(maxsize=1)
def _table() -> tuple[Array, Array]:
    """Return (K,) log x and (5, K) C_m there."""
    from scipy.special import ive, kve

    x = np.geomspace(_NEAREST, _FARTHEST, _STEPS)
    first = np.exp(-x)
    # ∫ s C_0 and ∫ s³ C_0 as they are, but by their series where they cancel
    linear = np.where(x < 1e-2, x**2 / 2 - x**3 / 3 + x**4 / 8, 1.0 - (1.0 + x) * first)
    cubic = np.where(
        x < 5e-2,
        x**4 / 4 - x**5 / 5 + x**6 / 12 - x**7 / 42 + x**8 / 192,
        6.0 - (x**3 + 3 * x**2 + 6 * x + 6.0) * first,
    )
    y = 0.5 * x
    # ive kve = I K: the exponential factors cancel
    one = y * (ive(0, y) * kve(0, y) - ive(1, y) * kve(1, y))
    # ∫ s² C_1 ds by the trapezoid rule in log s
    each = 0.5 * np.diff(np.log(x)) * (x[1:] ** 3 * one[1:] + x[:-1] ** 3 * one[:-1])
    square = np.concatenate([[0.0], np.cumsum(each)])
    table = [
        first,
        one,
        2.0 * linear / x**2 - first,
        4.0 * square / x**3 - one,
        first + 4.0 * linear / x**2 - 12.0 * cubic / x**4,
    ]
    return np.log(x), np.array(table)


class Chain(NamedTuple):
    """Map errors of a scan that depend on each other."""

    order: int
    """Scans that say what the next one's are."""
    places: Array
    """(K, 2) m, north and east, of where they are in a scan."""
    names: tuple[str, ...] | None
    """Tensor components of one potential; None = one map."""

    def correlation(self, apart: Array, length: float) -> Array:
        """Return (..., N, N) that of N = (order + 1) K errors, [i, j] `apart` from i to j."""
        if self.names is None:
            return decay(np.hypot(apart[..., 0], apart[..., 1]), length)
        every = np.tile(np.arange(len(self.names)), self.order + 1)
        unit = 1.0 / np.sqrt(shares(self.names))[every]
        return tensor_covariance(self.names, every, apart, length) * unit[:, None] * unit


def independent(count: int, travelled: Array, lengths: Array) -> tuple[Array, Array]:
    """Return `step` and `joined` (L, n, U, U) as `chained` does of U errors that do not depend on
    each other, of rows that are distances (n,) in m from the ones before."""
    left = decay(travelled, lengths[:, None])[..., None, None]
    return left * np.eye(count), (1.0 - left**2) * np.eye(count)


def smooth(travelled: Array, length: float) -> tuple[Array, Array]:
    """Return `step` and `joined` (n, 2, 2) as `chained` does of an error without kinks and its
    slope, both in units of their 1-sigma, of rows that are distances (n,) in m from the ones
    before.

    Errors at a distance d have the correlation (1 + d / a) exp(-d / a), which is 1 / e at `length`
    (m): Matern's of order 3/2 (Hartikainen & Sarkka 2010, IEEE MLSP, eq. 12)."""
    d = travelled * _TO_INVERSE_E / length
    left, zero = np.exp(-d), np.zeros_like(d)
    step = np.stack([np.stack([1.0 + d, d], -1), np.stack([zero - d, 1.0 - d], -1)], axis=-2)
    step *= left[:, None, None]
    return step, np.eye(2) - step @ step.swapaxes(1, 2)


def chained(
    chain: Chain, moved: Array, before: Array, lengths: Array, begins: bool
) -> tuple[Array, Array, Array]:
    """Return how a chain of U map errors goes on along a track, u -> step u with `joined` added to
    their covariance, in units of their 1-sigma.

    Parameters
    ----------
    chain : Chain
    moved : (n, 2) array
        m north and east of each row from the one before.
    before : (order, 2) array
        The same of the last scans.
    lengths : (L,) array
        Correlation lengths, m.
    begins : bool
        Whether the first row is the first of all.

    Returns
    -------
    steps : (order, 2) array
        `before` of the next rows.
    step, joined : (L, n, U, U) arrays
        0 where a row is at the place of the one before.

    Notes
    -----
    The covariance of map errors says what to expect of the next scan's by those of `order` scans,
    as if those before did not matter (a vector autoregression; Vecchia 1988, J. R. Stat. Soc. B
    50:297)."""
    count, order, size = len(moved), chain.order, len(chain.places)
    whole = order * size
    step, joined = (np.zeros((len(lengths), count, whole, whole)) for _ in range(2))
    if begins:
        moved = np.concatenate([before[:1], moved[1:]])
    scans = np.flatnonzero(np.hypot(*moved.T) > LEAST_STEP_M)
    trail = np.concatenate([before[1:], moved[scans]])
    back = np.stack([trail[order - 1 - k :][: len(scans)] for k in range(order)], axis=1)
    places = np.concatenate([np.zeros((len(scans), 1, 2)), -np.cumsum(back, axis=1)], axis=1)
    places = (places[:, :, None] + chain.places).reshape(len(scans), -1, 2)
    apart = places[:, None] - places[:, :, None]
    older = np.arange(size, whole)
    for k, length in enumerate(lengths):
        every = chain.correlation(apart, float(length)) + NUGGET * np.eye(whole + size)
        now, cross = every[:, :size, :size], every[:, size:, :size]
        gain = np.linalg.solve(every[:, size:, size:], cross).swapaxes(1, 2)
        step[k, scans, :size] = gain
        step[k][scans[:, None], older, older - size] = 1.0
        joined[k][scans[:, None, None], np.arange(size)[:, None], np.arange(size)] = (
            now - gain @ cross
        )
        if begins:
            step[k, 0], joined[k, 0] = 0.0, every[0, :whole, :whole]
    return np.concatenate([before, moved[scans]])[-order:], step, joined
