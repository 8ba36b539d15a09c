"""The numbers of the page, as its script takes them: written into the page, and sent anew while a
run is watched."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.plane import Plane
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.figures.style import FieldScale
from isogal.evaluation.integrity import level_of
from isogal.evaluation.records import RunDetail, Runs
from isogal.evaluation.results import finite
from isogal.evaluation.view.record import Event, ViewedRun
from isogal.files import Json

MOST_STATES = 6000
"""States, and readings, that a page shows at most; of more, evenly some."""
MOST_CANDIDATES = 400
"""Of a batch at most: those of the greatest weight."""
AGAIN = 60.0
"""s after which the same words are shown again."""
_NOTHING = RunDetail(*(np.empty(0),) * 4, **RunDetail.flatten([]))
"""Of a record without detail."""

Table = dict[str, Sequence[float | str | None]]
"""Columns by name."""


def payload(viewed: ViewedRun, plane: Plane, scale: FieldScale) -> dict[str, Json]:
    """Return the numbers: lists, with None where a number is not known.

    Lengths on the map are in km, errors in m, times in hours since the start; covariances are
    given as north-north, north-east, east-east, m²."""
    runs, start, aids = viewed.runs, viewed.runs.time[0], viewed.aids
    begin, end = ([getattr(one, name) for one in aids] for name in ("begin", "end"))
    return {
        "is_true": viewed.is_true,
        "states": _states(viewed, plane),
        "batches": _batches(viewed, plane)
        | {"reason": [reason or None for reason in runs.fix_reason[0].tolist()]},
        "candidates": _candidates(runs, plane),
        "readings": _readings(viewed, scale),
        "events": _events(viewed.events or (), start),
        "aids": {
            "aid": [one.aid for one in aids],
            **_table(1, begin=(np.array(begin) - start) / 3600.0),
            **_table(1, end=(np.array(end) - start) / 3600.0),
            "used": [float(one.used) for one in aids],
            "text": [one.text for one in aids],
        },
        "missing": viewed.missing,
    }


def _places(plane: Plane, latitude: Array, longitude: Array, **errors: Array) -> dict[str, Array]:
    """Return the columns of true places (K,) on the map, and of those that errors (K, 2) lead to
    from there, by prefixes of theirs."""
    places, scale = in_km(plane, latitude, longitude), 1e-3 * np.array([plane.east, plane.north])
    scale = scale / np.stack(metres_per_radian(latitude)[::-1], axis=-1)  # km on the map per m
    found = dict(zip(("x", "y", "east_scale", "north_scale"), (*places.T, *scale.T), strict=True))
    for prefix, error in errors.items():
        found[f"{prefix}_x"], found[f"{prefix}_y"] = (places + scale * error[:, ::-1]).T
    return found


def in_km(plane: Plane, latitude: ArrayLike, longitude: ArrayLike) -> Array:
    """Return km east and north (..., 2) of places in rad, as the maps of the page have them."""
    return 1e-3 * plane.metres(latitude, longitude)[..., ::-1]


def _covariances(covariance: Array, prefix: str = "") -> dict[str, Array]:
    entries = {"nn": (0, 0), "ne": (0, 1), "ee": (1, 1)}
    return {prefix + name: covariance[:, i, j] for name, (i, j) in entries.items()}


def _states(viewed: ViewedRun, plane: Plane) -> Table:
    runs = viewed.runs
    error, covariance, unaided = runs.error[0], runs.covariance[0], runs.unaided_error[0]
    of_truth = {
        "north": error[:, 0],
        "east": error[:, 1],
        "error": runs.horizontal_error[0],
        "unaided": runs.unaided_horizontal_error[0],
        "nees": nees_per_axis(error, covariance),
    }
    if not viewed.is_true:
        of_truth = dict.fromkeys(of_truth, np.full(runs.time.size, np.nan))
    return _table(
        _every(runs.time),
        t=runs.elapsed / 3600.0,
        latitude=np.degrees(runs.latitude),
        longitude=np.degrees(runs.longitude),
        **_places(plane, runs.latitude, runs.longitude, aided=error, unaided=unaided),
        **of_truth,
        **_covariances(covariance),
        level=level_of(runs, viewed.assumed.integrity)[0],
    )


def _batches(viewed: ViewedRun, plane: Plane) -> Table:
    """Fixes, and the navigator right after each batch."""
    runs = viewed.runs
    fix, after = runs.fix_error[0], runs.posterior_error[0]
    places = _places(plane, *runs.fix_place, fix=fix, after=after)
    places |= {"x": places.pop("fix_x"), "y": places.pop("fix_y")}  # shown are those of the fixes
    nees = nees_per_axis(after, runs.posterior_covariance[0])
    return _table(
        1,
        t=(runs.fix_time - runs.time[0]) / 3600.0,
        **places,
        north=fix[:, 0],
        east=fix[:, 1],
        nees=nees if viewed.is_true else np.full_like(nees, np.nan),
        **_covariances(runs.fix_covariance[0]),
        **_covariances(runs.posterior_covariance[0], "after_"),
    )


def _candidates(runs: Runs, plane: Plane) -> list[Table]:
    """Candidates of each batch, of all its scans."""
    detail = runs.detail or _NOTHING
    x, y = in_km(plane, detail.candidate_latitude, detail.candidate_longitude).T
    weight = detail.candidate_weight
    found = []
    for batch in range(runs.fix_time.size):
        mine = np.flatnonzero(detail.candidate_batch == batch)
        mine = mine[np.argsort(-weight[mine], kind="stable")[:MOST_CANDIDATES]]
        found.append(_table(1, x=x[mine], y=y[mine], weight=weight[mine]))
    return found


def _readings(viewed: ViewedRun, scale: FieldScale) -> Table:
    detail = viewed.runs.detail or _NOTHING
    true = detail.map_value if viewed.is_true else np.full_like(detail.map_value, np.nan)
    return _table(
        _every(detail.scan_time),
        t=(detail.scan_time - viewed.runs.time[0]) / 3600.0,
        reading=scale(detail.reading),
        truth=scale(true),
        navigator=scale(detail.map_value_navigator),
        difference=(detail.reading - detail.map_value_navigator) / scale.unit,
    )


def _events(events: Sequence[Event], start: float) -> Table:
    """What nodes said; of the same words again and again, the first and how often."""
    first: list[Event] = []
    times: list[int] = []
    last: dict[tuple[str, str, str], tuple[int, float]] = {}
    for event in events:
        key = (event.level, event.source, event.text)
        row, before = last.get(key, (0, -math.inf))
        if event.time - before > AGAIN:
            row = len(first)
            first.append(event)
            times.append(0)
        times[row] += 1
        last[key] = row, event.time
    return {
        **_table(1, t=(np.array([event.time for event in first]) - start) / 3600.0),
        "level": [event.level for event in first],
        "source": [event.source for event in first],
        "text": [event.text for event in first],
        "times": times,
    }


def _every(rows: Array) -> int:
    return max(1, -(-rows.size // MOST_STATES))


def _table(every: int, /, **columns: Array) -> Table:
    """Return every so many-th number of columns with nine significant digits, None for what is not
    finite."""
    return {
        name: [finite(float(f"{value:.9g}")) for value in column[::every].tolist()]
        for name, column in columns.items()
    }
