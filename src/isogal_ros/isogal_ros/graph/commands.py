"""The commands ``isogal run`` and ``isogal replay``: what they print, and their exit status."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from isogal.files import make_folder
from isogal.scenario import Scenario
from isogal_ros.graph.console import Console
from isogal_ros.graph.plan import GraphError
from isogal_ros.graph.replay import Replay
from isogal_ros.graph.session import Summary, replay_session, run_session
from isogal_ros.graph.watching import Live
from isogal_ros.nodes.signals import interrupts

FAILED, INTERRUPTED = 1, 130
TOLERANCE = 1.0
"""m, by which the fixes of a replay may differ unless the user says otherwise."""


def run_command(
    scenario: Scenario,
    out: Path,
    bag: Path | None,
    *,
    in_process: bool,
    rate: float,
    respawn: bool,
    json: bool,
    live: Live | None = None,
) -> int:
    """Run the graph and print its summary; return the exit status.

    Raises
    ------
    InputError
        Scenario, map, matcher or folders cannot be used.
    """
    console = Console()
    try:
        result = run_session(
            scenario,
            out,
            bag,
            in_process=in_process,
            rate=rate,
            to=console,
            respawn=respawn,
            live=live,
        )
    except GraphError as error:
        console.say(f"isogal: {error}")
        return FAILED
    if result.interrupted:
        console.say(
            f"Interrupted after {result.seconds:.0f} s; all nodes have ended. The recording is"
            f" kept: isogal replay {result.bag}"
        )
        return INTERRUPTED
    if result.summary is None:
        console.say("isogal: the run has no scan, so there is nothing to report")
        return FAILED
    if json:
        console.json(result.summary)
    else:
        console.summary(result.summary)
        console.result(f"Report: {out / 'report.html'}   recording: {result.bag}")
    return 0


def replay_command(
    bag: Path,
    out: Path | None,
    *,
    scenario: Scenario | None = None,
    overrides: Sequence[str] = (),
    tolerance: float | None = TOLERANCE,
    json: bool,
) -> int:
    """Replay a bag and print how its fixes differ; return the exit status.

    Parameters
    ----------
    tolerance : float or None
        m, the largest difference of fixes that is no failure; None = any difference will do.

    Raises
    ------
    InputError
        The bag or what it needs cannot be used.
    """
    console = Console()
    try:
        result, summary = replay_session(bag, out, console, scenario, overrides)
    except GraphError as error:
        console.say(f"isogal: {error}")
        return FAILED
    if json:
        console.json(_document(bag, result, summary, evaluated=out is not None))
    else:
        _print_replay(console, result)
        if out is not None:
            console.result(f"Report: {out / 'report.html'}")
    if result.interrupted:
        console.say(f"isogal: interrupted after {result.simulated:.0f} s of {bag}")
        return INTERRUPTED
    found = result.comparison
    if tolerance is not None and (
        found.disagreements or not found.largest_difference <= tolerance
    ):
        console.say(
            f"isogal: {bag}: the fixes differ by {found.largest_difference:.3g} m (tolerance"
            f" {tolerance:g} m), disagreements: {found.disagreements}"
        )
        return FAILED
    return 0


def faults_command(
    scenario: Scenario, out: Path, *, trials: tuple[int, int], quick: bool, json: bool
) -> int:
    """Run the fault campaign, some trials of each fault within one process and of each of
    processes; return the exit status: 1 where a fault did harm or was not told.

    Raises
    ------
    InputError
        Scenario or folder cannot be used.
    """
    from isogal_ros.faults.campaign import quick_scenario, run_campaign
    from isogal_ros.faults.table import PAGE

    console = Console()
    make_folder(out)
    try:
        with interrupts() as interrupt:
            table = run_campaign(
                quick_scenario(scenario) if quick else scenario,
                out,
                trials,
                quick,
                interrupt,
                console.say,
            )
    except GraphError as error:
        console.say(f"isogal: {error}")
        return FAILED
    if json:
        console.json(table)
    elif table["trials"]:
        console.result((out / PAGE).read_text(encoding="utf-8"))
    if interrupt:
        console.say(
            f"isogal: interrupted; the outcomes so far are kept in {out}, the same command goes on"
            " from there"
        )
        return INTERRUPTED
    return FAILED if table["failed"] else 0


def _document(
    bag: Path, result: Replay, summary: Summary | None, evaluated: bool
) -> dict[str, Any]:
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
    if evaluated and not result.interrupted:
        document["summary"] = summary
    return document


def _print_replay(console: Console, result: Replay) -> None:
    comparison = result.comparison
    for note in result.notes:
        console.result(f"Note: {note}.")
    console.result(f"Replayed {result.simulated:.0f} s in {result.wall_seconds:.1f} s.")
    console.result(
        f"Fixes: {comparison.recorded} recorded, {comparison.replayed} replayed,"
        f" {comparison.common} of the same stamp."
    )
    console.result(
        f"Largest difference: {comparison.largest_difference:.3g} m; disagreements:"
        f" {comparison.disagreements}."
    )
