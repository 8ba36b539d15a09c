"""The whole reproduction: cases through the workers, then measures, claims, page and numbers."""

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pydantic import JsonValue

import isogal
from isogal.evaluation.summary import write_json
from isogal.files import make_folder
from isogal.montecarlo.store import Store
from isogal.montecarlo.study import Backend, Display, compute_cases
from isogal.paper.cases import MATCHERS, SETTINGS, Plan, Setting
from isogal.paper.claims import Claim, judge, quantum_gain
from isogal.paper.document import write_page
from isogal.paper.measure import Outcome, Results, measure, roughness
from isogal.paper.published import QUANTUM_GAIN, TABLE_4, TABLE_6, PublishedRow


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
    cases = {setting: plan.case(setting) for setting in SETTINGS}
    store = Store(out / "runs")
    make_folder(out)
    compute_cases(list(cases.values()), store, backend, display)
    results = measure(plan, cases, store)
    claims = judge(results)
    page = write_page(results, claims, out)
    write_json(out / "results.json", as_json(results, claims, time.monotonic() - start))
    return results, claims, page


def as_json(
    results: Results, claims: Sequence[Claim], wall_seconds: float
) -> dict[str, JsonValue]:
    """Return all numbers as one document.

    The figures of merit of each case are in the format of results.json of a Monte Carlo, without
    the computing times."""
    plan = results.plan
    gain, error = quantum_gain(results)
    summaries = {setting.name: outcome.summary for setting, outcome in results.outcomes.items()}
    return {
        "isogal": isogal.__version__,
        "map": plan.field_map(Setting()).provenance,
        "runs": plan.runs,
        "duration": plan.duration,
        "tables": {
            name: [_row(results, row) for row in rows]
            for name, rows in (("4", TABLE_4), ("6", TABLE_6))
        },
        "unaided": [asdict(spread) for spread in results.spreads],
        "quantum_gain": {
            "published": QUANTUM_GAIN,
            "time": plan.gain_time,
            "measured": gain,
            "standard_error": error,
        },
        "drift_by_theory": [
            {"heading": heading, "grade": grade, "rms": value}
            for (heading, grade), value in results.drift.items()
        ],
        "smoothness": [
            {
                "batch_length": setting.batch_length,
                "mode": setting.mode,
                "as_output": roughness(tracks.live),
                "in_the_end": roughness(tracks.revised),
            }
            for setting, tracks in results.tracks.items()
        ],
        "claims": [asdict(claim) for claim in claims],
        "cases": {
            name: {key: value for key, value in summary.items() if key != "time"}
            for name, summary in summaries.items()
        },
        "time": {
            "wall_s": wall_seconds,
            "fix_ms_median": {
                name: summary["time"]["fix_ms_median"] for name, summary in summaries.items()
            },
        },
    }


def _row(results: Results, row: PublishedRow) -> dict[str, JsonValue]:
    return {
        "batch_length": row.batch_length,
        "sigma": row.sigma,
        "snr": results.snr(row),
        "published": {
            "mean": row.mean_error,
            "divergence_rate": row.divergence_rate,
            "snr": row.snr,
        },
        **{matcher: _brief(results.row(row, matcher)) for matcher in MATCHERS},
    }


def _brief(outcome: Outcome) -> dict[str, JsonValue]:
    summary = outcome.summary
    return {
        "mean": outcome.mean,
        "mean_standard_error": outcome.mean_uncertainty,
        "rms": summary["position_error"]["rms"],
        "rms_after_1h": summary["position_error"]["rms_after_1h"],
        "bound": summary["bound"],
        "nees_per_axis": summary["nees_per_axis"],
        "declined": summary["fixes"]["declined"],
        "divergence_rate": outcome.diverged / len(outcome.run_means),
    }
