"""Coefficients as states of a recursive estimator, from a cold start (docs/magnetometer.md,
section 5)."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.magnetics.compensation import Compensation
from isogal.magnetics.readings import Readings, shifted
from isogal.magnetics.terms import COUNT, terms


@dataclass(frozen=True)
class Assumed:
    """What is known before the first reading."""

    coefficient_sigma: float = 300.0
    """1-sigma of a coefficient of a vehicle that nobody has calibrated, nT."""
    calibrated_share: float = 3.0
    """Factor on the 1-sigmas of coefficients that a calibration flight told."""
    walk: float = 0.0
    """By which a coefficient changes, nT per root second."""
    noise: float = 2.0
    """1-sigma of a reading, nT: of the instruments, and of what the model leaves out."""
    background_sigma: float = 50.0
    """1-sigma of what the field differs from what is taken off it, nT: the anomaly, or the error
    of a map of it, and the daily variation."""
    background_time: float = 30.0
    """s over which that changes."""
    offset_sigma: float = 300.0
    """1-sigma of its constant part, nT."""


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
    assumed: Assumed | None = None,
) -> Learnt:
    """Return what a vehicle added to each reading of a flight, by the readings until then.

    Parameters
    ----------
    readings : Readings
    known : (N,) array
        nT, of the total field what is not the vehicle's.
    start : Compensation, optional
        What an earlier flight told; None = a cold start.
    assumed : Assumed, optional

    Raises
    ------
    InputError
        A current that counts was not recorded.
    """
    names = tuple(readings.currents) if start is None else start.currents
    readings.require(names)
    learner = RecursiveCompensation(assumed, start, len(names))
    lag = 0.0 if start is None else start.lag
    vector = readings.vector if lag == 0.0 else shifted(readings.time, readings.vector, lag)
    own, sigma = np.full((2, len(readings)), np.nan)
    currents = np.stack([np.zeros(len(readings)), *(readings.currents[name] for name in names)])
    for i in np.flatnonzero(readings.usable & np.isfinite(vector).all(axis=-1)):
        flow = currents[None, 1:, i]
        found = learner.step(
            float(readings.time[i]), vector[None, i], readings.total[None, i], known[i], flow
        )
        own[i], sigma[i] = found[0][0], found[1][0]
    return Learnt(own, sigma, learner.compensation(0, names))


class RecursiveCompensation:
    """A Kalman filter (Groves 2013, section 3.2) with the terms' coefficients as states, for R
    vehicles at once. What else is in the readings is a constant and a Gauss-Markov process of
    second order (Gelb 1974, table 2.2-1), which changes as smoothly as an anomaly does at some
    height, and so is not taken for the vehicle's field.

    Parameters
    ----------
    assumed : Assumed, optional
    start : Compensation, optional
        What a calibration flight told; None = a cold start.
    currents : int
        How many are measured; where there is a start, as many as it has.
    runs : int
        R.
    """

    def __init__(
        self,
        assumed: Assumed | None = None,
        start: Compensation | None = None,
        currents: int = 0,
        runs: int = 1,
    ) -> None:
        self.assumed = a = assumed or Assumed()
        count = COUNT + 3 * currents if start is None else start.coefficients.size
        self._count = count
        sigma = np.full(count, a.coefficient_sigma)
        self.state = np.zeros((runs, count + 3))
        """(R, C + 3) coefficients, constant, background (nT) and its rate (nT/s)."""
        if start is not None:
            self.state[:, :count], self.state[:, count] = start.coefficients, start.offset
            if start.sigma.size:
                sigma = np.minimum(sigma, a.calibrated_share * start.sigma)
        beta = 1.0 / a.background_time
        steady = a.background_sigma**2 * np.array([1.0, beta**2])
        self._steady = np.diag(steady)
        variances = np.concatenate([sigma**2, [a.offset_sigma**2], steady])
        self.covariance = np.tile(np.diag(variances), (runs, 1, 1))
        """(R, C + 3, C + 3)."""
        self._time: float | None = None
        self._before: Array | None = None

    @property
    def coefficients(self) -> Array:
        """(R, C)."""
        return self.state[:, : self._count]

    def step(
        self,
        time: float,
        vector: Array,
        total: Array,
        known: Array | float = 0.0,
        currents: Array | None = None,
    ) -> tuple[Array, Array]:
        """Take one reading and return (R,) what the vehicle adds to it, the constant with it, and
        its 1-sigma, nT, by all readings until then; NaN at the first and at readings that are
        NaN, which change nothing.

        Parameters
        ----------
        time : float
            s, later than that of the reading before.
        vector : (R, 3) array
            nT, body axes.
        total : (R,) array
            nT.
        known : (R,) array or float
            nT, what is known of the total field: the main field, and a map's anomaly.
        currents : (R, K) array, optional
            A.
        """
        nothing = np.full(len(self.state), np.nan)
        previous, self._before = self._before, vector
        before, self._time = self._time, time
        if previous is None or before is None:
            return nothing, nothing
        self._predict(time - before)
        # the rate holds for half a step ago, and so have the other parts of the terms to
        row = terms(vector, (vector - previous) / (time - before), total, currents)
        good = np.isfinite(row).all(axis=-1) & np.isfinite(total - known)
        row = np.where(good[:, None], row, 0.0)
        level = np.where(good, total - known, 0.0)
        self._update(row, level, good)
        row = np.concatenate([row, np.ones((len(row), 1))], axis=1)
        own = (row * self.state[:, : self._count + 1]).sum(axis=-1)
        part = self.covariance[:, : self._count + 1, : self._count + 1]
        variance = (row * (part @ row[:, :, None])[..., 0]).sum(axis=-1)
        return np.where(good, own, np.nan), np.where(good, np.sqrt(variance), np.nan)

    def compensation(self, run: int = 0, names: tuple[str, ...] = ()) -> Compensation:
        """Return what has been learnt so far."""
        variance = np.diagonal(self.covariance[run])[: self._count]
        offset = float(self.state[run, self._count])
        return Compensation(
            self.coefficients[run].copy(), names, offset, sigma=np.sqrt(np.maximum(variance, 0.0))
        )

    def _predict(self, dt: float) -> None:
        c, beta = self._count, 1.0 / self.assumed.background_time
        turn = math.exp(-beta * dt) * np.array(
            [[1.0 + beta * dt, dt], [-(beta**2) * dt, 1.0 - beta * dt]]
        )
        self.state[:, c + 1 :] = self.state[:, c + 1 :] @ turn.T
        self.covariance[:, c + 1 :] = turn @ self.covariance[:, c + 1 :]
        self.covariance[:, :, c + 1 :] = self.covariance[:, :, c + 1 :] @ turn.T
        self.covariance[:, c + 1 :, c + 1 :] += self._steady - turn @ self._steady @ turn.T
        if self.assumed.walk > 0.0:
            places = np.arange(c)
            self.covariance[:, places, places] += self.assumed.walk**2 * dt

    def _update(self, row: Array, level: Array, good: Booleans) -> None:
        """Take readings of the level (R,) whose coefficients' derivatives are `row` (R, C)."""
        h = np.zeros_like(self.state)
        h[:, : self._count], h[:, self._count], h[:, self._count + 1] = row, 1.0, 1.0
        h *= good[:, None]
        across = (self.covariance @ h[:, :, None])[..., 0]
        variance = (h * across).sum(axis=-1) + self.assumed.noise**2
        gain = across / variance[:, None]
        rest = level - (h * self.state).sum(axis=-1) * good
        self.state += gain * rest[:, None]
        self.covariance -= gain[:, :, None] * across[:, None, :]
        self.covariance = 0.5 * (self.covariance + np.swapaxes(self.covariance, 1, 2))
