"""The whole reproduction: cases through the workers, then measures, claims, page and numbers."""

import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import isogal
from isogal.evaluation.results import plain, write_json
from isogal.files import Json, make_folder
from isogal.montecarlo.progress import LiveProgress
from isogal.montecarlo.store import Store
from isogal.montecarlo.study import Backend, compute_cases
from isogal.paper.cases import MATCHERS, SETTINGS, Plan, Setting
from isogal.paper.claims import Claim, judge
from isogal.paper.document import write_page
from isogal.paper.measure import Results, measure
from isogal.paper.published import TABLE_4, TABLE_6, PublishedRow


def reproduce(
    plan: Plan, out: str | Path, backend: Backend, display: LiveProgress
) -> tuple[Results, tuple[Claim, ...], Path]:
    """Simulate what is not there yet, and write results.json, report.html and the figures.

    Parameters
    ----------
    plan : Plan
    out : path
        Folder; finished runs are kept in its folder ``runs``.
    backend : Backend
        Processes or machines that compute.
    display : LiveProgress
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


def as_json(results: Results, claims: Sequence[Claim], wall_seconds: float) -> dict[str, Json]:
    """Return all numbers as one document.

    The figures of merit of each case are in the format of results.json of a Monte Carlo."""
    plan = results.plan
    cases = {setting.name: plain(one.summary) for setting, one in results.outcomes.items()}
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
        "claims": [asdict(claim) for claim in claims],
        "cases": cases,
        "wall_s": wall_seconds,
    }


def _row(results: Results, row: PublishedRow) -> dict[str, Json]:
    """Return a row of a table as published, and what was found with each matcher; the rest is in
    the cases by their names."""
    here: dict[str, Json] = {}
    for matcher in MATCHERS:
        found = results.row(row, matcher)
        here[matcher] = {
            "case": found.setting.name,
            "mean": found.mean,
            "mean_standard_error": found.mean_uncertainty,
            "divergence_rate": found.diverged / len(found.run_means),
        }
    return {
        "batch_length": row.batch_length,
        "sigma": row.sigma,
        "snr": results.snr(row),
        "published": asdict(row),
        **here,
    }
