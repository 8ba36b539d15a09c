"""The commands ``isogal run``, ``isogal replay`` and ``isogal faults``: their steps from the check
of the input to the report, what they print, and their exit status. Results go to standard output,
all else to standard error."""

import os
from collections.abc import Mapping
from pathlib import Path
from threading import Thread, get_native_id
from typing import TYPE_CHECKING

import typer
from pydantic import JsonValue

from isogal.cli.errors import INTERRUPTED, note
from isogal.cli.tables import print_json, print_table
from isogal.evaluation.figures import style
from isogal.evaluation.html_report import number
from isogal.evaluation.results import Summary
from isogal.evaluation.run_report import key_figures, run_report
from isogal.fields.derived_maps import shared_maps
from isogal.fields.scenario_map import maps_for_scenario
from isogal.files import make_folder
from isogal.maps.several import RunMap, first_map
from isogal.scenario import Scenario, changed_scenario, load_scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import Collector, gaps, record_of
from isogal_ros.bags.writer import prepare_folder
from isogal_ros.graph.domain import users_domain
from isogal_ros.graph.parameter_files import filter_parameters
from isogal_ros.graph.plan import GraphError, Plan, checked
from isogal_ros.graph.replay import Replay, replay
from isogal_ros.graph.running import run_in_process, run_processes
from isogal_ros.graph.smoothing import WHOLE, keep_recording, smoothed_files
from isogal_ros.graph.watching import Watch, watching
from isogal_ros.nodes.signals import interrupts

if TYPE_CHECKING:
    from isogal.cli.run import GraphChoice, ReplayChoice

FAILED = 1
NO_FIXES = f"no fixes in the recording ({topics.FIX.name}) to compare with"
TOLERANCE = 1.0
"""m, by which the fixes of a replay may differ where the user has changed nothing."""


@shared_maps()
def run_command(
    scenario: Scenario, out: Path, bag: Path | None, *, how: "GraphChoice", json: bool
) -> int:
    """Run the graph, evaluate its recording and print the summary; return the exit status.

    Parameters
    ----------
    scenario : Scenario
    out : Path
        Folder of summary, report and figures.
    bag : Path, optional
        Folder of the recording; None = ``bag`` in `out`, whose earlier one is replaced.
    how : GraphChoice
    json : bool
        Whether the summary is printed as JSON.

    Raises
    ------
    InputError
        Scenario, map, matcher, folders or ROS domain cannot be used.
    """
    if how.domain is None:
        users_domain()  # a bad one is refused before the map is made
    typer.echo("Preparing the map and the route ...", err=True)
    trajectory, field_map = checked(scenario)
    for line in scenario.never_available(trajectory.time[-1]):
        note(line)
    folder = out / "bag" if bag is None else bag
    make_folder(out)
    prepare_folder(folder, replace=bag is None)
    survives = how.respawn and not how.in_process
    checkpoint = _fresh_checkpoints(out / "checkpoint") if survives else None
    plan = Plan(scenario, folder, rate=how.rate, checkpoint=checkpoint, domain=how.domain)
    watch = Watch(scenario, trajectory, first_map(field_map), folder)
    shown = watching(watch, dashboard=how.dashboard, port=how.port if how.live else None)
    Thread(target=_load_plotting, daemon=True).start()
    try:
        with interrupts() as interrupt, shown as report:
            if how.in_process:
                wall = run_in_process(plan, interrupt, report)
            else:
                wall = run_processes(plan, out / "log", interrupt, report)
    except GraphError as error:
        note(str(error))
        return FAILED
    if interrupt:
        typer.echo(f"Interrupted; all nodes have ended. Recorded so far: {folder}", err=True)
        return INTERRUPTED
    typer.echo(f"The graph took {wall:.1f} s; writing the report ...", err=True)
    (collector := Collector(scenario)).take_bag(BagReader(folder))
    summary = _evaluate(collector, trajectory, field_map, out, wall)
    if summary is None:
        note("the run has no scan, so there is nothing to report")
        return FAILED
    if json:
        print_json(summary)
        return 0
    table, below = key_figures(summary), f"Report: {out / 'report.html'}   recording: {folder}"
    print_table(table.header, table.rows, below)
    return 0


