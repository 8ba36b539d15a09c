"""The campaign: every fault some times, the outcomes on disk one by one, so that it can be
interrupted and goes on, and a table in the end."""

import json
from contextlib import suppress
from itertools import chain
from pathlib import Path

import typer

from isogal.files import write_atomic
from isogal.scenario import Scenario
from isogal_ros.faults.catalogue import MESSAGE_FAULTS, NODE_FAULTS, PROCESS_FAULTS, QUICK
from isogal_ros.faults.judgement import Outcome, Table, page_of, table_of
from isogal_ros.faults.trials import Feed, run_process_trial, run_trials
from isogal_ros.nodes.signals import Interrupt

OUTCOMES, TABLE, PAGE = "outcomes.jsonl", "faults.json", "faults.md"
KINDS = (MESSAGE_FAULTS, NODE_FAULTS, PROCESS_FAULTS)
QUICK_DURATION = 600.0
"""s of the route of a quick campaign."""


def quick_scenario(scenario: Scenario) -> Scenario:
    """Return the scenario with a shorter route."""
    route = scenario.route.model_copy(update={"duration": QUICK_DURATION})
    return scenario.model_copy(update={"route": route})


def run_campaign(
    scenario: Scenario,
    out: Path,
    trials: tuple[int, int],
    quick: bool,
    interrupt: Interrupt,
) -> Table:
    """Run what has not been run yet, with a line on standard error for each outcome, write table
    and page, and return the table.

    Parameters
    ----------
    scenario : Scenario
    out : Path
        Folder of the outcomes.
    trials : (int, int)
        Of each fault within one process, and of each fault of processes.
    quick : bool
        Whether only the faults of `QUICK` are run.
    interrupt : Interrupt

    Raises
    ------
    InputError
        Scenario or folder cannot be used.
    GraphError
        The run without fault failed.
    """
    done = _read(out / OUTCOMES)

    def keep(outcome: Outcome) -> None:
        done[outcome["fault"], outcome["trial"]] = outcome
        with (out / OUTCOMES).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(outcome) + "\n")
        typer.echo(_words(outcome), err=True)

    faults = [one for kind in KINDS for one in kind if not quick or one.name in QUICK]
    with suppress(KeyboardInterrupt):  # what has been run makes the table
        for trial in range(max(trials)):
            due = [one for one in faults if (one.name, trial) not in done]
            of_messages, of_nodes, of_processes = (
                [one for one in due if one in kind and trial < most]
                for kind, most in zip(KINDS, (trials[0], *trials), strict=True)
            )
            if interrupt or not (of_messages or of_nodes or of_processes):
                continue
            feed = Feed(scenario, trial, interrupt)
            interrupt.ends_at_once = True
            for one in chain(run_trials(feed, of_messages), run_trials(feed, of_nodes)):
                keep(one)
            interrupt.ends_at_once = False
            for fault in of_processes:
                if (found := run_process_trial(feed, fault, out / "running", interrupt)) is None:
                    break
                keep(found)
    interrupt.ends_at_once = False
    return _write(out, table_of(scenario, faults, done.values()))


def _write(out: Path, table: Table) -> Table:
    """Write a table into a folder, also as a page, and return it."""
    write_atomic(out / TABLE, json.dumps(table, indent=2))
    write_atomic(out / PAGE, page_of(table))
    return table


def _read(path: Path) -> dict[tuple[str, int], Outcome]:
    """Return the outcomes on disk, without a line that is cut off or of an earlier version."""
    found: dict[tuple[str, int], Outcome] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            outcome = json.loads(line)
            if "reported_after" in outcome:  # an earlier version called it otherwise
                found[outcome["fault"], outcome["trial"]] = outcome
        except (ValueError, KeyError, TypeError):
            continue
    return found


def _words(outcome: Outcome) -> str:
    trial = f"{outcome['fault']}, trial {outcome['trial']}:"
    if outcome["crash"]:
        return f"{trial} CRASH {outcome['crash']}"
    after, error = outcome["reported_after"], outcome["error_after"]
    reported = "not reported" if after is None else f"reported after {after:.0f} s"
    return f"{trial} {reported}, error {'unknown' if error is None else f'{error:.0f} m'} after it"
