"""The commands ``isogal run`` and ``isogal replay``: what they print, and their exit status."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from isogal.evaluation.results import Summary
from isogal.files import make_folder
from isogal.scenario import Scenario
from isogal_ros import topics
from isogal_ros.graph.console import Console
from isogal_ros.graph.parameter_files import filter_parameters
from isogal_ros.graph.plan import GraphError
from isogal_ros.graph.replay import Replay
from isogal_ros.graph.session import Manner, replay_session, run_session
from isogal_ros.graph.watching import Live
from isogal_ros.nodes.signals import interrupts

FAILED, INTERRUPTED = 1, 130
NO_FIXES = f"no fixes in the recording ({topics.FIX.name}) to compare with"
TOLERANCE = 1.0
"""m, by which the fixes of a replay may differ where the user has changed nothing."""


def run_command(
    scenario: Scenario,
    out: Path,
    bag: Path | None,
    *,
    how: Manner,
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
        result = run_session(scenario, out, bag, how, console, live)
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
    parameters: Sequence[str] = (),
    tolerance: float | None = None,
    json: bool,
) -> int:
    """Replay a bag and print how its fixes differ; return the exit status: 1 where they differ by
    too much, or the replay has used no message of a sensor, or has given no fix.

    Parameters
    ----------
    overrides, parameters : sequence of str
        Changed keys of the scenario, and own parameters of the filter's node.
    tolerance : float or None
        m, the largest difference of fixes that is no failure; None = `TOLERANCE`, but any
        difference where the scenario or a parameter is another, and none where the recording has
        no fixes.

    Raises
    ------
    InputError
        The bag or what it needs cannot be used.
    """
    console = Console()
    of_filter = filter_parameters(parameters)
    result, summary = replay_session(bag, out, console, scenario, overrides, of_filter)
    if json:
        console.json(_document(bag, out, result, summary))
    else:
        _print_replay(console, result)
        if out is not None:
            console.result(_of_report(out, result, summary))
    if result.interrupted:
        console.say(f"isogal: interrupted after {result.simulated:.0f} s of {bag}")
        return INTERRUPTED
    changed = scenario is not None or bool(overrides or parameters)
    differs = None if result.failures else _difference(result, tolerance, changed)
    for why in [differs] if differs else result.failures:
        console.say(f"isogal: {bag}: {why}")
    return FAILED if differs or result.failures else 0


def _difference(result: Replay, tolerance: float | None, changed: bool) -> str | None:
    """Say that the fixes differ by more than they may; None = they do not."""
    found = result.comparison
    if found.disagreements is None:
        return None if tolerance is None else f"there are {NO_FIXES}: --tolerance {tolerance:g}"
    if tolerance is None and changed:
        return None
    allowed = TOLERANCE if tolerance is None else tolerance
    if found.within(allowed):
        return None
    apart = found.largest_difference
    by = "have no stamp in common" if apart is None else f"differ by {apart:.3g} m"
    return f"the fixes {by} (tolerance {allowed:g} m), disagreements: {found.disagreements}"


def _of_report(out: Path, result: Replay, summary: Summary | None) -> str:
    """Say where the report is, or why there is none."""
    if summary is not None:
        return f"Report: {out / 'report.html'}"
    if result.interrupted:
        return "No report: the replay was interrupted."
    if not result.outputs.truth:
        name = topics.TRUTH_FIX.name
        return f"No report: the recording has no {name}, so errors are not known."
    return (
        "No report: there is no scan of which both the truth and the navigator's state are known."
    )


def faults_command(
    scenario: Scenario, out: Path, *, trials: tuple[int, int], quick: bool, json: bool
) -> int:
    """Run the fault campaign, some trials of each fault within one process and of each of
    processes; return the exit status: 1 where a fault did harm or was not reported.

    Raises
    ------
    InputError
        Scenario or folder cannot be used.
    """
    from isogal_ros.faults.campaign import PAGE, quick_scenario, run_campaign

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
    bag: Path, out: Path | None, result: Replay, summary: Summary | None
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
        "failures": result.failures,
    }
    if out is not None and not result.interrupted:
        document["summary"] = summary
        document["report"] = None if summary is None else str(out / "report.html")
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
    if comparison.disagreements is None:
        console.result(f"Not compared: there are {NO_FIXES}.")
    elif comparison.largest_difference is None:
        console.result(f"Disagreements: {comparison.disagreements}.")
    else:
        console.result(
            f"Largest difference: {comparison.largest_difference:.3g} m; disagreements:"
            f" {comparison.disagreements}."
        )