def _played(
    bag: Path, out: Path | None, chosen: "ReplayChoice", own: Mapping[str, JsonValue]
) -> tuple[BagReader, Replay]:
    """Return a bag, and what its replay leaves behind.

    Parameters
    ----------
    bag : Path
    out : Path, optional
        Folder that is made before.
    chosen : ReplayChoice
        What is not as it was recorded.
    own : mapping
        Parameters of the filter's node, unless the user sets them.

    Raises
    ------
    InputError
        The bag, or what it needs, or a change, cannot be used.
    """
    of_filter = {**own, **filter_parameters(chosen.parameter or ())}
    reader = BagReader(bag, chosen.remap or (), chosen.driver or ())
    scenario = reader.scenario() if chosen.scenario is None else load_scenario(chosen.scenario)
    if scenario is not None and chosen.set_:
        scenario = changed_scenario(scenario, chosen.set_, f"{bag}: scenario")
    if out is not None:
        make_folder(out)
    with interrupts() as interrupt, watching() as report:
        return reader, replay(reader, interrupt, report, scenario, of_filter)


@shared_maps()
def replay_command(
    bag: Path, out: Path | None, chosen: "ReplayChoice", *, tolerance: float | None, json: bool
) -> int:
    """Replay a bag and print how its fixes differ, and evaluate the replay as well where there is
    a folder for it, the recording has the truth, and nobody interrupts; return the exit status: 1
    where the fixes differ by too much, or the replay has used no message of a sensor, or has given
    no fix.

    Parameters
    ----------
    bag : Path
    out : Path, optional
        Folder of summary, report and figures.
    chosen : ReplayChoice
        What is not as it was recorded.
    tolerance : float or None
        m, the largest difference of fixes that is no failure; None = `TOLERANCE`, but any where
        the user has changed something, and none where the recording has no fixes.
    json : bool
        Whether the result is printed as JSON.

    Raises
    ------
    InputError
        The bag or what it needs cannot be used.
    """
    _, result = _played(bag, out, chosen, {})
    summary = None
    if out is not None and not result.interrupted:
        route = build_trajectory(result.scenario)
        its_map = maps_for_scenario(result.scenario, route)
        summary = _evaluate(result.outputs, route, its_map, out, result.wall_seconds)
    _print_replay(bag, out, result, summary, json)
    if result.interrupted:
        note(f"interrupted after {result.simulated:.0f} s of {bag}")
        return INTERRUPTED
    failures = result.failures or _differences(result, tolerance, any(vars(chosen).values()))
    for why in failures:
        note(f"{bag}: {why}")
    return FAILED if failures else 0


def smooth_command(
    bag: Path, out: Path, chosen: "ReplayChoice", *, interval: float, json: bool
) -> int:
    """Smooth a recorded voyage, write files and a bag, and print how good it is where the truth is
    recorded; return the exit status: 1 where the filter has used nothing of a sensor.

    Parameters
    ----------
    bag, out : Path
        The recording, and the folder to write into.
    chosen : ReplayChoice
        What is not as it was recorded.
    interval : float
        s between the rows of the files, at least.
    json : bool
        Whether the result is printed as JSON.

    Raises
    ------
    InputError
        The bag or what it needs cannot be used.
    """
    keep_recording(out / "bag")
    reader, played = _played(bag, out, chosen, WHOLE)
    if played.interrupted:
        note(f"interrupted; nothing is written of {bag}")
        return INTERRUPTED
    states, figures, paths = smoothed_files(reader, played, out, interval)
    files = [str(path) for path in paths]
    for line in [*played.notes, *played.failures]:
        note(f"{bag}: {line}")
    if json:
        print_json({"states": states, **figures, "files": files})
    else:
        names = {"position_error_rms": "RMS position error (m)", "nees_per_axis": "NEES per axis"}
        rows = [(names[name], *map(number, of.values())) for name, of in figures.items()]
        if rows:
            print_table(("", "smoothed", "at the time"), rows)
        typer.echo("\n".join(files))
    return FAILED if played.failures else 0


