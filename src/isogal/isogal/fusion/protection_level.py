"""Horizontal protection level: the radius that the horizontal error of a navigation solution
exceeds no more than so many times per hour (docs/mathematics.md, section 11.5; docs/integrity.md).

The error is taken as bivariate t with the scatter matrix `INFLATION` P, P the filter's covariance:
a Gaussian whose covariance is known no better than P is. Along the direction phi of the error in
units of its own sigmas (Craig 1991),

    rho(phi)² = h² / (INFLATION (a² cos² phi + b² sin² phi))

with a and b the sigmas along the ellipse's axes, the probability to be outside of the radius h is
the mean over phi of (1 + rho² / nu)^(-nu / 2). An error that forgets itself as exp(-t / T) leaves
the circle of radius h f(h) / T times per unit of time, where f is the density of the horizontal
error."""

import math
from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.compiled import kernel

INFLATION = 1.03
"""Of the claimed covariance; 1.0 to 1.1 in told rows for the t distribution that fits e' P^-1 e
best (docs/integrity.md, column "factor, freedom")."""
FREEDOM = 80.0
"""Degrees of freedom nu of that distribution; 20 to 90 or nearly infinite in the same rows."""
HOUR = 3600.0

_DIRECTIONS = 256
"""Of the mean over a quarter of the circle."""
_DEGREE = 24
"""Of the polynomial in b / a."""
_ROUNDING = 1e-9
"""Negative eigenvalue, in shares of the other one, that rounding may leave."""


def protection_level(covariance: ArrayLike, risk: float, correlation_time: float) -> Array:
    """Return the radius that the horizontal error exceeds `risk` times per hour.

    Parameters
    ----------
    covariance : (..., 2, 2) array
        m², of the filter's horizontal position error.
    risk : float
        Times per hour.
    correlation_time : float
        s, of the error. risk x correlation_time is at most a tenth of an hour: what happens more
        often is no rare event.

    Returns
    -------
    (...) array
        m; infinite where the covariance is not finite or not one (nothing is promised).

    Raises
    ------
    ValueError
        Where risk or correlation time are not positive, or too large.
    """
    per_time = risk * correlation_time / HOUR
    if not 0.0 < per_time <= 0.1:
        raise ValueError(
            f"risk x correlation time must be above 0 and at most 0.1, is {per_time:g}"
        )
    major, minor = axes(covariance)
    level = np.empty(major.shape)
    _write_levels(*(one.reshape(-1) for one in (level, major, minor)), _level_of_ratio(per_time))
    return level


@kernel
def _write_levels(level: Array, major: Array, minor: Array, polynomial: Array) -> None:
    """Write the levels (N,) of ellipses (N,): the major axis times the polynomial of the ratio, by
    Clenshaw's recurrence."""
    for i in range(len(level)):
        x = 2.0 * (minor[i] / major[i] if major[i] > 0.0 else 0.0) - 1.0
        one, two = 0.0, 0.0
        for k in range(len(polynomial) - 1, 0, -1):
            one, two = polynomial[k] + 2.0 * x * one - two, one
        level[i] = major[i] * (polynomial[0] + x * one - two)
        if np.isnan(level[i]):
            level[i] = np.inf


def axes(covariance: ArrayLike) -> tuple[Array, Array]:
    """Return the sigmas (m) along the major and the minor axis of covariances (..., 2, 2); NaN
    where a covariance is not finite or has a negative eigenvalue."""
    # a copy, since parts of others and what may not be written to would be compiled anew
    whole = np.array(covariance, dtype=np.float64, order="C")
    sigmas = np.empty((2, *whole.shape[:-2]))
    _write_axes(sigmas.reshape(2, -1), whole.reshape(-1, 4))
    return sigmas[0], sigmas[1]


@kernel
def _write_axes(sigmas: Array, covariance: Array) -> None:
    """Write the sigmas (2, N) of covariances (N, 4), row by row."""
    for i in range(len(covariance)):
        north, east = covariance[i, 0], covariance[i, 3]
        across = 0.5 * (covariance[i, 1] + covariance[i, 2])
        middle = 0.5 * (north + east)
        major = middle + math.hypot(0.5 * (north - east), across)
        # the small eigenvalue from the determinant, which loses fewer digits
        minor = (north * east - across * across) / major if major > 0.0 else 0.0
        valid = np.isfinite(major) and middle >= 0.0 and minor >= -_ROUNDING * major
        sigmas[0, i] = math.sqrt(major) if valid else np.nan
        sigmas[1, i] = math.sqrt(max(minor, 0.0)) if valid else np.nan


@lru_cache(maxsize=64)
def _level_of_ratio(per_time: float) -> Array:
    """Return the polynomial (Chebyshev) of b / a that is the level in units of a, for so many
    exceedances per correlation time."""
    nodes = 0.5 * (1.0 + chebyshev.chebpts1(_DEGREE + 1))
    phi = (np.arange(_DIRECTIONS) + 0.5) * (0.5 * np.pi / _DIRECTIONS)
    spread = INFLATION * (np.cos(phi) ** 2 + np.multiply.outer(nodes**2, np.sin(phi) ** 2))
    # beyond the largest rate; the level of the roundest ellipse of 1e-12 is below the other end
    low, high = np.full(nodes.size, np.sqrt(2.0 * INFLATION)), np.full(nodes.size, 30.0)
    for _ in range(45):
        middle = 0.5 * (low + high)
        rho = middle[:, None] ** 2 / spread  # squared, of each direction
        density = np.exp(-(0.5 * FREEDOM + 1.0) * np.log1p(rho / FREEDOM))
        over = (rho * density).mean(axis=-1) > per_time
        low, high = np.where(over, middle, low), np.where(over, high, middle)
    return chebyshev.chebfit(2.0 * nodes - 1.0, 0.5 * (low + high), _DEGREE)
