"""How unlikely readings are under a covariance, and its derivatives by the covariance's parameters
(Rasmussen & Williams 2006, eqs. 5.8 and 5.9)."""

import math

import numpy as np

from isogal.arrays import Array
from isogal.maps.gridding.covariance import JITTER, Covariance, Readings

IMPOSSIBLE = 1e12
"""Misfit where the covariance is not positive definite."""


def misfit(covariance: Covariance, level: float, readings: Readings) -> tuple[float, Array]:
    """Return minus the log-likelihood of readings about an unknown level (1-sigma), and its
    derivatives by the logarithms of sigma and length of either part and of the noise; then, for
    readings of lines, of their offset; then, for `matern`, by that of the ratio and by the
    strike."""
    from scipy.linalg.lapack import dpotrf, dpotri

    line = readings.line
    R = covariance.of_readings(readings)
    R += level**2
    factor, failed = dpotrf(R, lower=1, clean=1)
    count = 5 + (covariance.line > 0.0) + 2 * (covariance.kind == "matern")
    if failed:
        return IMPOSSIBLE, np.zeros(count)
    inverse = np.tril(dpotri(factor, lower=1)[0])
    inverse += np.tril(inverse, -1).T
    solved = inverse @ readings.value
    cost = 0.5 * float(readings.value @ solved) + float(np.log(np.diag(factor)).sum())
    inverse -= np.outer(solved, solved)
    trace = float(np.trace(inverse))
    parts = _matern if covariance.kind == "matern" else _harmonic
    by_part, by_shape = parts(covariance, readings.places, inverse)
    by_part[:, 0] += [2.0 * JITTER * s**2 * trace for s in covariance.sigma]
    slopes = [*by_part.ravel(), 2.0 * covariance.noise**2 * trace]
    if covariance.line > 0.0:
        shared = 0.0 if line is None else float(inverse[line[:, None] == line].sum())
        slopes.append(2.0 * covariance.line**2 * shared)
    return cost, 0.5 * np.array([*slopes, *by_shape])


def _matern(covariance: Covariance, places: Array, weight: Array) -> tuple[Array, list[float]]:
    """Return (2, 2) the sum of weight (N, N) times the derivatives by sigma and length of either
    part, and that by ratio and strike."""
    along, across = (turned[:, None] - turned for turned in covariance.turned(places).T)
    square = along * along
    apart = across * across
    stretch = apart - square  # by the logarithm of the ratio
    square += apart
    apart = np.sqrt(square)
    by_part, of_square = np.empty((2, 2)), np.zeros_like(square)
    for i, (sigma, length) in enumerate(zip(covariance.sigma, covariance.length, strict=True)):
        k = math.sqrt(3.0) / length
        decay = np.exp(-k * apart)
        decay *= sigma**2 * weight
        by_part[i, 0] = 2.0 * float(decay.sum() + k * np.vdot(apart, decay))
        by_part[i, 1] = k**2 * float(np.vdot(square, decay))
        of_square -= 0.5 * k**2 * decay
    ratio = covariance.ratio
    turn = 2.0 * (1.0 / ratio - ratio) * float(np.vdot(along * across, of_square))
    return by_part, [float(np.vdot(stretch, of_square)), turn]


def _harmonic(covariance: Covariance, places: Array, weight: Array) -> tuple[Array, list[float]]:
    """Return the same of the harmonic kind, which has neither ratio nor strike."""
    east, north = (one[:, None] - one for one in places[:, :2].T)
    square = east * east + north * north
    by_part = np.empty((2, 2))
    for i, (sigma, depth) in enumerate(zip(covariance.sigma, covariance.length, strict=True)):
        z = places[:, 2:] + places[:, 2] + 2.0 * depth
        distance = square + z * z
        scaled = (sigma * 2.0 * depth) ** 2 * weight / distance**1.5
        by_part[i, 0] = 2.0 * float(np.vdot(z, scaled))
        steeper = 1.0 - 3.0 * z * z / distance
        by_part[i, 1] = by_part[i, 0] + 2.0 * depth * float(np.vdot(steeper, scaled))
    return by_part, []
