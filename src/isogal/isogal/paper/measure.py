"""What is kept of the runs of a case for tables, figures and claims (the runs themselves are not,
so that many cases fit into memory), and all that was measured, in one place."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.bound import posterior_cramer_rao, unaided_covariance
from isogal.evaluation.consistency import spread_test
from isogal.evaluation.records import RunDetail, Runs
from isogal.evaluation.results import Summary
from isogal.evaluation.summary import summarise
from isogal.fields.simulator import scan_index
from isogal.maps.variability import feature_variability, normalised_variability
from isogal.montecarlo.cases import Case
from isogal.montecarlo.engine import simulate
from isogal.montecarlo.store import Store
from isogal.navigator import Navigator
from isogal.paper.cases import AIDING, HEADINGS, PAPER, Plan, Setting
from isogal.paper.iterations import Snapshot, follow_iterations
from isogal.paper.lookups import ProfileExample, WindowExample, profile_example, window_example
from isogal.paper.published import PublishedRow
from isogal.scenario import Truth
from isogal.scenario.inertial import PAPER_GRADES
from isogal.sensors.trajectory import build_trajectory

INSTANTS = (0.5, 1.0, 2.0, 3.0, 3.5)
"""h, when the spread of the unaided runs is compared with the covariance."""
TRACKS = 10
"""Runs whose revised tracks are compared."""


@dataclass(frozen=True, eq=False)
class Outcome:
    """Errors and figures of merit of a case of R runs, at K instants."""

    setting: Setting
    summary: Summary
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
    detail: RunDetail | None

    @classmethod
    def of(cls, setting: Setting, runs: Runs, plan: Plan) -> "Outcome":
        """Compute them from the runs of a case."""
        scenario, field_map = plan.scenario(setting), plan.field_map(setting)
        bound = posterior_cramer_rao(scenario.true, plan.trajectory(setting), field_map)
        bound_rms = bound.rms_at(runs.time)
        return cls(
            setting,
            summarise(runs, scenario, bound_rms),
            runs.elapsed,
            runs.horizontal_error,
            runs.unaided_horizontal_error,
            bound_rms,
            runs.fix_time - runs.time[0],
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
        return float(self.run_means.std(ddof=1) / np.sqrt(count)) if count > 1 else math.nan

    @property
    def diverged(self) -> int:
        """How many runs diverged."""
        return int(self.summary["diverged"])

    def rms_between(self, start: float, end: float) -> float:
        """RMS error over a stretch of time (s), m; NaN where the runs are shorter."""
        inside = (self.time > start) & (self.time <= end)
        return rms(self.error[:, inside]) if inside.any() else math.nan


def rms(values: Array) -> float:
    """Root of the mean of the squares."""
    return float(np.sqrt(np.mean(values**2)))


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
    nees_per_axis: Array
    """(n,) their normalised ratio, chi-square distributed."""
    interval: tuple[float, float]
    """In which all instants together lie with 95 % probability."""
    consistent: bool

    @classmethod
    def of(cls, setting: Setting, runs: Runs) -> "Spread":
        """Compare the errors of the unaided INS with the covariance of its filter, which takes no
        fix."""
        wanted = [h * 3600.0 for h in INSTANTS if h * 3600.0 <= runs.elapsed[-1] + 1e-6]
        wanted = wanted or [float(runs.elapsed[-1])]
        index = [int(np.argmin(np.abs(runs.elapsed - t))) for t in wanted]
        error, covariance = runs.unaided_error[:, index], runs.covariance[:, index]
        return cls(
            setting.grade,
            runs.elapsed[index],
            np.sqrt(np.mean((error**2).sum(axis=-1), axis=0)),
            np.sqrt(np.mean(np.trace(covariance, axis1=-2, axis2=-1), axis=0)),
            *spread_test(error, covariance),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Errors of tracks as output at the time and as revised by later batches."""

    live: Array
    """(R, K, 2) m, error at the time, north and east."""
    revised: Array
    """(R, K, 2) m, after the batches that came later have gone back to it."""


def measure_tracks(plan: Plan, setting: Setting) -> Tracks:
    """Simulate a few runs, and collect the past states as retrodiction leaves them in the end."""
    scenario, trajectory = plan.scenario(setting), plan.trajectory(setting)
    states = np.arange(0, len(trajectory) + 1, scenario.steps_per_scan)
    truth = trajectory.latitude[states], trajectory.longitude[states]
    revised = []

    def keep(_: int, navigator: Navigator) -> None:
        track = navigator.inertial.track(trajectory.time[states])
        revised.append(horizontal_difference(track[:, 0], track[:, 1], *truth))

    runs = range(min(TRACKS, plan.runs))
    record = simulate(scenario, runs, plan.field_map(setting), finished=keep)
    return Tracks(record.error, np.array(revised))


