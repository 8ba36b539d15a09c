"""Normal gravity, its change with height, and the Eötvös acceleration of a moving vehicle. SI
units, positive down."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import E2, EARTH_RATE, GM, A, F, in_radians, radii

GAMMA_EQUATOR = 9.7803267715
"""Normal gravity at the equator, m/s² (Moritz 2000)."""
GAMMA_POLE = 9.8321863685
"""Normal gravity at the pole, m/s² (Moritz 2000)."""
SOMIGLIANA_K = (1.0 - F) * GAMMA_POLE / GAMMA_EQUATOR - 1.0
"""Somigliana's constant k."""
GRAVITY_RATIO = EARTH_RATE**2 * A**3 * (1.0 - F) / GM
"""m = w² a² b / GM."""
FREE_AIR = 3.086e-6
"""Mean free-air gradient, s⁻² (0.3086 mGal per m)."""


@kernel
def normal_gravity_at(sin_latitude: float, height: float) -> float:
    """Return normal gravity (m/s²) for one point: Somigliana, second order in height (Moritz 2000;
    Groves 2013 eq. 2.139)."""
    s2 = sin_latitude * sin_latitude
    surface = GAMMA_EQUATOR * (1.0 + SOMIGLIANA_K * s2) / np.sqrt(1.0 - E2 * s2)
    return surface * (
        1.0
        - 2.0 / A * (1.0 + F + GRAVITY_RATIO - 2.0 * F * s2) * height
        + 3.0 / (A * A) * height * height
    )


def normal_gravity(latitude: ArrayLike, height: ArrayLike = 0.0) -> Array:
    """Return normal gravity (m/s²) at geodetic latitudes (rad) and ellipsoidal heights (m); the
    arrays broadcast. Raises InputError as `in_radians` does, and so do the functions below."""
    s2 = np.sin(in_radians(latitude)) ** 2
    h = np.asarray(height, dtype=float)
    surface = GAMMA_EQUATOR * (1.0 + SOMIGLIANA_K * s2) / np.sqrt(1.0 - E2 * s2)
    return surface * (
        1.0 - 2.0 / A * (1.0 + F + GRAVITY_RATIO - 2.0 * F * s2) * h + 3.0 / A**2 * h**2
    )


def normal_gravity_gradient_north(latitude: ArrayLike) -> Array:
    """Return d(normal gravity)/d(north), s⁻², on the ellipsoid: the derivative of Somigliana's
    formula over M."""
    lat = in_radians(latitude)
    s, c = np.sin(lat), np.cos(lat)
    w2 = 1.0 - E2 * s * s
    steeper = 2.0 * SOMIGLIANA_K / np.sqrt(w2) + (1.0 + SOMIGLIANA_K * s * s) * E2 / w2**1.5
    return GAMMA_EQUATOR * s * c * steeper / radii(lat)[0]


def normal_gradient(latitude: ArrayLike, height: ArrayLike = 0.0) -> Array:
    """Return the normal gravity gradient (..., 3, 3), s⁻², axes north, east, down, at latitudes
    (rad) and heights (m) that broadcast.

    On the ellipsoid, a level surface, its curvatures give U_nn = -g/M and U_ee = -g/N, the change
    of g along it U_nd, and Poisson's equation outside the masses the rest, U_nn + U_ee + U_dd = 2
    w² (Heiskanen and Moritz 1967, sections 1-5 and 2-9). The radii grow by the height, g falls by
    it."""
    lat, h = np.broadcast_arrays(
        np.asarray(latitude, dtype=float), np.asarray(height, dtype=float)
    )
    m, n = radii(lat)
    gravity = normal_gravity(lat, h)
    gradient = np.zeros((*lat.shape, 3, 3))
    gradient[..., 0, 0] = -gravity / (m + h)
    gradient[..., 1, 1] = -gravity / (n + h)
    gradient[..., 2, 2] = 2.0 * EARTH_RATE**2 - gradient[..., 0, 0] - gradient[..., 1, 1]
    gradient[..., 0, 2] = gradient[..., 2, 0] = normal_gravity_gradient_north(lat)
    return gradient


def eotvos(latitude: ArrayLike, height: ArrayLike, v_north: ArrayLike, v_east: ArrayLike) -> Array:
    """Return the Eötvös acceleration (m/s², positive up): 2 w cos(lat) v_e + v_e²/(N+h) +
    v_n²/(M+h).

    It makes a moving gravimeter read less (Groves 2013, down component of the Coriolis and
    transport-rate terms)."""
    lat = in_radians(latitude)
    m, n = radii(lat)
    ve, vn, h = (np.asarray(one, dtype=float) for one in (v_east, v_north, height))
    return 2.0 * EARTH_RATE * np.cos(lat) * ve + ve**2 / (n + h) + vn**2 / (m + h)


def eotvos_jacobian(
    latitude: ArrayLike, v_north: ArrayLike, v_east: ArrayLike
) -> tuple[Array, Array]:
    """Return the derivatives of `eotvos` by (v_north, v_east), s⁻¹."""
    m, n = radii(latitude)
    return 2.0 * np.asarray(v_north) / m, 2.0 * EARTH_RATE * np.cos(latitude) + 2.0 * np.asarray(
        v_east
    ) / n
