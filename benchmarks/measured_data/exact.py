"""The held-out flight lines of Scotland with all that kriging knows: not a map, but at each shift
its mean and the whole covariance of its errors among the readings."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.gridding.gridder import GridSettings, Model, learn_model
from isogal.maps.gridding.reading import read_survey
from measured_data.lines import Line, scotland
from measured_data.matches import AWAY

ROWS = 170
"""Readings of a line, every so many-th."""
STEP, REACH = 500.0, 4500.0
"""m, of the grid of shifts."""


def study_exact(data: Path) -> dict[str, Any]:
    """Return of each flight line the likeliest place (m north, east of the true one), how much
    more likely it is, and what share of the places are more likely than the true one."""
    survey = read_survey(data / "scotland_magnetic_survey.nc", "magnetic_anomaly")
    model = learn_model(survey, GridSettings())
    axis = np.arange(-REACH, REACH + 1.0, STEP)
    shifts = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    result = {}
    for line in scotland(data)[1]:
        found = np.array([log_likelihood(model, line, shift) for shift in shifts])
        found -= 0.5 * (shifts**2).sum(axis=1) / AWAY**2
        true = found[np.flatnonzero(~shifts.any(axis=1))[0]]
        best = int(np.argmax(found))
        result[line.name] = {
            "best_m": shifts[best].tolist(),
            "more_likely": float(found[best] - true),
            "places_above": float((found > true).mean()),
        }
    return result


def log_likelihood(model: Model, line: Line, shift: Array) -> float:
    """Return log p of a line's readings if they were taken a shift (m north, east) from their
    places."""
    rows = slice(None, None, math.ceil(line.value.size / ROWS))
    latitude, longitude = line.latitude[rows], line.longitude[rows]
    north, east = metres_per_radian(latitude)
    places = model.places(latitude + shift[0] / north, longitude + shift[1] / east)
    mean, covariance = model.kriging.together(places)
    level = np.sqrt(model.amplitude.at(places))
    covariance = covariance * np.outer(level, level) + model.covariance.line**2
    covariance[np.diag_indices(len(places))] += model.covariance.noise**2
    factor = np.linalg.cholesky(covariance)
    white = np.linalg.solve(factor, line.value[rows] - mean - model.trend.at(places))
    return float(-0.5 * white @ white - np.log(np.diag(factor)).sum())
