"""Figures of a row of `acceptance.py`, and what they are beside those that were kept."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from acceptance_rows import Row
from closed_loop import jackknife, rms
from measured_data.matches import Summary

from isogal.arrays import Array
from isogal.evaluation.consistency import nees_per_axis
from isogal.evaluation.judgement import CLAIMED_SIGMAS
from isogal.evaluation.records import Runs
from isogal.evaluation.summary import plain, posterior_nees, summarise
from isogal.scenario import Scenario

Value = TypeVar("Value")

FOUND = 500.0
"""m; a start is found while the error is below."""
WORSE_RMS, WORSE_NEES, WORSE_FOUND = 0.03, 0.1, 0.05
"""What a row may lose: share of its RMS, NEES away from 1, share of starts found."""
_DIGITS = 4


RowFigures = dict[str, str | float | dict[str, float] | list[float | None] | None]
"""What is kept of a row, in acceptance.json: why there is nothing (`skipped`, `failed`), or what
`figures_of` and `figures_of_lines` return; None = there is no such number."""


@dataclass(frozen=True)
class Cost:
    """What runs took."""

    cpu: float
    """s."""
    memory: float
    """MB, peak."""
    resets: int = 0
    """How many times a navigator was told that it has diverged."""


def _apart(statistic: Callable[..., float], now: Array, kept: Array) -> tuple[float, float]:
    """Return a statistic of two samples that have nothing to do with each other."""
    value, first = jackknife(lambda one: statistic(one, kept), now)
    _, second = jackknife(lambda one: statistic(now, one), kept)
    return value, float(np.hypot(first, second))


def figures_of(row: Row, scenario: Scenario, record: Runs, bound: Array, cost: Cost) -> RowFigures:
    """Return the figures of runs. Errors are of the time after `row.settled`. NEES is that of the
    navigator after each fix, as the README has it; where a start is to be found first, of the time
    after `row.settled` too."""
    summary = summarise(record, scenario, bound)
    late = record.elapsed > row.settled
    error, unaided = record.horizontal_error, record.unaided_horizontal_error
    of_run = np.sqrt((error[:, late] ** 2).mean(axis=1))
    limit = rms(bound[late])
    value, error_of_rms = jackknife(rms, of_run)
    outside = 2.0 * nees_per_axis(record.error, record.covariance) > CLAIMED_SIGMAS**2
    judged, fixes = summary["judgement"]["runs"], summary["fixes"]
    nees = posterior_nees(record)
    if row.minutes:
        nees = nees[:, record.fix_time - record.time[0] > row.settled]
    seconds = record.fix_seconds[np.isfinite(record.fix_seconds)]
    hours = len(record) * float(record.elapsed[-1]) / 3600.0
    result = {
        "runs": len(record),
        "seed": scenario.seed,
        "rms": value,
        "bound": limit,
        "unaided": rms(unaided[:, late]),
        "ratio": value / limit,
        "ratio_error": error_of_rms / limit,
        "nees": float(np.mean(nees[np.isfinite(nees)])),
        "diverged": summary["diverged"],
        "declined": fixes["declined"],
        "failed_fixes": fixes["failed"],
        "fixes": fixes["published"],
        "beyond_claim": len(judged["overconfident"]),
        "beyond_claim_time": float(outside.mean()),
        "worse_than_unaided": len(judged["worse_than_unaided"]),
        "told_diverged": cost.resets,
        "run_hours": hours,
        "found": {str(m): _found(record, m) for m in row.minutes},
        "fix_ms": _of_fixes(seconds),
        "run_hours_per_cpu_s": hours / cost.cpu,
        "memory_mb": cost.memory,
        "rms_of_run": of_run,
        "nees_of_run": _mean_of_run(nees),
    }
    return _rounded(plain(result))


def figures_of_lines(found: Summary, seconds: float, cost: Cost) -> RowFigures:
    """Return the figures of recorded lines: medians, beside the median of the longer 1-sigma."""
    rows = found["rows"]
    error, nees = ([one.get(k) for one in rows] for k in ("error_m", "nees_per_axis"))
    median, sigma = found.get("error_median_m"), found.get("sigma_long_median_m")
    result = {
        "runs": len(rows),
        "seed": None,
        "median": True,
        "rms": median,
        "bound": sigma,
        "ratio": median / sigma if found["fixes"] else None,
        "nees": found.get("nees_per_axis"),
        "declined": found["batches"] - found["fixes"],
        "fixes": found["fixes"],
        "fix_ms": {"mean": 1e3 * seconds / max(1, len(rows))},
        "memory_mb": cost.memory,
        "rms_of_run": error,
        "nees_of_run": nees,
    }
    return _rounded(plain(result))


def _found(record: Runs, minutes: int) -> float:
    """Return the share of runs whose error is small by then."""
    index = min(int(np.searchsorted(record.elapsed, 60.0 * minutes)), record.time.size - 1)
    return float((record.horizontal_error[:, index] < FOUND).mean())


def _of_fixes(seconds: Array) -> dict[str, float]:
    middle, high = np.percentile(1e3 * seconds, [50.0, 99.0])
    return {"median": float(middle), "p99": float(high), "max": 1e3 * float(seconds.max())}


def _mean_of_run(values: Array) -> list[float]:
    """Return the mean of each run's numbers; NaN where it has none."""
    finite = np.where(np.isfinite(values), values, np.nan)
    return [float(np.nanmean(one)) if np.isfinite(one).any() else np.nan for one in finite]


