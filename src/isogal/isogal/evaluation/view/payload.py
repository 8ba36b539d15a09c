"""The numbers of the page, as its script takes them: written into the page, and sent anew while a
run is watched."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.figures.style import FieldScale
from isogal.evaluation.integrity import Solution
from isogal.evaluation.records import Runs
from isogal.evaluation.view.projection import Projection
from isogal.evaluation.view.record import ViewedRun

MOST_STATES = 6000
"""States that a page shows at most; of more, evenly some."""
MOST_CANDIDATES = 400
"""Of a batch at most: those of the greatest weight."""
_OF_TRUTH = ("error", "north", "east", "nees", "unaided")
"""Columns that nobody knows without the truth."""


def payload(viewed: ViewedRun, projection: Projection, scale: FieldScale) -> dict[str, Any]:
    """Return the numbers: lists, with None where a number is not known.

    Lengths on the map are in km, errors in m, times in hours since the start; covariances are
    given as north-north, north-east, east-east, m²."""
    runs = viewed.runs
    kept = slice(None, None, -(-runs.time.size // MOST_STATES))
    return {
        "is_true": viewed.is_true,
        "states": _states(viewed, projection, kept),
        "batches": _batches(viewed, projection),
        "candidates": _candidates(runs, projection),
        "readings": _readings(viewed, scale),
        "events": _events(viewed),
        "missing": viewed.missing,
    }


def _states(viewed: ViewedRun, projection: Projection, kept: slice) -> dict[str, Any]:
    runs = viewed.runs
    error, covariance = runs.error[0], runs.covariance[0]
    unaided = runs.unaided_error[0]
    x, y = projection(runs.latitude, runs.longitude)
    east, north = projection.stretch(runs.latitude)
    level = Solution.of(runs).level(viewed.scenario.integrity)[0]
    columns = {
        "t": _numbers(runs.elapsed / 3600.0, 7),
        "latitude": _numbers(np.degrees(runs.latitude), 9),
        "longitude": _numbers(np.degrees(runs.longitude), 9),
        "x": _numbers(x, 8),
        "y": _numbers(y, 8),
        "east_scale": _numbers(east, 6),
        "north_scale": _numbers(north, 6),
        "aided_x": _numbers(x + east * error[:, 1], 8),
        "aided_y": _numbers(y + north * error[:, 0], 8),
        "unaided_x": _numbers(x + east * unaided[:, 1], 8),
        "unaided_y": _numbers(y + north * unaided[:, 0], 8),
        "north": _numbers(error[:, 0]),
        "east": _numbers(error[:, 1]),
        "error": _numbers(runs.horizontal_error[0]),
        "unaided": _numbers(runs.unaided_horizontal_error[0]),
        "nn": _numbers(covariance[:, 0, 0]),
        "ne": _numbers(covariance[:, 0, 1]),
        "ee": _numbers(covariance[:, 1, 1]),
        "level": _numbers(level),
        "nees": _numbers(nees_per_axis(error, covariance)),
    }
    if not viewed.is_true:
        columns |= {name: [None] * runs.time.size for name in _OF_TRUTH}
    return {name: column[kept] for name, column in columns.items()}


def _batches(viewed: ViewedRun, projection: Projection) -> dict[str, Any]:
    """Fixes, and the navigator right after each batch."""
    runs = viewed.runs
    latitude = np.interp(runs.fix_time, runs.time, runs.latitude)
    longitude = np.interp(runs.fix_time, runs.time, np.unwrap(runs.longitude))
    x, y = projection(latitude, longitude)
    east, north = projection.stretch(latitude)
    fix, after = runs.fix_error[0], runs.posterior_error[0]
    columns: dict[str, Any] = {
        "t": _numbers((runs.fix_time - runs.time[0]) / 3600.0, 7),
        "x": _numbers(x + east * fix[:, 1], 8),
        "y": _numbers(y + north * fix[:, 0], 8),
        "after_x": _numbers(x + east * after[:, 1], 8),
        "after_y": _numbers(y + north * after[:, 0], 8),
        "east_scale": _numbers(east, 6),
        "north_scale": _numbers(north, 6),
        "north": _numbers(fix[:, 0]),
        "east": _numbers(fix[:, 1]),
        "nees": _numbers(nees_per_axis(after, runs.posterior_covariance[0])),
        "milliseconds": _numbers(1e3 * runs.fix_seconds[0], 3),
        "reason": [reason or None for reason in runs.fix_reason[0].tolist()],
    }
    for name, values in (("", runs.fix_covariance[0]), ("after_", runs.posterior_covariance[0])):
        for suffix, (i, j) in (("nn", (0, 0)), ("ne", (0, 1)), ("ee", (1, 1))):
            columns[name + suffix] = _numbers(values[:, i, j])
    if not viewed.is_true:
        columns["nees"] = [None] * runs.fix_time.size
    return columns


def _candidates(runs: Runs, projection: Projection) -> list[dict[str, Any]]:
    """Candidates of each batch, of all its scans."""
    detail = runs.detail
    if detail is None:
        return [{"x": [], "y": [], "weight": [], "scan": []} for _ in runs.fix_time]
    x, y = projection(detail.candidate_latitude, detail.candidate_longitude)
    found = []
    for batch in range(runs.fix_time.size):
        mine = np.flatnonzero(detail.candidate_batch == batch)
        mine = mine[np.argsort(-detail.candidate_weight[mine], kind="stable")[:MOST_CANDIDATES]]
        found.append(
            {
                "x": _numbers(x[mine], 8),
                "y": _numbers(y[mine], 8),
                "weight": _numbers(detail.candidate_weight[mine], 3),
                "scan": detail.candidate_scan[mine].tolist(),
            }
        )
    return found


def _readings(viewed: ViewedRun, scale: FieldScale) -> dict[str, Any]:
    detail, start = viewed.runs.detail, viewed.runs.time[0]
    if detail is None:
        return {"t": [], "reading": [], "truth": [], "navigator": [], "difference": []}
    reading = scale(detail.reading)
    true = detail.map_value if viewed.is_true else np.full_like(detail.map_value, np.nan)
    kept = slice(None, None, -(-detail.scan_time.size // MOST_STATES))
    columns = {
        "t": _numbers((detail.scan_time - start) / 3600.0, 7),
        "reading": _numbers(reading),
        "truth": _numbers(scale(true)),
        "navigator": _numbers(scale(detail.map_value_navigator)),
        "difference": _numbers(reading - scale(detail.map_value_navigator), 4),
    }
    return {name: column[kept] for name, column in columns.items()}


def _events(viewed: ViewedRun) -> dict[str, Any]:
    """What nodes said; of the same words again and again, the first and how often."""
    start = viewed.runs.time[0]
    rows: list[list[Any]] = []
    last: dict[tuple[str, str, str], int] = {}
    for event in viewed.events or ():
        key = (event.level, event.source, event.text)
        hours = float(f"{(event.time - start) / 3600.0:.5f}")
        if key in last and event.time - rows[last[key]][5] <= 60.0:
            rows[last[key]][4] += 1
            rows[last[key]][5] = event.time
        else:
            last[key] = len(rows)
            rows.append([hours, *key, 1, event.time])
    names = ("t", "level", "source", "text", "times")
    return {name: [row[i] for row in rows] for i, name in enumerate(names)}


def _numbers(values: ArrayLike, digits: int = 5) -> list[float | None]:
    """Return numbers of so many significant digits; None for what is not finite."""
    array: Array = np.asarray(values, dtype=np.float64)
    return [
        float(f"{value:.{digits}g}") if finite else None
        for value, finite in zip(array.tolist(), np.isfinite(array).tolist(), strict=True)
    ]
