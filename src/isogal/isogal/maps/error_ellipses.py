"""Errors of a map that hold together further in one direction than in another.

At a place it is said by a symmetric matrix E (m²) whose eigenvectors are the directions and the
square roots of whose eigenvalues are the lengths: with the same E everywhere the correlation is
c(sqrt(v' E⁻¹ v)) at a distance v. Arrays of E are (..., 3): north-north, north-east, east-east."""

import numpy as np

from isogal.arrays import Array, Booleans, Values

ELLIPSE_NAMES = ("error_length_longest", "error_length_shortest", "error_azimuth")
"""What the variables of a file that hold them are called, after the name of the field: m, m, and
the direction of the longer one, deg from north to east."""


def ellipses_of(longest: Values, shortest: Values, azimuth: Values) -> Array:
    """Return (..., 3) E from the lengths (m) and the direction of the longer one, rad from north
    to east."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    along, across = longest**2, shortest**2
    return np.stack(
        [c**2 * along + s**2 * across, c * s * (along - across), s**2 * along + c**2 * across],
        axis=-1,
    )


def axes_of(ellipses: Array) -> tuple[Array, Array, Array]:
    """Return the longer and the shorter length (m) of E (..., 3), and the direction of the longer
    one, rad from north to east, 0 to pi; the inverse of `ellipses_of`."""
    nn, ne, ee = np.moveaxis(ellipses, -1, 0)
    mean, half = 0.5 * (nn + ee), np.hypot(0.5 * (nn - ee), ne)
    shortest = np.sqrt(np.maximum(mean - half, 0.0))
    return np.sqrt(mean + half), shortest, np.mod(0.5 * np.arctan2(2.0 * ne, nn - ee), np.pi)


def mean_length(ellipses: Array) -> Array:
    """Return the geometric mean of both lengths (m) of E (..., 3)."""
    nn, ne, ee = np.moveaxis(ellipses, -1, 0)
    return np.asarray(np.sqrt(np.sqrt(nn * ee - ne**2)))


def impossible(ellipses: Array) -> Booleans:
    """Tell of which E (..., 3) a length is not above 0; NaN is possible."""
    nn, ne, ee = np.moveaxis(ellipses, -1, 0)
    return np.asarray((nn <= 0.0) | (ee <= 0.0) | (nn * ee <= ne**2))


def joint(apart: Array, one: Array, other: Array) -> tuple[Array, Array]:
    """Return (T, S) distances d between places, in lengths, and (T, S) factors f such that f c(d)
    is a correlation for every correlation c that exists in the plane, such as exp(-d).

    With E = (E_i + E_j) / 2: d² = v' E⁻¹ v, f = (|E_i| |E_j|)^(1/4) / |E|^(1/2) (Paciorek &
    Schervish 2006, Environmetrics 17(5), theorem 1).

    Parameters
    ----------
    apart : (2, T, S) v, north and east, m
    one, other : (T, 3), (S, 3) E_i and E_j
    """
    nn, ne, ee = 0.5 * (one.T[:, :, None] + other.T[:, None])
    both = nn * ee - ne**2
    north, east = apart
    square = (ee * north**2 - 2.0 * ne * north * east + nn * east**2) / both
    own, its = (each[:, 0] * each[:, 2] - each[:, 1] ** 2 for each in (one, other))
    return np.sqrt(np.maximum(square, 0.0)), np.sqrt(np.sqrt(np.outer(own, its)) / both)
