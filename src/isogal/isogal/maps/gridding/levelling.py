"""Survey lines where they cross: how far their readings differ, and an offset for each line that
lets them differ least."""

from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.maps.gridding.reduction import huber_weights
from isogal.maps.gridding.survey import Survey

_LONGEST_GAP = 10.0
"""Median gaps between readings; where readings are further apart no crossing is taken."""
_RIDGES = np.geomspace(1e-3, 1e3, 13)
"""Variances of a difference over that of an offset."""
_FAR, _ROUNDS = 2.0, 4
"""1-sigmas from which a difference counts less, and rounds of reweighting."""


@dataclass(frozen=True, slots=True, eq=False)
class CrossOvers:
    """C places where two lines cross."""

    first: Integers
    """(C,) number of a line."""
    second: Integers
    difference: Array
    """(C,) first less second, interpolated along each."""

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
    places = survey.places[:, :2]
    numbers = np.unique(survey.line)
    tracks = [_ordered(places[survey.line == n], survey.value[survey.line == n]) for n in numbers]
    gaps = np.concatenate([np.hypot(*np.diff(place, axis=0).T) for place, _ in tracks])
    longest = _LONGEST_GAP * max(float(np.median(gaps)), 1.0) if gaps.size else 0.0
    found = [
        (int(one), int(other), difference)
        for (one, a), (other, b) in combinations(zip(numbers, tracks, strict=True), 2)
        for difference in _crossings(a, b, longest)
    ]
    table = np.array(found).reshape(-1, 3)
    ids = table[:, :2].astype(np.int64)
    return CrossOvers(ids[:, 0], ids[:, 1], table[:, 2])


class _Fit(NamedTuple):
    """An offset of each line, from the differences at crossings."""

    offset: Array
    """(L,) of lines in the order of their numbers."""
    left: Array
    """(C,) differences that the offsets leave."""
    predicted: Array
    """(C,) differences that offsets by the other crossings alone leave."""
    degrees: float
    """Of freedom that the differences keep: C less what the offsets take up."""


def levelled(survey: Survey, crossings: CrossOvers) -> tuple[Survey, dict[str, float]]:
    """Return a survey without the offsets of lines that make the differences at crossings least,
    what is left of these, and how much of that is fit alone: robust least squares with a ridge,
    the one with which each crossing is predicted best from the others (Allen 1974, Technometrics
    16(1):125-127).

    Raises
    ------
    InputError
        No two lines cross.
    """
    difference = crossings.difference
    if not difference.size or survey.line is None:
        raise InputError(f"{survey.where}: no two lines cross; it cannot be levelled")
    numbers, own = np.unique(survey.line, return_inverse=True)
    rows = np.arange(difference.size)
    design = np.zeros((rows.size, numbers.size))
    design[rows, np.searchsorted(numbers, crossings.first)] = 1.0
    design[rows, np.searchsorted(numbers, crossings.second)] -= 1.0
    fits = [_fitted(design, difference, ridge) for ridge in _RIDGES]
    best = min(fits, key=lambda fit: float(np.mean(np.abs(fit.predicted))))
    figures = {
        "degrees_of_freedom": best.degrees,
        "rms": float(np.sqrt(np.mean(best.left**2))),
        "rms_left_out": float(np.sqrt(np.mean(best.predicted**2))),
    }
    return replace(survey, value=survey.value - best.offset[own]), figures


def _fitted(design: Array, difference: Array, ridge: float) -> _Fit:
    """Return offsets with a ridge; differences far off, as at steep anomalies, count less."""
    weight: Array = np.ones(len(difference))
    for _ in range(_ROUNDS):
        inverse = np.linalg.inv(
            design.T @ (weight[:, None] * design) + ridge * np.eye(design.shape[1])
        )
        offset = inverse @ (design.T @ (weight * difference))
        left = difference - design @ offset
        own = weight * np.einsum("ci,ij,cj->c", design, inverse, design)
        weight = huber_weights(left, _FAR)
    return _Fit(offset, left, left / (1.0 - own), len(difference) - float(own.sum()))


def _ordered(places: Array, value: Array) -> tuple[Array, Array]:
    """Return the readings of a line in the order along it."""
    if len(places) < 2:
        return places, value
    centred = places - places.mean(axis=0)
    along = centred @ np.linalg.eigh(centred.T @ centred)[1][:, -1]
    order = np.argsort(along, kind="stable")
    return places[order], value[order]


def _crossings(
    one: tuple[Array, Array], other: tuple[Array, Array], longest: float
) -> list[float]:
    """Return the differences of the value where two lines cross."""
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
    i, j = np.nonzero(hit)
    first = a[i] + t[i, j] * (a[i + 1] - a[i])
    second = b[j] + u[i, j] * (b[j + 1] - b[j])
    return [float(one) for one in first - second]