def _rounded(value: Value) -> Value:
    """Return a document with fewer digits."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value


@dataclass(frozen=True)
class Comparison:
    """A row beside the one that was kept."""

    ratio: float
    """RMS error (of recorded lines the median) over that of the kept one."""
    ratio_error: float
    """Standard error."""
    nees: float
    """How much further its NEES is from 1."""
    nees_error: float
    """Standard error."""
    worse: tuple[str, ...]
    """In what it is worse, in words."""


def compared(now: RowFigures, kept: RowFigures | None) -> Comparison | None:
    """Return a row beside the kept one, in pairs of runs where both have the same seed; None
    where one of them has no figures.

    Worse is an RMS error by more than `WORSE_RMS`, and a NEES by more than `WORSE_NEES`, both
    beyond their standard errors; and fewer starts found by more than `WORSE_FOUND`."""
    if "failed" in now and kept and "rms" in kept:
        return Comparison(np.nan, np.nan, np.nan, np.nan, ("failed",))
    if kept is None or any(one.get("rms") is None for one in (now, kept)):
        return None
    middle = np.median if now.get("median") else rms
    pairs = now["seed"] == kept["seed"]

    def between(name: str, statistic: Callable[..., float]) -> tuple[float, float]:
        one, other = (_numbers(row[name]) for row in (now, kept))
        if not pairs:
            known = (x[np.isfinite(x)] for x in (one, other))
            return _apart(statistic, *known)
        shared = min(len(one), len(other))
        one, other = one[:shared], other[:shared]
        both = np.isfinite(one) & np.isfinite(other)
        return jackknife(statistic, one[both], other[both])

    ratio, ratio_error = between("rms_of_run", lambda a, b: float(middle(a) / middle(b)))
    nees, nees_error = between("nees_of_run", lambda a, b: abs(a.mean() - 1) - abs(b.mean() - 1))
    worse = []
    if ratio - np.nan_to_num(ratio_error) > 1.0 + WORSE_RMS:
        worse.append("RMS")
    if nees - np.nan_to_num(nees_error) > WORSE_NEES:
        worse.append("NEES")
    minutes = [m for m in now.get("found", {}) if m in kept.get("found", {})]
    if minutes and now["found"][minutes[-1]] < kept["found"][minutes[-1]] - WORSE_FOUND:
        worse.append("found")
    return Comparison(ratio, ratio_error, nees, nees_error, tuple(worse))


def _numbers(values: Sequence[float | None]) -> Array:
    return np.array(values, dtype=np.float64)  # None becomes NaN
