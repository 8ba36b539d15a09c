"""Coefficients as states of a recursive estimator, from a cold start (docs/magnetometer.md,
section 5)."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.magnetics.compensation import Compensation
from isogal.magnetics.readings import Readings, shifted
from isogal.magnetics.terms import COUNT, terms

COEFFICIENT_SIGMA = 300.0
"""1-sigma of a coefficient of a vehicle that nobody has calibrated, nT."""
CALIBRATED_SHARE = 3.0
"""Factor on the 1-sigmas of coefficients that a calibration flight has shown."""
_NOISE = 2.0
"""1-sigma of a reading, nT: of the instruments, and of what the model leaves out."""
_BACKGROUND_SIGMA, _BACKGROUND_TIME = 50.0, 30.0
"""1-sigma, nT, of what the field differs from what is taken off it: the anomaly, or the error of a
map of it, and the daily variation; and s over which that changes."""
_BACKGROUND = _BACKGROUND_SIGMA**2 * np.array([1.0, _BACKGROUND_TIME**-2])
"""Variances of it and of its rate."""


@dataclass(frozen=True, slots=True, eq=False)
class Learnt:
    """What was learnt along a flight."""

    own: Array
    """(N,) nT, what the vehicle added, by the readings until then; NaN where it is not known."""
    sigma: Array
    """(N,) its 1-sigma, nT."""
    compensation: Compensation
    """By all readings."""


def learn_along(
    readings: Readings,
    known: Array,
    start: Compensation | None = None,
    offset_sigma: float = 300.0,
) -> Learnt:
    """Return what a vehicle added to each reading of a flight, by the readings until then.

    A Kalman filter (Groves 2013, section 3.2) with the terms' coefficients as states. What else is
    in the readings is a constant and a Gauss-Markov process of second order (Gelb 1974, table
    2.2-1), which changes as smoothly as an anomaly does at some height, and so is not taken for
    the vehicle's field.

    Parameters
    ----------
    readings : Readings
    known : (N,) array
        nT, of the total field what is not the vehicle's; NaN where that is not known.
    start : Compensation, optional
        What an earlier flight has shown; None = a cold start.
    offset_sigma : float
        nT, 1-sigma of the constant by which `known` is wrong.

    Raises
    ------
    InputError
        A current that counts was not recorded.
    """
    if start is None:
        names = tuple(readings.currents)
        start = Compensation(np.zeros(COUNT + 3 * len(names)), names)
    at, steps, rows = _rows(readings, start.currents, start.lag)
    count = rows.shape[1]
    # coefficients, constant, background (nT) and its rate (nT/s)
    state, spread = np.zeros(count + 3), np.full(count, COEFFICIENT_SIGMA)
    state[:count], state[count] = start.coefficients, start.offset
    if start.sigma.size:
        spread = np.minimum(spread, CALIBRATED_SHARE * start.sigma)
    covariance = np.diag(np.concatenate([spread**2, [offset_sigma**2], _BACKGROUND]))
    level = readings.total - known
    own, sigma = np.full((2, len(readings)), np.nan)
    for i, dt, row in zip(at, steps, rows, strict=True):
        turn, joined = _background(dt)
        state[-2:] = turn @ state[-2:]
        covariance[-2:] = turn @ covariance[-2:]
        covariance[:, -2:] = covariance[:, -2:] @ turn.T
        covariance[-2:, -2:] += joined
        if not math.isfinite(level[i]):
            continue
        h = np.concatenate([row, [1.0, 1.0, 0.0]])
        across = covariance @ h
        gain = across / (h @ across + _NOISE**2)
        state += gain * (level[i] - h @ state)
        covariance -= np.outer(gain, across)
        covariance = 0.5 * (covariance + covariance.T)
        h[-2] = 0.0
        own[i], sigma[i] = h @ state, math.sqrt(h @ covariance @ h)
    spread = np.sqrt(np.maximum(np.diag(covariance)[:count], 0.0))
    found = Compensation(state[:count], start.currents, float(state[count]), sigma=spread)
    return Learnt(own, sigma, found)


def _rows(readings: Readings, names: tuple[str, ...], lag: float) -> tuple[Integers, Array, Array]:
    """Return which readings can be used (n,) after the first of these, s since the one before,
    and the terms of each (n, C)."""
    readings.require(names)
    vector = readings.vector if lag == 0.0 else shifted(readings.time, readings.vector, lag)
    at = np.flatnonzero(readings.usable & np.isfinite(vector).all(axis=-1))
    steps, flow = np.diff(readings.time[at]), None
    if names:
        flow = np.stack([readings.currents[name][at[1:]] for name in names], axis=-1)
    # the rate holds for half a step ago, and so have the other parts of the terms to
    rate = np.diff(vector[at], axis=0) / steps[:, None]
    return at[1:], steps, terms(vector[at[1:]], rate, readings.total[at[1:]], flow)


def _background(dt: float) -> tuple[Array, Array]:
    """Return (2, 2) the transition of the background over a step (s), and what joins its
    covariance."""
    beta, steady = 1.0 / _BACKGROUND_TIME, np.diag(_BACKGROUND)
    turn = math.exp(-beta * dt) * np.array(
        [[1.0 + beta * dt, dt], [-(beta**2) * dt, 1.0 - beta * dt]]
    )
    return turn, steady - turn @ steady @ turn.T
