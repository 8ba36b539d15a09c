"""A run of the graph, and a replay, from the check of the input to the report."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from isogal.evaluation.results import Summary
from isogal.fields.scenario_map import maps_for_scenario
from isogal.files import make_folder
from isogal.maps.several import RunMap, first_map
from isogal.scenario import Scenario, changed_scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory
from isogal_ros.bags.collect import Collector
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import record_of
from isogal_ros.bags.writer import prepare_folder
from isogal_ros.graph.checks import checked
from isogal_ros.graph.console import Console
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import Plan
from isogal_ros.graph.processes import run_processes
from isogal_ros.graph.replay import Replay, replay
from isogal_ros.graph.watching import Live, Watch, watching
from isogal_ros.nodes.signals import interrupts


@dataclass(frozen=True)
class Manner:
    """How the graph is run."""

    in_process: bool = False
    """Whether all nodes are in this process."""
    rate: float = 0.0
    """Simulated seconds per second; 0 = as fast as the graph can."""
    respawn: bool = False
    """Whether nodes that were killed are started again, from checkpoints in the folder of the
    results; of processes only."""
    domain: int | None = None
    """ROS domain that must be used; None = see `isogal_ros.graph.domain.graph_domain`."""


@dataclass(frozen=True)
class RunResult:
    """What a run leaves behind."""

    bag: Path
    interrupted: bool
    seconds: float
    """s of wall time until the graph had ended."""
    summary: Summary | None
    """None where it was interrupted, or has no scan."""


def run_session(
    scenario: Scenario,
    out: Path,
    bag: Path | None,
    how: Manner,
    to: Console,
    live: Live | None = None,
) -> RunResult:
    """Run the graph, then evaluate its recording.

    Parameters
    ----------
    out : Path
        Folder of summary, report and figures.
    bag : Path, optional
        Folder of the recording; None = ``bag`` in `out`, whose earlier one is replaced.
    to : Console
        Is told how far it is.
    live : Live, optional
        How the run is watched while it goes on.

    Raises
    ------
    InputError
        Scenario, map, matcher or folders cannot be used.
    GraphError
        A node failed.
    """
    to.say("Preparing the map and the route ...")
    trajectory, field_map = checked(scenario)
    folder = out / "bag" if bag is None else bag
    make_folder(out)
    prepare_folder(folder, replace=bag is None)
    survives = how.respawn and not how.in_process
    checkpoint = fresh_checkpoints(out / "checkpoint") if survives else None
    plan = Plan(scenario, folder, rate=how.rate, checkpoint=checkpoint, domain=how.domain)
    begun = time.monotonic()
    watch = Watch(scenario, trajectory, first_map(field_map), folder)
    with interrupts() as interrupt, watching(live, watch, to) as report:
        if how.in_process:
            outcome = run_in_process(plan, interrupt, report)
        else:
            outcome = run_processes(plan, out / "log", interrupt, report, to.announce)
    seconds = time.monotonic() - begun
    if outcome.interrupted:
        return RunResult(folder, True, seconds, None)
    to.say(f"The graph took {outcome.wall_seconds:.1f} s; writing the report ...")
    collector = Collector(scenario)
    collector.take_bag(BagReader(folder))
    summary = evaluate(collector, scenario, trajectory, field_map, out, outcome.wall_seconds)
    return RunResult(folder, False, seconds, summary)


def replay_session(
    bag: Path,
    out: Path | None,
    to: Console,
    scenario: Scenario | None = None,
    overrides: Sequence[str] = (),
    parameters: Mapping[str, Any] | None = None,
) -> tuple[Replay, Summary | None]:
    """Replay a bag and compare; evaluate the replay as well where there is a folder for it, the
    recording has the truth, and nobody interrupts.

    The scenario is the bag's own unless another is given, with keys changed by `overrides`
    (``KEY=VALUE``); for `parameters` see `replay`.

    Raises
    ------
    InputError
        The bag or what it needs cannot be used.
    """
    reader = BagReader(bag)
    scenario = scenario or reader.scenario()
    if scenario is not None and overrides:
        scenario = changed_scenario(scenario, overrides, f"{bag}: scenario")
    if out is not None:
        make_folder(out)
    with interrupts() as interrupt, to.progress() as report:
        result = replay(reader, interrupt, report, scenario, parameters)
    if out is None or result.interrupted:
        return result, None
    trajectory = build_trajectory(result.scenario)
    field_map = maps_for_scenario(result.scenario, trajectory)
    return result, evaluate(
        result.outputs, result.scenario, trajectory, field_map, out, result.wall_seconds
    )


def evaluate(
    collector: Collector,
    scenario: Scenario,
    trajectory: Trajectory,
    field_map: RunMap,
    out: Path,
    wall_seconds: float,
) -> Summary | None:
    """Write summary.json, report.html and figures; return the summary, or None where there is
    nothing to evaluate."""
    from isogal.evaluation.bound import posterior_cramer_rao
    from isogal.evaluation.results import write_json
    from isogal.evaluation.run_report import run_report
    from isogal.evaluation.summary import summarise

    runs = record_of(collector, field_map)
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


def fresh_checkpoints(folder: Path) -> Path:
    """Return a folder for checkpoints that holds none."""
    make_folder(folder)
    for file in folder.glob("*.checkpoint"):
        file.unlink()
    return folder
