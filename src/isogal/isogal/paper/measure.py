"""What is kept of the runs of a case for tables, figures and claims; the runs themselves are not,
so that many cases fit into memory."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.bound import posterior_cramer_rao, unaided_covariance
from isogal.evaluation.consistency import SpreadTest, spread_test
from isogal.evaluation.records import RunDetail, Runs
from isogal.evaluation.summary import summarise
from isogal.fusion.state import FilterState
from isogal.matching.paper.matcher import PaperOptions
from isogal.montecarlo.engine import simulate
from isogal.paper.cases import Plan, Setting
from isogal.sensors.trajectory import build_trajectory

INSTANTS = (0.5, 1.0, 2.0, 3.0, 3.5)
"""h, when the spread of the unaided runs is compared with the covariance."""
TRACKS = 10
"""Runs whose revised tracks are compared."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Errors and figures of merit of a case of R runs, at K instants."""

    setting: Setting
    summary: dict[str, Any]
    """In the format of results.json."""
    time: Array
    """(K,) s since the start."""
    error: Array
    """(R, K) m, horizontal, aided."""
    unaided: Array
    """(R, K) m."""
    bound: Array
    """(K,) m."""
    fix_time: Array
    """(B,) s."""
    excluded: float
    """Share of the batch ends at which the true place was outside the paper's search window."""
    detail: RunDetail | None

    @classmethod
    def of(cls, setting: Setting, runs: Runs, plan: Plan) -> "Outcome":
        """Compute them from the runs of a case."""
        scenario = plan.scenario(setting)
        bound = posterior_cramer_rao(
            scenario, build_trajectory(scenario), plan.field_map(setting)
        ).rms_at(runs.time)
        return cls(
            setting,
            summarise(runs, scenario, bound),
            runs.elapsed,
            runs.horizontal_error,
            runs.unaided_horizontal_error,
            bound,
            runs.fix_time - runs.time[0],
            excluded_share(runs),
            runs.detail,
        )

    @cached_property
    def rms(self) -> Array:
        """(K,) m, RMS over the runs."""
        return np.sqrt(np.mean(self.error**2, axis=0))

    @cached_property
    def unaided_rms(self) -> Array:
        """(K,) m, RMS over the runs."""
        return np.sqrt(np.mean(self.unaided**2, axis=0))

    @cached_property
    def run_means(self) -> Array:
        """(R,) m, mean error of each run."""
        return self.error.mean(axis=1)

    @property
    def mean(self) -> float:
        """Mean position error, m."""
        return float(self.run_means.mean())

    @property
    def mean_uncertainty(self) -> float:
        """Standard error of the mean position error, m; NaN for a single run."""
        count = len(self.run_means)
        return float(self.run_means.std(ddof=1) / np.sqrt(count)) if count > 1 else float("nan")

    @property
    def diverged(self) -> int:
        """How many runs diverged."""
        return int(self.summary["diverged"])

    def rms_between(self, start: float, end: float) -> float:
        """RMS error over a stretch of time (s), m; NaN where the runs are shorter."""
        inside = (self.time > start) & (self.time <= end)
        return (
            float(np.sqrt(np.mean(self.error[:, inside] ** 2))) if inside.any() else float("nan")
        )


def excluded_share(runs: Runs) -> float:
    """Share of the batch ends at which the true place is outside the window of eq. s2-02 (a
    rectangle) about the navigator's position before the fix."""
    options = PaperOptions()
    before = np.searchsorted(runs.time, runs.fix_time - 1e-6) - 1
    half = np.sqrt(options.gamma * np.diagonal(runs.covariance[:, before], axis1=-2, axis2=-1))
    outside = np.abs(runs.error[:, before]) > np.maximum(half, options.min_half_width)
    return float(outside.any(axis=-1).mean()) if outside.size else 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """RMS error of the unaided navigator, and what its filter's covariance says."""

    grade: str
    time: Array
    """(n,) s."""
    rms: Array
    """(n,) m, of the runs."""
    claimed: Array
    """(n,) m, by the filter's own covariance."""
    test: SpreadTest


def measure_spread(setting: Setting, runs: Runs) -> Spread:
    """Compare the errors of the unaided INS with the covariance of its filter, which takes no
    fix."""
    wanted = [h * 3600.0 for h in INSTANTS if h * 3600.0 <= runs.elapsed[-1] + 1e-6] or [
        float(runs.elapsed[-1])
    ]
    index = [int(np.argmin(np.abs(runs.elapsed - t))) for t in wanted]
    error, covariance = runs.unaided_error[:, index], runs.covariance[:, index]
    return Spread(
        setting.grade,
        runs.elapsed[index],
        np.sqrt(np.mean((error**2).sum(axis=-1), axis=0)),
        np.sqrt(np.mean(np.trace(covariance, axis1=-2, axis2=-1), axis=0)),
        spread_test(error, covariance),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Errors of tracks as output at the time and as revised by later batches."""

    setting: Setting
    time: Array
    """(K,) s since the start."""
    live: Array
    """(R, K, 2) m, error at the time, north and east."""
    revised: Array
    """(R, K, 2) m, after the batches that came later have gone back to it."""


def measure_tracks(plan: Plan, setting: Setting) -> Tracks:
    """Simulate a few runs, and collect the past states that retrodiction revises."""
    scenario, field_map = plan.scenario(setting), plan.field_map(setting)
    trajectory = build_trajectory(scenario)
    states = np.arange(0, len(trajectory) + 1, scenario.steps_per_scan)
    runs = range(min(TRACKS, plan.runs))
    revised = np.full((len(runs), len(states), 2), np.nan)

    def keep(state: int, which: list[int], there: FilterState) -> None:
        truth = trajectory.latitude[states[state]], trajectory.longitude[states[state]]
        revised[which, state] = horizontal_difference(
            there.position[:, 0], there.position[:, 1], *truth
        )

    record = simulate(scenario, runs, field_map, revised=keep)
    revised = np.where(np.isnan(revised), record.error, revised)
    return Tracks(setting, record.elapsed, record.error, revised)


def roughness(error: Array) -> float:
    """RMS change (m) of an error (..., K, 2) from one scan to the next."""
    return float(np.sqrt(np.mean((np.diff(error, axis=-2) ** 2).sum(axis=-1))))


def drift_by_theory(plan: Plan, setting: Setting, time: float) -> float:
    """RMS error (m) of the unaided INS at a time (s), by its linear error model; NaN beyond the
    end."""
    scenario = plan.scenario(setting)
    return float(
        unaided_covariance(scenario, build_trajectory(scenario)).rms_at(np.array([time]))[0]
    )
