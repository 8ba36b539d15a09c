"""What the commands ``isogal run`` and ``isogal replay`` do, from the check of the input to the
report."""

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from json import dumps
from pathlib import Path
from typing import Any

from isogal.errors import InputError
from isogal.fields.measured import measured_field
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulator import true_readings
from isogal.maps.channels import AnyMap
from isogal.matching.registry import build_matcher
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.writer import prepare_folder
from isogal_ros.graph.domain import DEFAULTS, DOMAIN
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import GraphError, Plan, Progress
from isogal_ros.graph.processes import run_processes
from isogal_ros.nodes.spin import interrupts

FAILED, INTERRUPTED = 1, 130


def run_session(
    scenario: Scenario, out: Path, bag: Path | None, *, in_process: bool, rate: float, json: bool
) -> int:
    """Run the graph, then evaluate its recording; return the exit status.

    Raises
    ------
    InputError
        Scenario, map, matcher or folders cannot be used.
    """
    _say("Preparing the map and the route ...")
    trajectory = build_trajectory(scenario)
    build_matcher(scenario.matcher, measured_field(scenario).channels is not None)
    field_map = map_for_scenario(scenario, trajectory)
    true_readings(scenario, trajectory, field_map)  # as the sensor's node will want to have them
    folder = out / "bag" if bag is None else bag
    make_folder(out)
    prepare_folder(folder, replace=bag is None)
    plan = Plan(scenario, folder, rate=rate)
    begun = time.monotonic()
    try:
        with interrupts() as interrupt, _display() as display:
            if in_process:
                outcome = run_in_process(plan, interrupt, display)
            else:
                outcome = run_processes(plan, out / "log", interrupt, display, _announce)
    except GraphError as error:
        _say(f"isogal: {error}")
        return FAILED
    if outcome.interrupted:
        _say(
            f"Interrupted after {time.monotonic() - begun:.0f} s; all nodes have ended. The"
            f" recording is kept: isogal replay {folder}"
        )
        return INTERRUPTED
    _say(f"The graph took {outcome.wall_seconds:.1f} s; writing the report ...")
    collector = Collector(scenario)
    collector.take_bag(BagReader(folder))
    summary = evaluate(collector, scenario, trajectory, field_map, out, outcome.wall_seconds)
    if summary is None:
        _say("isogal: the run has no scan, so there is nothing to report")
        return FAILED
    if json:
        print(dumps(summary, indent=2, allow_nan=False))
    else:
        _print_summary(summary)
        print(f"Report: {out / 'report.html'}   recording: {folder}")
    return 0


def replay_session(bag: Path, out: Path | None, *, json: bool) -> int:
    """Replay a bag and compare; return the exit status.

    Raises
    ------
    InputError
        The bag or what it needs cannot be used.
    """
    from isogal_ros.bags.replay import replay

    reader = BagReader(bag)
    if out is not None:
        make_folder(out)
    try:
        with interrupts() as interrupt, _display() as display:
            result = replay(reader, interrupt, display)
    except GraphError as error:
        _say(f"isogal: {error}")
        return FAILED
    comparison = result.comparison
    document: dict[str, Any] = {
        "bag": str(bag),
        "simulated_s": result.simulated,
        "wall_s": result.wall_seconds,
        "fixes": {
            "recorded": comparison.recorded,
            "replayed": comparison.replayed,
            "common": comparison.common,
        },
        "disagreements": comparison.disagreements,
        "largest_difference_m": comparison.largest_difference,
        "notes": result.notes,
    }
    if out is not None and not result.interrupted:
        trajectory = build_trajectory(result.scenario)
        field_map = map_for_scenario(result.scenario, trajectory)
        document["summary"] = evaluate(
            result.outputs, result.scenario, trajectory, field_map, out, result.wall_seconds
        )
    if json:
        print(dumps(document, indent=2, allow_nan=False))
    else:
        for note in result.notes:
            print(f"Note: {note}.")
        print(f"Replayed {result.simulated:.0f} s in {result.wall_seconds:.1f} s.")
        print(
            f"Fixes: {comparison.recorded} recorded, {comparison.replayed} replayed,"
            f" {comparison.common} of the same stamp."
        )
        print(
            f"Largest difference: {comparison.largest_difference:.3g} m; disagreements:"
            f" {comparison.disagreements}."
        )
        if out is not None:
            print(f"Report: {out / 'report.html'}")
    return INTERRUPTED if result.interrupted else 0


