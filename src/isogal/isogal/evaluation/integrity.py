"""Does the error stay within its protection level? Exceedances, counted as events, and their rate
(docs/mathematics.md, section 11.6; docs/integrity.md)."""

import math
from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array, Booleans, Integers
from isogal.evaluation.records import Runs
from isogal.evaluation.results import Summary, finite
from isogal.fusion.protection_level import HOUR, axes, protection_level
from isogal.scenario import Integrity

RISKS = (1e-1, 1e-2, 1e-3)
"""Per hour, at which exceedances are counted besides the scenario's own risk, of which there are
too few to count."""
CONFIDENCE = 0.95
"""Of intervals of rates."""
LAG = 100.0
"""s at which the error's correlation time is measured: some fixes long, and short of the time."""


@dataclass(frozen=True, slots=True)
class Rate:
    """How often something happened."""

    events: int
    hours: float

    @property
    def per_hour(self) -> float:
        """Events per hour."""
        return self.events / self.hours

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of the rate per hour at `CONFIDENCE`."""
        low, high = poisson_interval(self.events)
        return low / self.hours, high / self.hours

    def verdict(self, allowed: float) -> str:
        """Whether the events are "rarer" than an allowed rate per hour, "more often", or
        "consistent" with it (the interval holds it)."""
        low, high = self.interval
        return "rarer" if high < allowed else "more often" if low > allowed else "consistent"

    def figures(self) -> Summary:
        """Return count, rate and interval."""
        return {"events": self.events, "rate": self.per_hour, "interval": list(self.interval)}


def hours(runs: Runs) -> float:
    """Return the time of all runs together, h."""
    return len(runs) * float(runs.elapsed[-1]) / HOUR


def level_of(runs: Runs, settings: Integrity, risk: float | None = None) -> Array:
    """Return the protection level (R, K) m of the aided navigator at a risk per hour, default the
    settings'."""
    return protection_level(runs.covariance, risk or settings.risk, settings.correlation_time)


def in_sigmas(level: Array, runs: Runs) -> Array:
    """Return a level (R, K) m in units of the claimed 1-sigma along the major axis."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return cast(Array, level / axes(runs.covariance)[0])


def rate_of(outside: Booleans, runs: Runs, settings: Integrity) -> Rate:
    """Return how often something is outside (R, K)."""
    count = excursions(outside, runs.time, settings.correlation_time).sum()
    return Rate(int(count), hours(runs))


def integrity(runs: Runs, settings: Integrity) -> Summary:
    """Return `integrity` of results.json: the error's correlation time as assumed and as measured,
    the median level over states and runs, also in 1-sigmas along the major axis, the exceedances
    of the level at each of `RISKS` and at the scenario's own risk, and where there is an alert
    limit how often the level is within and the error beyond it."""
    level = level_of(runs, settings)
    rates = {risk: exceedances(runs, settings, risk) for risk in (*RISKS, settings.risk)}
    return {
        "risk": settings.risk,
        "run_hours": hours(runs),
        "correlation_time": {
            "assumed": settings.correlation_time,
            "measured": finite(correlation_time(runs)),
        },
        "level": {
            "median": finite(np.median(level)),
            "median_sigmas": finite(np.median(in_sigmas(level, runs))),
        },
        "exceedances": [
            {"risk": risk, **rate.figures(), "verdict": rate.verdict(risk)}
            for risk, rate in rates.items()
        ],
        "alert_limit": _alerts(runs, settings, level),
    }


def exceedances(runs: Runs, settings: Integrity, risk: float) -> Rate:
    """Return how often the error exceeds the protection level at a risk per hour."""
    outside = ~(runs.horizontal_error <= level_of(runs, settings, risk))
    return rate_of(outside, runs, settings)


def _alerts(runs: Runs, settings: Integrity, level: Array) -> Summary | None:
    limit = settings.alert_limit
    if limit is None:
        return None
    available = level <= limit
    beyond = available & ~(runs.horizontal_error <= limit)
    return {
        "limit": limit,
        "available": float(available.mean()),
        "hazardous": rate_of(beyond, runs, settings).figures(),
    }


def excursions(outside: ArrayLike, time: Array, apart: float) -> Integers:
    """Count events: stretches of states outside, of which those that are at most `apart` seconds
    apart are one.

    Parameters
    ----------
    outside : (R, K) array of bool
    time : (K,) array
        s, increasing.
    apart : float
        s; states outside with no longer time between them belong to one event.

    Returns
    -------
    (R,) array of int
    """
    outside = np.asarray(outside, dtype=np.bool_)
    last = np.full(outside.shape, -np.inf)  # time of the newest state outside before each state
    last[:, 1:] = np.maximum.accumulate(np.where(outside, time, -np.inf), axis=1)[:, :-1]
    return cast(Integers, (outside & (time - last > apart)).sum(axis=1))


def poisson_interval(events: int) -> tuple[float, float]:
    """Return the interval of a Poisson variable's mean, given one count (Garwood 1936): its ends
    are those means at which a count as high, or as low, has half of the probability left out."""
    from scipy.special import gammaincinv  # scipy.stats would take seconds to import

    tail = 0.5 * (1.0 - CONFIDENCE)
    low = float(gammaincinv(events, tail)) if events else 0.0
    return low, float(gammaincinv(events + 1, 1.0 - tail))


def correlation_time(runs: Runs) -> float:
    """Return the time (s) T of the exponential exp(-lag / T) that the autocorrelation of the
    error, in units of its claimed covariance, reaches at `LAG`, for states at even steps; NaN
    where there is none."""
    time, error, covariance = runs.time, runs.error, runs.covariance
    step = float(np.median(np.diff(time))) if time.size > 1 else math.inf
    steps = round(LAG / step)
    if not 0 < steps < time.size:
        return math.nan
    north, across = covariance[..., 0, 0], covariance[..., 0, 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        first = error[..., 0] / np.sqrt(north)
        rest = np.sqrt(covariance[..., 1, 1] - across**2 / north)
        second = (error[..., 1] - across / north * error[..., 0]) / rest
    own = np.stack([first, second])
    before, after = own[..., :-steps], own[..., steps:]
    known = np.isfinite(before) & np.isfinite(after)
    before, after = np.where(known, before, 0.0), np.where(known, after, 0.0)
    scale = math.sqrt(float((before**2).sum() * (after**2).sum()))
    correlation = float((before * after).sum()) / scale if scale > 0.0 else math.nan
    return -steps * step / math.log(correlation) if 0.0 < correlation < 1.0 else math.nan