def roughness(error: Array) -> float:
    """RMS change (m) of an error (..., K, 2) from one scan to the next."""
    return float(np.sqrt(np.mean((np.diff(error, axis=-2) ** 2).sum(axis=-1))))


@dataclass(frozen=True, slots=True, eq=False)
class AlongTrack:
    """What a noiseless sensor reads at the scans, and how much the map varies there (paper
    fig-60)."""

    time: Array
    """(S,) s."""
    signal: Array
    """(S,) map's unit."""
    variability: Array
    """(S,) eq. CV, map's unit squared."""
    normalised: Array
    """(S,) over the mean of the last samples."""


def along_track(plan: Plan, quantity: str) -> AlongTrack:
    """Read the map along the true track."""
    setting = Setting(quantity=quantity)
    field_map, trajectory = plan.field_map(setting), plan.trajectory(setting)
    scans = scan_index(plan.scenario(setting), trajectory)
    place = trajectory.latitude[scans], trajectory.longitude[scans]
    variability = feature_variability(field_map, *place)
    normalised = normalised_variability(variability)
    return AlongTrack(trajectory.time[scans], field_map.value(*place), variability, normalised)


def drift_by_theory(truth: Truth, time: float) -> float:
    """RMS error (m) of the unaided INS at a time (s), by its linear error model; NaN beyond the
    end."""
    covariance = unaided_covariance(truth, build_trajectory(truth))
    return float(covariance.rms_at(np.array([time]))[0])


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """Outcomes by setting, and other measurements."""

    plan: Plan
    outcomes: Mapping[Setting, Outcome]
    spreads: tuple[Spread, ...]
    """Of the unaided INS, one for each grade."""
    tracks: Mapping[Setting, Tracks]
    """Of both ways of aiding."""
    snapshots: tuple[Snapshot, ...]
    drift: Mapping[tuple[float, str], float]
    """m, RMS of the unaided INS at `Plan.gain_time` by theory, by heading error (rad) and
    grade."""
    signal: Mapping[str, AlongTrack]
    """By quantity."""
    profile: ProfileExample
    window: WindowExample

    def row(self, row: PublishedRow, matcher: str = PAPER) -> Outcome:
        """Return the outcome that belongs to a row of Table 4 or 6."""
        return self.at(row.quantity, row.sigma, row.batch_length, matcher)

    def at(self, quantity: str, sigma: float, batch_length: int, matcher: str = PAPER) -> Outcome:
        """Return the outcome of a case of the tables.

        Parameters
        ----------
        quantity : str
            ``gravity`` or ``disturbance``.
        sigma : float
            m/s², 1-sigma of the gravimeter.
        batch_length : int
        matcher : str
        """
        return self.outcomes[Setting(quantity, sigma, batch_length, matcher)]

    def unaided(self, grade: str) -> Outcome:
        """Return the outcome of the unaided navigator of a grade."""
        return self.outcomes[Setting(grade=grade, aided=False)]

    def snr(self, row: PublishedRow) -> float:
        """Signal-to-noise ratio along the track, 20 log10(RMS signal / sigma), dB."""
        return 20.0 * math.log10(rms(self.signal[row.quantity].signal) / row.sigma)


def measure(plan: Plan, cases: Mapping[Setting, Case], store: Store) -> Results:
    """Evaluate the runs in the store, one case at a time, and measure what needs no runs."""
    outcomes, spreads = {}, []
    for setting, case in cases.items():
        runs = store.load(case)
        outcomes[setting] = Outcome.of(setting, runs, plan)
        if not setting.aided:
            spreads.append(Spread.of(setting, runs))
    return Results(
        plan=plan,
        outcomes=outcomes,
        spreads=tuple(spreads),
        tracks={setting: measure_tracks(plan, setting) for setting in AIDING},
        snapshots=tuple(follow_iterations(plan)),
        drift={
            (heading, grade): drift_by_theory(
                plan.scenario(Setting(heading=heading, grade=grade)).true, plan.gain_time
            )
            for heading in HEADINGS
            for grade in PAPER_GRADES
        },
        signal={quantity: along_track(plan, quantity) for quantity in ("gravity", "disturbance")},
        profile=profile_example(plan),
        window=window_example(plan),
    )
