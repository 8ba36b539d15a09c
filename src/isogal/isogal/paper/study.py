"""The whole reproduction: cases through the workers, then measures, claims, figures, page."""

import time
from pathlib import Path
from typing import Any

import numpy as np

import isogal
from isogal.evaluation.bound import unaided_covariance
from isogal.evaluation.summary import write_json
from isogal.files import make_folder
from isogal.montecarlo.chunks import Case
from isogal.montecarlo.store import Store
from isogal.montecarlo.study import Backend, Display, compute_cases
from isogal.paper.cases import SWEEP_HEADINGS, Plan, Setting, retrodiction_settings
from isogal.paper.claims.judge import judge
from isogal.paper.claims.verdicts import Claim
from isogal.paper.document import write_page
from isogal.paper.iterations import follow_iterations
from isogal.paper.lookups import profile_example, window_example
from isogal.paper.measure import Outcome, drift_by_theory, measure_spread, measure_tracks
from isogal.paper.results import Results, along_track
from isogal.paper.results_json import as_json
from isogal.scenario import InitialError, Route
from isogal.scenario.imu_grades import PAPER_GRADES
from isogal.sensors.trajectory import build_trajectory


def cases_of(plan: Plan) -> dict[Setting, Case]:
    """Return all cases; raises InputError where the map cannot be used."""
    return {setting: plan.case(setting) for setting in plan.settings()}


def reproduce(
    plan: Plan, out: str | Path, backend: Backend, display: Display
) -> tuple[Results, tuple[Claim, ...], Path]:
    """Simulate what is not there yet, and write results.json, report.html and the figures.

    Parameters
    ----------
    plan : Plan
    out : path
        Folder; finished runs are kept in its folder ``runs``.
    backend : Backend
        Processes or machines that compute.
    display : Display
        Shows the progress.

    Returns
    -------
    results, claims, path of the page

    Raises
    ------
    InputError, WorkerError, Interrupted
        As `compute_cases`.
    """
    start = time.monotonic()
    out = Path(out)
    cases = cases_of(plan)
    store = Store(out / "runs")
    make_folder(out)
    compute_cases(list(cases.values()), store, backend, display)
    results = measure(plan, cases, store)
    claims = judge(results)
    page = write_page(results, claims, out, journey_time(plan), drift_without_initial_errors(plan))
    document: dict[str, Any] = {
        "isogal": isogal.__version__,
        "map": plan.field_map(Setting()).provenance,
        "runs": plan.runs,
        "duration": plan.duration,
        **as_json(results, claims),
        "time": {
            "wall_s": time.monotonic() - start,
            "fix_ms_median": {
                s.name: o.summary["time"]["fix_ms_median"] for s, o in results.outcomes.items()
            },
        },
    }
    write_json(out / "results.json", document)
    return results, claims, page


def measure(plan: Plan, cases: dict[Setting, Case], store: Store) -> Results:
    """Evaluate the runs in the store, one case at a time, and measure what needs no runs."""
    outcomes, spreads = {}, []
    for setting, case in cases.items():
        runs = store.load(case)
        outcomes[setting] = Outcome.of(setting, runs, plan)
        if not setting.aided:
            spreads.append(measure_spread(setting, runs))
    both = [
        Setting(batch_length=s.batch_length, mode=mode)
        for s in retrodiction_settings()
        for mode in ("standard", s.mode)
    ]
    return Results(
        plan=plan,
        outcomes=outcomes,
        spreads=tuple(spreads),
        tracks={setting: measure_tracks(plan, setting) for setting in both},
        snapshots=tuple(follow_iterations(plan)),
        drift={
            (heading, grade): drift_by_theory(
                plan, Setting(heading=heading, grade=grade), plan.gain_time
            )
            for heading in SWEEP_HEADINGS
            for grade in PAPER_GRADES
        },
        signal={quantity: along_track(plan, quantity) for quantity in ("gravity", "disturbance")},
        profile=profile_example(plan),
        window=window_example(plan),
    )


def journey_time(plan: Plan) -> float:
    """Return how long the whole route takes, s."""
    scenario = plan.scenario(Setting())
    route = Route(**{**scenario.route.model_dump(), "duration": None})
    return float(build_trajectory(scenario.model_copy(update={"route": route})).time[-1])


def drift_without_initial_errors(plan: Plan) -> float:
    """RMS error (m) of the unaided INS at `Plan.gain_time` after a perfect start."""
    scenario = plan.scenario(Setting())
    perfect = scenario.model_copy(
        update={"initial_error": InitialError(position=0, velocity=0, tilt=0, heading=0)}
    )
    return float(
        unaided_covariance(perfect, build_trajectory(perfect)).rms_at(np.array([plan.gain_time]))[
            0
        ]
    )
