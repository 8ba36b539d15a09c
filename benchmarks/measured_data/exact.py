"""The held-out lines of Scotland and how errors hold together: as maps say it, and with all that
kriging knows, its mean and the whole covariance of its errors among readings, at each shift."""

import math
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.error_ellipses import ellipses_of, joint, mean_length
from isogal.maps.error_model import displacements
from isogal.maps.field_map import FieldMap
from isogal.maps.gridding.gridder import GridSettings, Model, grid_survey
from isogal.maps.gridding.reading import read_survey
from measured_data.lines import Line, scotland
from measured_data.matches import AWAY
from measured_data.untold import MAGNETIC_SIGMA

ROWS = 170
"""Readings of a line, every so many-th."""
STEP, REACH = 500.0, 4500.0
"""m, of the grid of shifts."""
SCALES = np.geomspace(0.4, 2.5, 9)
"""Factors on the map's sigma, the likeliest of which counts."""


def study_exact(data: Path) -> dict[str, dict[str, float | list[float]]]:
    """Return what each line shows at its true place (`shapes`), and of each flight line the
    likeliest place (m north, east of the true one), how much more likely it is, and what share of
    the places are more likely than the true one."""
    survey = read_survey(data / "scotland_magnetic_survey.nc", "magnetic_anomaly")
    field_map, model = grid_survey(survey, GridSettings())
    axis = np.arange(-REACH, REACH + 1.0, STEP)
    shifts = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    _, flights, ties = scotland(data)
    result = {line.name: shapes(field_map, model, line) for line in (*flights, *ties)}
    for line in flights:
        found = np.array([log_likelihood(model, line, shift) for shift in shifts])
        found -= 0.5 * (shifts**2).sum(axis=1) / AWAY**2
        true = found[np.flatnonzero(~shifts.any(axis=1))[0]]
        best = int(np.argmax(found))
        result[line.name] |= {
            "best_m": shifts[best].tolist(),
            "more_likely": float(found[best] - true),
            "places_above": float((found > true).mean()),
        }
    return result


def shapes(field_map: FieldMap, model: Model, line: Line) -> dict[str, float]:
    """Return the log-likelihoods of the map's errors along a line by several correlations, less
    that by exp(-d / L) with the map's L there (median)."""
    error = line.value - field_map.value(line.latitude, line.longitude)
    known = np.flatnonzero(np.isfinite(error))
    known = known[:: math.ceil(known.size / ROWS)]
    at = line.latitude[known], line.longitude[known]
    ellipses, sigma = field_map.error_ellipse_at(*at), field_map.sigma_at(*at)
    length = mean_length(ellipses)
    apart = displacements(*at)
    usual, metres = float(np.median(length)), np.hypot(apart[..., 0], apart[..., 1])
    _, posterior = model.kriging.together(model.places(*at))
    deviation = np.sqrt(np.diag(posterior))
    directed, alike = joint(apart, ellipses)
    round_ones = ellipses_of(length, length, np.zeros(known.size))
    alone, alike_alone = joint(apart, round_ones)
    kinds = {f"exp, {f:g} L": np.exp(-metres / usual / f) for f in (0.5, 1.0, 2.0, 4.0, 8.0)}
    kinds |= {
        "smooth, L": alike_alone * smooth(alone),
        "smooth, ellipses": alike * smooth(directed),
        "smooth, half of the ellipses": alike * smooth(2.0 * directed),
        "kriging": posterior / np.outer(deviation, deviation),
    }
    white = MAGNETIC_SIGMA**2 * np.eye(known.size)
    found = {
        kind: max(
            _log_density(error[known], np.outer(s * sigma, s * sigma) * shape + white)
            for s in SCALES
        )
        for kind, shape in kinds.items()
    }
    return {kind: one - found["exp, 1 L"] for kind, one in found.items()}


def smooth(distance: Array) -> Array:
    """Return the correlation of errors that are smooth over a length of 1 / sqrt(2) (Matern 3/2;
    Rasmussen & Williams 2006, eq. 4.17), a hundredth of their variance left over."""
    a = math.sqrt(6.0) * distance
    return 0.99 * (1.0 + a) * np.exp(-a) + 0.01 * np.eye(len(distance))


def log_likelihood(model: Model, line: Line, shift: Array) -> float:
    """Return log p of a line's readings if they were taken a shift (m north, east) from their
    places."""
    rows = slice(None, None, math.ceil(line.value.size / ROWS))
    latitude, longitude = line.latitude[rows], line.longitude[rows]
    north, east = metres_per_radian(latitude)
    places = model.places(latitude + shift[0] / north, longitude + shift[1] / east)
    mean, covariance = model.kriging.together(places)
    share = np.diag(covariance) / model.covariance.variance_at(places)
    level = np.sqrt(model.amplitude.at(places, share))
    covariance = covariance * np.outer(level, level) + model.covariance.line**2
    covariance[np.diag_indices(len(places))] += model.covariance.noise**2
    return _log_density(line.value[rows] - mean - model.trend.at(places), covariance)


def _log_density(error: Array, covariance: Array) -> float:
    """Return the log density of errors, without its constant."""
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, error)
    return float(-0.5 * white @ white - np.log(np.diag(factor)).sum())
