"""The numbers of the page, as its script takes them: written into the page, and sent anew while a
run is watched."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from isogal.arrays import Array
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.figures.style import FieldScale
from isogal.evaluation.integrity import level_of
from isogal.evaluation.records import RunDetail, Runs
from isogal.evaluation.results import finite
from isogal.evaluation.view.projection import Projection
from isogal.evaluation.view.record import Event, ViewedRun
from isogal.files import Json

MOST_STATES = 6000
"""States that a page shows at most; of more, evenly some."""
MOST_CANDIDATES = 400
"""Of a batch at most: those of the greatest weight."""
AGAIN = 60.0
"""s after which the same words are shown again."""
_OF_TRUTH = ("error", "north", "east", "nees", "unaided")
"""Columns that nobody knows without the truth."""


_NOTHING = RunDetail(*(np.empty(0),) * 4, **RunDetail.flatten([]))
"""Of a record without detail."""

Column = Sequence[float | str | None]
Table = dict[str, Column]
"""Columns by name."""
_DIGITS = {"t": 7, "latitude": 9, "longitude": 9, "east_scale": 6, "north_scale": 6,
           "weight": 3, "difference": 4}  # fmt: skip
"""Significant ones; of places on the map there are eight, of others five."""


def payload(viewed: ViewedRun, projection: Projection, scale: FieldScale) -> dict[str, Json]:
    """Return the numbers: lists, with None where a number is not known.

    Lengths on the map are in km, errors in m, times in hours since the start; covariances are
    given as north-north, north-east, east-east, m²."""
    return {
        "is_true": viewed.is_true,
        "states": _states(viewed, projection),
        "batches": _batches(viewed, projection),
        "candidates": _candidates(viewed.runs, projection),
        "readings": _readings(viewed, scale),
        "events": _events(viewed),
        "aids": _aids(viewed),
        "missing": viewed.missing,
    }


def _places(
    projection: Projection, latitude: Array, longitude: Array, **errors: Array
) -> dict[str, Array]:
    """Return the columns of true places (K,) on the map, and of those that errors (K, 2) lead to
    from there, by prefixes of theirs."""
    x, y = projection(latitude, longitude)
    east, north = projection.stretch(latitude)
    found = {"x": x, "y": y, "east_scale": east, "north_scale": north}
    for prefix, error in errors.items():
        found[f"{prefix}_x"], found[f"{prefix}_y"] = (
            x + east * error[:, 1],
            y + north * error[:, 0],
        )
    return found


def _covariances(covariance: Array, prefix: str = "") -> dict[str, Array]:
    entries = {"nn": (0, 0), "ne": (0, 1), "ee": (1, 1)}
    return {prefix + name: covariance[:, i, j] for name, (i, j) in entries.items()}


def _states(viewed: ViewedRun, projection: Projection) -> Table:
    runs = viewed.runs
    error, covariance, unaided = runs.error[0], runs.covariance[0], runs.unaided_error[0]
    columns = {
        "t": runs.elapsed / 3600.0,
        "latitude": np.degrees(runs.latitude),
        "longitude": np.degrees(runs.longitude),
        **_places(projection, runs.latitude, runs.longitude, aided=error, unaided=unaided),
        "north": error[:, 0],
        "east": error[:, 1],
        "error": runs.horizontal_error[0],
        "unaided": runs.unaided_horizontal_error[0],
        **_covariances(covariance),
        "level": level_of(runs, viewed.assumed.integrity)[0],
        "nees": nees_per_axis(error, covariance),
    }
    if not viewed.is_true:
        columns |= {name: np.full(runs.time.size, np.nan) for name in _OF_TRUTH}
    kept = slice(None, None, -(-runs.time.size // MOST_STATES))
    return _table({name: column[kept] for name, column in columns.items()})


def _batches(viewed: ViewedRun, projection: Projection) -> Table:
    """Fixes, and the navigator right after each batch."""
    runs = viewed.runs
    fix, after = runs.fix_error[0], runs.posterior_error[0]
    places = _places(projection, *runs.fix_place, fix=fix, after=after)
    places |= {"x": places.pop("fix_x"), "y": places.pop("fix_y")}  # shown are those of the fixes
    nees = nees_per_axis(after, runs.posterior_covariance[0])
    return {
        **_table(
            {
                "t": (runs.fix_time - runs.time[0]) / 3600.0,
                **places,
                "north": fix[:, 0],
                "east": fix[:, 1],
                "nees": nees if viewed.is_true else np.full_like(nees, np.nan),
                **_covariances(runs.fix_covariance[0]),
                **_covariances(runs.posterior_covariance[0], "after_"),
            }
        ),
        "reason": [reason or None for reason in runs.fix_reason[0].tolist()],
    }


def _candidates(runs: Runs, projection: Projection) -> list[Table]:
    """Candidates of each batch, of all its scans."""
    detail = runs.detail or _NOTHING
    x, y = projection(detail.candidate_latitude, detail.candidate_longitude)
    weight = detail.candidate_weight
    found = []
    for batch in range(runs.fix_time.size):
        mine = np.flatnonzero(detail.candidate_batch == batch)
        mine = mine[np.argsort(-weight[mine], kind="stable")[:MOST_CANDIDATES]]
        found.append(_table({"x": x[mine], "y": y[mine], "weight": weight[mine]}))
    return found


def _readings(viewed: ViewedRun, scale: FieldScale) -> Table:
    detail, start = viewed.runs.detail or _NOTHING, viewed.runs.time[0]
    reading, navigator = scale(detail.reading), scale(detail.map_value_navigator)
    true = detail.map_value if viewed.is_true else np.full_like(detail.map_value, np.nan)
    columns = {
        "t": (detail.scan_time - start) / 3600.0,
        "reading": reading,
        "truth": scale(true),
        "navigator": navigator,
        "difference": reading - navigator,
    }
    kept = slice(None, None, max(1, -(-detail.scan_time.size // MOST_STATES)))
    return _table({name: column[kept] for name, column in columns.items()})


def _events(viewed: ViewedRun) -> Table:
    """What nodes said; of the same words again and again, the first and how often."""
    start = viewed.runs.time[0]
    first: list[Event] = []
    times: list[int] = []
    last: dict[tuple[str, str, str], tuple[int, float]] = {}
    for event in viewed.events or ():
        key = (event.level, event.source, event.text)
        row, before = last.get(key, (0, -math.inf))
        if event.time - before <= AGAIN:
            times[row] += 1
        else:
            row = len(first)
            first.append(event)
            times.append(1)
        last[key] = row, event.time
    return {
        "t": [float(f"{(event.time - start) / 3600.0:.5f}") for event in first],
        "level": [event.level for event in first],
        "source": [event.source for event in first],
        "text": [event.text for event in first],
        "times": times,
    }


def _aids(viewed: ViewedRun) -> Table:
    """When each aid was used, one row for each time and aid."""
    start, uses = viewed.runs.time[0], viewed.aids
    return {
        "aid": [one.aid for one in uses],
        "begin": [float(f"{(one.begin - start) / 3600.0:.5f}") for one in uses],
        "end": [float(f"{(one.end - start) / 3600.0:.5f}") for one in uses],
        "used": [float(one.used) for one in uses],
        "text": [one.text for one in uses],
    }


def _table(columns: Mapping[str, Array]) -> Table:
    """Return columns of numbers of so many significant digits as `_DIGITS` says; None for what is
    not finite."""
    found: Table = {}
    for name, column in columns.items():
        digits = _DIGITS.get(name, 8 if name.endswith(("x", "y")) else 5)
        rounded = (float(f"{value:.{digits}g}") for value in column.tolist())
        found[name] = [finite(value) for value in rounded]
    return found
