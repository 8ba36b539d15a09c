"""The parameters of a covariance that make readings most likely (Rasmussen & Williams 2006, sec.
5.4), near each of some places of the survey and around it."""

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import count

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.maps.gridding.covariance import Covariance, Readings
from isogal.maps.gridding.misfit import misfit
from isogal.seeds import generator

_NEAR, _AROUND, _PLACES = 120, 150, 10
"""Readings next to a place, drawn from those around it, and places that parameters are learnt
from."""
_MOST_STEPS = 50


def learn(
    readings: Readings,
    *,
    kind: str = "matern",
    progress: Callable[[int, int], None] = lambda done, most: None,
) -> Covariance:
    """Return the covariance that makes readings most likely.

    Parameters
    ----------
    readings : Readings
    kind : str
        One of `covariance.KINDS`.
    progress : function
        Called with the number of steps that are done, and of all.

    Raises
    ------
    InputError
        Values that are all the same.
    """
    from scipy.optimize import minimize

    places, line = readings.places, readings.line
    if not (spread := readings.spread) > 0.0:
        raise InputError("the readings are all the same; there is no field to map")
    near = (readings.part(rows) for rows in _neighbourhoods(places))
    samples = [replace(one, value=one.value - one.value.mean()) for one in near]
    extent = float(np.hypot(*np.ptp(places[:, :2], axis=0)))
    lined = line is not None and np.unique(line).size > 1
    part, noise = math.log(spread / math.sqrt(2.0)), math.log(0.05 * spread)
    start = [part, math.log(extent / 50.0), part, math.log(extent / 8.0), noise]
    start += [math.log(0.03 * spread)] if lined else []
    bounds: list[tuple[float | None, float | None]] = [(None, None)] * len(start)
    bounds[1] = bounds[3] = (math.log(0.02 * _typical_gap(places)), math.log(10.0 * extent))
    if kind == "matern":
        start, bounds = [*start, 0.1, 0.3], [*bounds, (-1.5, 1.5), (None, None)]

    def cost(p: Array) -> tuple[float, Array]:
        covariance = _unpack(p, kind, lined)
        slopes, small = np.zeros(len(p)), slice(4, 6 if lined else 5)
        slopes[small] = p[small] - math.log(0.03 * spread)  # about 3 %, within a factor e
        total = 0.5 * float(slopes @ slopes)
        for sample in samples:
            more, slope = misfit(covariance, 3.0 * spread, sample)
            total, slopes = total + more, slopes + slope
        return total, slopes

    steps = count(1)
    found = minimize(
        cost,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=bounds,
        options={"maxiter": _MOST_STEPS},
        callback=lambda _: progress(next(steps), _MOST_STEPS),
    )
    progress(_MOST_STEPS, _MOST_STEPS)
    return _unpack(found.x, kind, lined)


def _unpack(p: Array, kind: str, lined: bool) -> Covariance:
    s1, l1, s2, l2, noise = (math.exp(min(x, 50.0)) for x in p[:5])
    ratio, strike = (math.exp(p[-2]), float(p[-1])) if kind == "matern" else (1.0, 0.0)
    return Covariance(
        kind, (s1, s2), (l1, l2), noise, math.exp(p[5]) if lined else 0.0, ratio, strike
    )


def _neighbourhoods(places: Array) -> list[Integers]:
    """Return rows of readings near some places and around them; the same for the same places."""
    from scipy.spatial import cKDTree

    random = generator(0, 0, "gridding neighbourhoods")
    count = len(places)
    wide = min(count, max(2000, count // 8))
    tree = cKDTree(places[:, :2])
    chosen = []
    for centre in random.choice(count, min(_PLACES, count), replace=False):
        rows = np.atleast_1d(tree.query(places[centre, :2], wide)[1])
        around = random.choice(rows, min(_AROUND, rows.size), replace=False)
        chosen.append(np.unique(np.concatenate([rows[:_NEAR], around])))
    return chosen


def _typical_gap(places: Array) -> float:
    """Return the median distance to the next reading, m."""
    from scipy.spatial import cKDTree

    distance = cKDTree(places[:, :2]).query(places[:, :2], 2)[0][:, 1]
    return max(float(np.median(distance)), 1.0)
