"""Survey lines where they cross: how far their readings differ, and an offset for each line that
lets them differ least."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.maps.gridding.survey import Plane, Survey

_LONGEST_GAP = 10.0
"""Median gaps between readings; where readings are further apart no crossing is taken."""


@dataclass(frozen=True, slots=True, eq=False)
class CrossOvers:
    """C places where two lines cross."""

    first: Integers
    """(C,) number of a line."""
    second: Integers
    difference: Array
    """(C,) first less second, interpolated along each."""
    height_difference: Array
    """(C,) m; NaN where the survey has no heights."""

    def figures(self) -> dict[str, float | int]:
        """Return how many there are and how large the differences are."""
        if not self.difference.size:
            return {"count": 0}
        middle = float(np.median(self.difference))
        return {
            "count": int(self.difference.size),
            "rms": float(np.sqrt(np.mean(self.difference**2))),
            "median_absolute": float(np.median(np.abs(self.difference - middle))),
        }


def cross_overs(survey: Survey) -> CrossOvers:
    """Return where the lines of a survey cross each other."""
    if survey.line is None:
        raise InputError(f"{survey.where}: has no column line, so no lines that cross")
    places = Plane.of(survey.latitude, survey.longitude).points(survey)
    height = np.full(len(survey), np.nan) if survey.height is None else survey.height
    attributes = np.column_stack([survey.value, height])
    numbers = np.unique(survey.line)
    tracks = [_ordered(places[survey.line == n], attributes[survey.line == n]) for n in numbers]
    gaps = np.concatenate([np.hypot(*np.diff(place, axis=0).T) for place, _ in tracks])
    longest = _LONGEST_GAP * max(float(np.median(gaps)), 1.0) if gaps.size else 0.0
    found: list[tuple[int, int, float, float]] = []
    for i in range(len(tracks)):
        for j in range(i + 1, len(tracks)):
            for difference in _crossings(tracks[i], tracks[j], longest):
                found.append((int(numbers[i]), int(numbers[j]), *difference))
    table = np.array(found).reshape(-1, 4)
    ids = table[:, :2].astype(np.int64)
    return CrossOvers(ids[:, 0], ids[:, 1], table[:, 2], table[:, 3])


def levelled(survey: Survey, crossings: CrossOvers) -> Survey:
    """Return the survey with an offset taken off each line: those that make the differences at
    crossings least (least squares), all offsets together being kept small.

    Raises
    ------
    InputError
        No two lines cross.
    """
    if not crossings.difference.size or survey.line is None:
        raise InputError(f"{survey.where}: no two lines cross; it cannot be levelled")
    numbers = np.unique(survey.line)
    rows = np.arange(crossings.difference.size)
    design = np.zeros((rows.size, numbers.size))
    design[rows, np.searchsorted(numbers, crossings.first)] = 1.0
    design[rows, np.searchsorted(numbers, crossings.second)] -= 1.0
    weight: Any = np.ones(rows.size)
    offset = np.zeros(numbers.size)
    for _ in range(4):  # Huber weights: a few crossings at steep anomalies are far off
        normal = design.T @ (design * weight[:, None]) + 0.05 * np.eye(numbers.size)
        offset = np.linalg.solve(normal, design.T @ (weight * crossings.difference))
        left = np.abs(crossings.difference - design @ offset)
        usual = 2.0 * 1.4826 * float(np.median(left)) + 1e-300
        weight = np.minimum(1.0, usual / np.maximum(left, 1e-300))
    return replace(survey, value=survey.value - offset[np.searchsorted(numbers, survey.line)])


def _ordered(places: Array, attributes: Array) -> tuple[Array, Array]:
    """Return the readings of a line in the order along it."""
    if len(places) < 2:
        return places, attributes
    centred = places - places.mean(axis=0)
    along = centred @ np.linalg.eigh(centred.T @ centred)[1][:, -1]
    order = np.argsort(along, kind="stable")
    return places[order], attributes[order]


def _crossings(
    one: tuple[Array, Array], other: tuple[Array, Array], longest: float
) -> list[tuple[float, float]]:
    """Return the differences of value and height where two lines cross."""
    (p, a), (q, b) = one, other
    if len(p) < 2 or len(q) < 2:
        return []
    if (p.min(axis=0) > q.max(axis=0)).any() or (q.min(axis=0) > p.max(axis=0)).any():
        return []
    r, s = np.diff(p, axis=0), np.diff(q, axis=0)
    apart = q[None, :-1] - p[:-1, None]
    cross = r[:, None, 0] * s[None, :, 1] - r[:, None, 1] * s[None, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (apart[..., 0] * s[None, :, 1] - apart[..., 1] * s[None, :, 0]) / cross
        u = (apart[..., 0] * r[:, None, 1] - apart[..., 1] * r[:, None, 0]) / cross
    short = (np.hypot(*r.T) < longest)[:, None] & (np.hypot(*s.T) < longest)
    hit = (t >= 0.0) & (t < 1.0) & (u >= 0.0) & (u < 1.0) & short & (cross != 0.0)
    found = []
    for i, j in zip(*np.nonzero(hit), strict=True):
        first = a[i] + t[i, j] * (a[i + 1] - a[i])
        second = b[j] + u[i, j] * (b[j + 1] - b[j])
        found.append((float(first[0] - second[0]), float(first[1] - second[1])))
    return found
