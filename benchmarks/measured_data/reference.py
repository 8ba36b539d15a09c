"""The reference of rigid tracks: the posterior of a shift on a grid, with nothing of the matcher
that it judges.

Residuals r(x) of a reading's line at a shift x are D(x) e, D the map's own 1-sigma at each place,
and e has the covariance s² C + (noise / D)² + constant. C is an exponential, Matern 3/2 or
Gaussian with a length about the map's, and s, length, kind and constant are summed over. Of
innovations a tenth is five times as wide, or none. Readings off the map are compared with the
field's mean, with its whole variance."""

import math
from itertools import product

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.error_ellipses import mean_length
from isogal.maps.error_model import displacements
from isogal.maps.field_map import FieldMap
from isogal.matching.information import measurement_only
from measured_data.lines import Line, Shift
from measured_data.matches import Row, figures_of

READINGS = 120
"""Of a line, every so many-th."""
SCALES = np.geomspace(0.25, 4.0, 9)
LENGTHS = (0.5, 1.0, 2.0)
"""Of the map's own (median along the line)."""
KINDS = (
    lambda d: np.exp(-d),
    lambda d: (1.0 + 2.0 * d) * np.exp(-2.0 * d),
    lambda d: np.exp(-0.25 * math.pi * d**2),
)
CONSTANTS = (0.0, 0.5)
"""1-sigma of an unknown constant, shares of the field's spread."""
WIDE = 0.1, 5.0
REACH, FIRST, FINE = 3.3, 0.1, 0.5
"""Half-width of the grid and first cells in prior 1-sigmas; last cells in those of the result."""
DEPTH, LEVELS = 20.0, 6


def reference_row(line: Line, field_map: FieldMap, sigma: float, shift: Shift, away: float) -> Row:
    """Return the row of a line whose positions are off by a shift, from a prior of `away` (m)."""
    mean, covariance = posterior(line, field_map, sigma, shift, away)
    prior = away**2 * np.eye(2)
    place, spread = measurement_only(mean, covariance, prior)
    if np.linalg.eigvalsh(spread)[-1] > away**2:
        return {"line": line.name, "reason": "wider than the prior"}
    return figures_of(line.name, place - np.array(shift), spread)


def posterior(
    line: Line, field_map: FieldMap, sigma: float, shift: Shift, away: float
) -> tuple[Array, Array]:
    """Return mean (2,) and covariance (2, 2) of the error of the line's positions, m."""
    line = line.part(slice(None, None, math.ceil(line.value.size / READINGS)))
    track = line.track(sigma, shift)
    keep = np.isfinite(track.value)
    level, slope = track.value - track.offset, track.jacobian(field_map.quantity)[:, 0]
    level, slope, latitude, longitude = (
        one[keep] for one in (level, slope, track.latitude, track.longitude)
    )
    north, east = metres_per_radian(latitude)
    usual, spread = float(np.nanmean(field_map.values)), float(np.nanstd(field_map.values))
    factors = _factors(line, field_map, sigma, latitude, longitude, spread)
    size, count = FIRST * away, math.ceil(REACH / FIRST)
    cells = np.stack(np.meshgrid(*2 * [np.arange(-count, count + 1)], indexing="ij"), axis=-1)
    cells = cells.reshape(-1, 2)
    for _ in range(LEVELS):
        x = cells * size
        places = latitude - x[:, :1] / north, longitude - x[:, 1:] / east
        value, deviation = field_map.value(*places), np.asarray(field_map.sigma_at(*places))
        known = np.isfinite(value) & np.isfinite(deviation)
        deviation = np.maximum(np.where(known, deviation, spread), 1e-3 * spread)
        error = level - np.where(known, value, usual) - slope * x[:, :1]
        log = _log_density(error / deviation, factors) - np.log(deviation).sum(axis=1)
        log -= 0.5 * (x**2).sum(axis=1) / away**2
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        mean = weight @ x
        covariance = (weight[:, None] * (x - mean)).T @ (x - mean) + size**2 / 12.0 * np.eye(2)
        if size < FINE * math.sqrt(np.linalg.eigvalsh(covariance)[0]):
            break
        fan = np.stack(np.meshgrid(*2 * [np.arange(-1, 2)], indexing="ij"), axis=-1)
        cells = (3 * cells[log > log.max() - DEPTH][:, None] + fan.reshape(-1, 2)).reshape(-1, 2)
        size /= 3.0
    return mean, covariance


def _factors(
    line: Line,
    field_map: FieldMap,
    sigma: float,
    latitude: Array,
    longitude: Array,
    spread: float,
) -> list[Array]:
    """Return L⁻¹, (n, n) each, of all models of e."""
    apart = displacements(latitude, longitude)
    metres = np.hypot(apart[..., 0], apart[..., 1])
    where = line.latitude, line.longitude
    usual = field_map.correlation_length or math.nan
    lengths = mean_length(field_map.error_ellipse_at(*where))
    length = float(np.nanmedian(np.where(np.isfinite(lengths), lengths, usual)))
    typical = float(np.nanmedian(field_map.sigma_at(*where)))
    white = (sigma / typical) ** 2 * np.eye(len(metres))
    factors = []
    for scale, part, kind, constant in product(SCALES, LENGTHS, KINDS, CONSTANTS):
        C = kind(metres / (part * length))
        R = scale**2 * C + white + (constant * spread / typical) ** 2
        R[np.diag_indices(len(R))] += 0.01 * scale**2
        factors.append(np.linalg.inv(np.linalg.cholesky(R)))
    return factors


def _log_density(error: Array, factors: list[Array]) -> Array:
    """Return (C,) log of the mean density of normalised errors (C, n) by all models."""
    share, wider = WIDE
    total = np.full(len(error), -np.inf)
    for factor in factors:
        half = -0.5 * (error @ factor.T) ** 2
        heavy = np.log((1.0 - share) * np.exp(half * (1.0 - wider**-2)) + share / wider)
        heavy += half / wider**2
        both = np.logaddexp(half.sum(axis=1), heavy.sum(axis=1))
        total = np.logaddexp(total, both + np.log(np.diag(factor)).sum())
    return total
