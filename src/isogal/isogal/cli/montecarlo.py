"""``isogal montecarlo``: a scenario many times with other random numbers."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from isogal.cli.errors import INTERRUPTED, fail

ScenarioOption = Annotated[
    Path | None,
    typer.Option(
        "--scenario", metavar="FILE", help="Scenario file (YAML); default: all defaults."
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Change a key, e.g. gravimeter.sigma=2e-4; repeatable."
    ),
]
WorkersOption = Annotated[
    int | None,
    typer.Option(
        "--workers",
        metavar="N",
        min=1,
        help="Processes on this machine; default: one for each core.",
    ),
]
SchedulerOption = Annotated[
    str | None,
    typer.Option(
        "--scheduler", metavar="ADDRESS", help="Dask scheduler to use, e.g. tcp://host:8786."
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print results.json instead of a table.")]


def montecarlo(
    out: Annotated[
        Path,
        typer.Option("--out", metavar="DIR", help="Folder of results, report and finished runs."),
    ],
    runs: Annotated[int, typer.Option("--runs", metavar="N", min=1, help="How many runs.")],
    scenario: ScenarioOption = None,
    set_: SetOption = None,
    matcher: Annotated[
        str | None,
        typer.Option(
            "--matcher", metavar="NAME", help="Matcher to use instead of the scenario's."
        ),
    ] = None,
    workers: WorkersOption = None,
    scheduler: SchedulerOption = None,
    json: JsonOption = False,
) -> None:
    """Run a scenario many times; write results.json, report.html and figures, and print the
    figures of merit.

    Finished runs are kept in DIR/runs: Ctrl-C loses at most the chunks being computed, the same
    command goes on, and more runs compute only the new ones. Results do not depend on the number
    or kind of workers."""
    import time

    from isogal.evaluation.bound import posterior_cramer_rao
    from isogal.evaluation.run_report import run_report
    from isogal.evaluation.summary import canonical_json, summarise, write_json
    from isogal.fields.measured import measured_field
    from isogal.fields.scenario_map import map_for_scenario
    from isogal.fields.simulator import true_readings
    from isogal.matching.registry import build_matcher
    from isogal.montecarlo.chunks import Case
    from isogal.montecarlo.progress import LiveProgress
    from isogal.montecarlo.store import Store
    from isogal.montecarlo.study import Backend, compute_cases
    from isogal.scenario import load_scenario
    from isogal.sensors.trajectory import build_trajectory

    overrides = [*(set_ or ()), *([f"matcher.name={matcher}"] if matcher else ())]
    settings = load_scenario(scenario, overrides)
    backend = Backend(workers, scheduler)
    build_matcher(settings.matcher, measured_field(settings).channels is not None)
    trajectory = build_trajectory(settings)
    field_map = map_for_scenario(settings, trajectory)
    true_readings(settings, trajectory, field_map)
    case = Case("montecarlo", settings, runs, field_map)
    store = Store(out / "runs")
    out.mkdir(parents=True, exist_ok=True)

    start = time.monotonic()
    with ending_well(store.folder), LiveProgress(settings.matcher.name) as display:
        compute_cases([case], store, backend, display)
    wall = time.monotonic() - start

    record = store.load(case)
    bound = posterior_cramer_rao(settings, trajectory, field_map)
    summary = summarise(record, settings, bound.rms_at(record.time), wall_seconds=wall)
    write_json(out / "results.json", summary)
    page = run_report(record, settings, field_map, bound, out, summary)
    if json:
        typer.echo(canonical_json(summary), nl=False)
    else:
        _print(summary, page)


@contextmanager
def ending_well(kept_in: Path) -> Iterator[None]:
    """End the command with one line that says what is kept where the computation is interrupted or
    fails."""
    from isogal.montecarlo.study import Interrupted
    from isogal.montecarlo.workers import WorkerError

    try:
        yield
    except Interrupted as error:
        kept = f"{error.kept} of {error.total} runs are kept in {kept_in}"
        fail(f"interrupted: {kept}; the same command goes on from there", INTERRUPTED)
    except WorkerError as error:
        fail(f"{error}; finished runs are kept in {kept_in}", 1)


def _print(summary: dict[str, Any], page: Path) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table

    from isogal.evaluation.html_report import number

    error, bound, nees = summary["position_error"], summary["bound"], summary["nees_per_axis"]
    fixes = summary["fixes"]
    table = Table(
        box=SIMPLE_HEAD,
        title=f"{summary['runs']} runs, matcher {summary['matcher']}",
        title_justify="left",
    )
    table.add_column("")
    table.add_column("whole run", justify="right")
    table.add_column("after 1 h", justify="right")
    table.add_row("mean position error (m)", number(error["mean"]), number(error["mean_after_1h"]))
    table.add_row("RMS position error (m)", number(error["rms"]), number(error["rms_after_1h"]))
    table.add_row("bound, RMS (m)", number(bound["rms"]), number(bound["rms_after_1h"]))
    table.add_row("unaided INS, RMS (m)", number(summary["unaided"]["rms"]), "")
    table.add_row("NEES per axis", number(nees["mean"]), "")
    table.add_row("  consistent within", " to ".join(number(end) for end in nees["interval"]), "")
    table.add_row("diverged runs", str(summary["diverged"]), "")
    table.add_row("fixes, declined", f"{fixes['published']}, {fixes['declined']}", "")
    console = Console()
    console.print(table)
    console.print(f"{page}", highlight=False, soft_wrap=True)