def evaluate(
    collector: Collector,
    scenario: Scenario,
    trajectory: Trajectory,
    field_map: AnyMap,
    out: Path,
    wall_seconds: float,
) -> dict[str, Any] | None:
    """Write summary.json, report.html and figures; return the summary, or None where there is
    nothing to evaluate."""
    from isogal.evaluation.bound import posterior_cramer_rao
    from isogal.evaluation.run_report import run_report
    from isogal.evaluation.summary import summarise, write_json

    runs = collector.runs(field_map)
    if runs is None:
        return None
    bound = posterior_cramer_rao(scenario, trajectory, field_map)
    summary = summarise(
        runs,
        scenario,
        bound.rms_at(runs.time - runs.time[0] + bound.time[0]),
        wall_seconds=wall_seconds,
    )
    write_json(out / "summary.json", summary)
    run_report(runs, scenario, field_map, bound, out, summary)
    return summary


def make_folder(folder: Path) -> None:
    """Make an output folder; raises InputError where that cannot be."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made: {error.strerror}") from None


def _say(text: str) -> None:
    """Tell the user; standard output is for results."""
    print(text, file=sys.stderr, flush=True)


def _announce(domain: int) -> None:
    environment = " ".join(
        f"{name}={value}" for name, value in DEFAULTS.items() if name.startswith("ROS_")
    )
    _say(
        f"Four nodes and a recorder in ROS domain {domain}. To watch them, where ros2 is"
        f" installed:\n  {DOMAIN}={domain} {environment} ros2 topic echo /nav/fix"
    )


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


class _Display:
    """Live progress on a terminal; a line now and then where there is none."""

    def __init__(self, bar: Any, task: Any) -> None:
        self.bar, self.task = bar, task
        self.told = time.monotonic()
        self.begun: float | None = None

    def __call__(self, simulated: Progress | float, duration: float = 0.0) -> None:
        """Show how far it is: a `Progress`, or simulated time and duration (s)."""
        if isinstance(simulated, Progress):
            progress = simulated
        else:
            self.begun = self.begun or time.monotonic() - 1e-3
            progress = Progress(
                simulated, duration, simulated / (time.monotonic() - self.begun), float("nan")
            )
        error = (
            ""
            if progress.position_error != progress.position_error
            else f"error {progress.position_error:.0f} m"
        )
        text = (
            f"{_clock(progress.simulated)} of {_clock(progress.duration)}, {progress.speed:.0f} x"
            " real time"
        )
        if self.bar is not None:
            self.bar.update(
                self.task,
                completed=progress.simulated,
                total=progress.duration,
                text=text,
                error=error,
            )
        elif time.monotonic() - self.told > 5.0:
            self.told = time.monotonic()
            _say(f"  {text}{', ' + error if error else ''}")


@contextmanager
def _display() -> Iterator[_Display]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    if not console.is_terminal:
        yield _Display(None, None)
        return
    columns = (
        TextColumn("{task.fields[text]}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %  {task.fields[error]}"),
    )
    with Bar(*columns, console=console) as bar:
        yield _Display(
            bar, bar.add_task("run", total=None, text="Starting the nodes ...", error="")
        )


def _print_summary(summary: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table

    def metres(value: float | None) -> str:
        return "–" if value is None else f"{value:.1f} m"

    table = Table(show_header=True, header_style="bold")
    for name, justify in (
        ("position error", "left"),
        ("mean", "right"),
        ("RMS", "right"),
        ("RMS after 1 h", "right"),
    ):
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    error, unaided, bound = summary["position_error"], summary["unaided"], summary["bound"]
    table.add_row(
        "aided navigator",
        metres(error["mean"]),
        metres(error["rms"]),
        metres(error["rms_after_1h"]),
    )
    table.add_row("unaided INS", metres(unaided["mean"]), metres(unaided["rms"]), "")
    table.add_row("bound (Cramér-Rao)", "", metres(bound["rms"]), metres(bound["rms_after_1h"]))
    console = Console()
    console.print(table)
    nees, fixes = summary["nees_per_axis"], summary["fixes"]
    low, high = nees["interval"]
    if nees["mean"] is not None and low is not None:
        console.print(
            f"NEES per axis {nees['mean']:.2f} (a consistent filter: {low:.2f} to {high:.2f})"
        )
    took = summary["time"]
    each = (
        "" if took["fix_ms_median"] is None else f", {took['fix_ms_median']:.1f} ms each (median)"
    )
    console.print(
        f"Fixes: {fixes['published']} published, {fixes['declined']} declined{each}; wall time"
        f" {took['wall_s']:.1f} s"
    )