def faults_command(scenario: Scenario, out: Path, *, trials: int, quick: bool, json: bool) -> int:
    """Run the fault campaign; return the exit status: 1 where a fault did harm or was not
    reported.

    Parameters
    ----------
    scenario : Scenario
    out : Path
        Folder of outcomes and table.
    trials : int
        Of each fault.
    quick : bool
        Whether only a few faults are run, over a shorter route.
    json : bool
        Whether the table is printed as JSON.

    Raises
    ------
    InputError
        Scenario or folder cannot be used.
    """
    from isogal_ros.faults.campaign import PAGE, run_campaign

    make_folder(out)
    try:
        with interrupts() as interrupt:
            table = run_campaign(scenario, out, trials, quick, interrupt)
    except GraphError as error:
        note(str(error))
        return FAILED
    if json:
        print_json(dict(table))
    elif table["trials"]:
        print((out / PAGE).read_text(encoding="utf-8"))
    if interrupt:
        note(
            f"interrupted; the outcomes so far are kept in {out}, the same command goes on"
            " from there"
        )
        return INTERRUPTED
    return FAILED if table["failed"] else 0


def _load_plotting() -> None:
    """Load what figures are drawn with while the graph runs, with what it leaves of the cores."""
    os.setpriority(os.PRIO_PROCESS, get_native_id(), 19)
    style.png(style.new_figure(1.0))


def _evaluate(
    collector: Collector,
    trajectory: Trajectory,
    field_map: RunMap,
    out: Path,
    wall_seconds: float,
) -> Summary | None:
    """Write summary.json, report.html and figures; return the summary, or None where there is
    nothing to evaluate."""
    from isogal.evaluation.bound import posterior_cramer_rao
    from isogal.evaluation.results import write_json
    from isogal.evaluation.summary import summarise

    runs, scenario = record_of(collector, field_map), collector.scenario
    if runs is None or not collector.readings:
        return None
    bound = posterior_cramer_rao(scenario.true, trajectory, field_map)
    rms = bound.rms_at(runs.time - runs.time[0] + bound.time[0])
    summary = summarise(runs, scenario, rms, wall_seconds=wall_seconds)
    summary["recording"] = {"gaps": gaps(collector)}
    for begin, end in summary["recording"]["gaps"]:
        note(f"nothing is recorded from {begin:.0f} to {end:.0f} s: the figures leave that out")
    write_json(out / "summary.json", summary)
    run_report(runs, scenario, field_map, bound, out, summary)
    return summary


def _fresh_checkpoints(folder: Path) -> Path:
    """Return a folder for checkpoints that holds none."""
    make_folder(folder)
    for file in folder.glob("*.checkpoint"):
        file.unlink()
    return folder


def _differences(result: Replay, tolerance: float | None, changed: bool) -> list[str]:
    """Say that the fixes differ by more than they may, if they do."""
    count, apart = result.disagreements, result.largest_difference
    if count is None:
        return [] if tolerance is None else [f"there are {NO_FIXES}: --tolerance {tolerance:g}"]
    allowed = TOLERANCE if tolerance is None else tolerance
    if (tolerance is None and changed) or (count == 0 and (apart or 0.0) <= allowed):
        return []
    by = "have no stamp in common" if apart is None else f"differ by {apart:.3g} m"
    return [f"the fixes {by} (tolerance {allowed:g} m), disagreements: {count}"]


def _print_replay(
    bag: Path, out: Path | None, result: Replay, summary: Summary | None, json: bool
) -> None:
    apart = result.largest_difference
    report = out / "report.html" if out is not None and summary is not None else None
    if json:
        fixes = {name: getattr(result, name) for name in ("recorded", "replayed", "common")}
        document = {
            "bag": str(bag),
            "simulated_s": result.simulated,
            "wall_s": result.wall_seconds,
            "fixes": fixes,
            "disagreements": result.disagreements,
            "largest_difference_m": apart,
            "notes": result.notes,
            "failures": result.failures,
        }
        if out is not None and not result.interrupted:
            document |= {"summary": summary, "report": report and str(report)}
        print_json(document)
        return
    for text in result.notes:
        print(f"Note: {text}.")
    print(f"Replayed {result.simulated:.0f} s in {result.wall_seconds:.1f} s.")
    print(
        f"Fixes: {result.recorded} recorded, {result.replayed} replayed,"
        f" {result.common} of the same stamp."
    )
    if result.disagreements is None:
        print(f"Not compared: there are {NO_FIXES}.")
    else:
        largest = "" if apart is None else f" Largest difference: {apart:.3g} m;"
        print(f"Compared:{largest} disagreements: {result.disagreements}.")
    if report is not None:
        print(f"Report: {report}")
    elif out is not None:
        print(f"No report: it needs a whole replay, and {topics.TRUTH_FIX.name} at its scans.")
