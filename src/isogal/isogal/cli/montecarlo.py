"""``isogal montecarlo``: a scenario many times with other random numbers."""

import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from isogal.cli.errors import INTERRUPTED, fail, note
from isogal.cli.option_groups import with_groups
from isogal.cli.options import (
    MOST_RUNS,
    ScenarioChoice,
    Scheduler,
    StudyResults,
    Workers,
    flag,
    number,
    text,
)
from isogal.cli.tables import print_table

if TYPE_CHECKING:
    from isogal.evaluation.results import Summary
    from isogal.montecarlo.cases import Case
    from isogal.montecarlo.store import Store
    from isogal.scenario import Scenario


@with_groups
def montecarlo(
    results: StudyResults,
    runs: Annotated[int, number("How many runs.", "N", least=1, most=MOST_RUNS)],
    chosen: ScenarioChoice,
    workers: Workers = None,
    scheduler: Scheduler = None,
    matcher: Annotated[
        str | None, text("NAME", "Matcher to use instead of the scenario's.")
    ] = None,
    smooth: Annotated[
        bool, flag("--smooth", "Show besides how well all data of a run know each of its states.")
    ] = False,
) -> None:
    """Run a scenario many times; write results.json, report.html and figures, and print the
    figures of merit.

    Finished runs are kept in DIR/runs: Ctrl-C loses those being computed, the same command goes
    on, and more runs compute only the new ones. Results do not depend on the number or kind of
    workers."""
    from isogal.files import make_folder
    from isogal.montecarlo.progress import LiveProgress
    from isogal.montecarlo.store import Store
    from isogal.montecarlo.study import Backend, compute_cases

    settings = chosen.load(*([f"matcher.name={matcher}"] if matcher else ()))
    backend = Backend(workers, scheduler)
    case = _checked_case(settings, runs, smooth)
    store = Store(results.runs)
    make_folder(results.out)
    _say_what_is_replaced(results.out / "results.json", settings)
    start = time.monotonic()
    with ending_well(store.folder), LiveProgress(settings.matcher.name) as display:
        compute_cases([case], store, backend, display)
    summary, page = _evaluate(case, store, results.out, time.monotonic() - start)
    if results.json:
        typer.echo((results.out / "results.json").read_text(encoding="utf-8"), nl=False)
    else:
        _print(summary, page)


def _checked_case(settings: "Scenario", runs: int, smooth: bool) -> "Case":
    """Return the runs of a scenario; raises InputError where its matcher, route or map cannot be
    used."""
    from isogal.fields.scenario_map import maps_for_scenario
    from isogal.fields.simulator import check_readings, check_recorded
    from isogal.maps.several import each_map
    from isogal.matching.registry import build_run_matcher
    from isogal.montecarlo.cases import Case
    from isogal.sensors.trajectory import build_trajectory

    build_run_matcher(settings)
    trajectory = build_trajectory(settings)
    check_recorded(settings, trajectory)
    for line in settings.never_available(trajectory.time[-1]):
        note(line)
    field_map = maps_for_scenario(settings, trajectory)
    for one, its_map in zip(settings.each_field, each_map(field_map), strict=True):
        check_readings(one.true, one.map, trajectory, its_map)
        on_map = its_map.covers(trajectory.latitude, trajectory.longitude).mean()
        if on_map < 1.0:
            note(
                f"the map of {one.measured_field} has values on {on_map:.1%} of the track; where"
                " it has none nothing is matched"
            )
    return Case("montecarlo", settings, runs, field_map, smooth=smooth)


def _say_what_is_replaced(path: Path, settings: "Scenario") -> None:
    """Say where results that are there are of another scenario; raises InputError where they are
    no JSON."""
    from isogal.evaluation.results import canonical_json, read_object

    if path.is_file():
        own = json.loads(canonical_json(settings.model_dump(mode="json")))
        if read_object(path).get("scenario") != own:
            note(
                f"{path}: is of another scenario, and will be replaced, with the report beside it"
            )


def _evaluate(
    case: "Case", store: "Store", out: Path, wall_seconds: float
) -> "tuple[Summary, Path]":
    """Write results.json, the report and its figures; return the results and the report's path."""
    from isogal.evaluation.bound import posterior_cramer_rao
    from isogal.evaluation.results import write_json
    from isogal.evaluation.run_report import run_report
    from isogal.evaluation.summary import summarise
    from isogal.sensors.trajectory import build_trajectory

    settings, field_map = case.scenario, case.field_map
    record = store.load(case)
    trajectory = build_trajectory(settings)
    bound = posterior_cramer_rao(settings.true, trajectory, field_map, smoothed=case.smooth)
    summary = summarise(
        record,
        settings,
        bound.rms_at(record.time),
        smoothed_bound_rms=bound.smoothed_rms_at(record.time),
        wall_seconds=wall_seconds,
    )
    write_json(out / "results.json", summary)
    return summary, run_report(record, settings, field_map, bound, out, summary)


@contextmanager
def ending_well(kept_in: Path) -> Iterator[None]:
    """Where the computation is interrupted or fails, end the command with one line that says which
    runs are kept."""
    from isogal.montecarlo.study import Interrupted
    from isogal.montecarlo.workers import WorkerError

    try:
        yield
    except Interrupted as error:
        kept = f"{error.kept} of {error.total} runs are kept in {kept_in}"
        fail(f"interrupted: {kept}; the same command goes on from there", INTERRUPTED)
    except WorkerError as error:
        fail(f"{error}; finished runs are kept in {kept_in}", 1)


def _print(summary: "Summary", page: Path) -> None:
    from isogal.evaluation.run_report import key_figures

    table, fixes = key_figures(summary), summary["fixes"]
    runs = "1 run" if summary["runs"] == 1 else f"{summary['runs']} runs"
    title = f"{runs}, matcher {summary['matcher']}"
    print_table(table.header, table.rows, str(page), title=title)
    if failed := fixes["failed"]:
        note(f"the matcher failed on {failed} batches; the report says why")
    if rejected := fixes["rejected"]:
        note(f"the navigator rejected {rejected} fixes; the report says why")
