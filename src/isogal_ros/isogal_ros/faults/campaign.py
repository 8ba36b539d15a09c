"""The campaign: every fault some times, the outcomes on disk one by one, so that it can be
interrupted and goes on, and a table in the end."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from isogal.scenario import Scenario
from isogal_ros.faults.catalogue import FAULTS, QUICK, Fault
from isogal_ros.faults.node_faults import NODE_FAULTS, NodeFault
from isogal_ros.faults.outcome import Outcome
from isogal_ros.faults.process_faults import PROCESS_FAULTS, ProcessFault
from isogal_ros.faults.process_trial import record_reference, run_process_trial
from isogal_ros.faults.stage import Feed
from isogal_ros.faults.table import write_table
from isogal_ros.faults.trial import Reference, run_trials
from isogal_ros.nodes.signals import Interrupt

OUTCOMES = "outcomes.jsonl"
QUICK_DURATION = 600.0
"""s of the route of a quick campaign."""
Say = Callable[[str], None]
AnyFault = Fault | NodeFault | ProcessFault


def quick_scenario(scenario: Scenario) -> Scenario:
    """Return the scenario with a shorter route."""
    route = scenario.route.model_copy(update={"duration": QUICK_DURATION})
    return scenario.model_copy(update={"route": route})


def chosen(quick: bool) -> tuple[Fault | NodeFault, ...]:
    """Return the faults of a campaign within one process."""
    every: tuple[Fault | NodeFault, ...] = (*FAULTS, *NODE_FAULTS)
    return tuple(fault for fault in every if not quick or fault.name in QUICK)


class Campaign:
    """Runs what has not been run yet.

    Parameters
    ----------
    scenario : Scenario
    out : Path
        Folder of the outcomes.
    interrupt : Interrupt
    say : callable
        Is told of each outcome.
    """

    def __init__(self, scenario: Scenario, out: Path, interrupt: Interrupt, say: Say) -> None:
        self._scenario, self._out = scenario, out
        self._interrupt, self._say = interrupt, say
        self._done = _read(out / OUTCOMES)

    def run(self, trials: int, quick: bool) -> None:
        """Run the faults within one process, some trials of each.

        Raises
        ------
        InputError
            The scenario cannot be used.
        GraphError
            The run without fault failed.
        """
        faults = chosen(quick)
        for trial in range(trials):
            missing = [fault for fault in faults if (fault.name, trial) not in self._done]
            if self._interrupt or not missing:
                continue
            feed = Feed.of(self._scenario, trial, self._interrupt)
            if self._interrupt:
                return
            reference = Reference.of(feed, self._interrupt)
            if self._interrupt:
                return
            if ("none", trial) not in self._done:
                self._keep(reference.outcome(trial))
            # checkpoints take time, and only nodes that are killed need them
            for kind in (Fault, NodeFault):
                some = [fault for fault in missing if isinstance(fault, kind)]
                if self._interrupt or not some:
                    continue
                for outcome in run_trials(feed, some, reference, self._interrupt):
                    self._keep(outcome)

    def run_processes(self, trials: int) -> None:
        """Run the faults of processes, some trials of each; raises as `run`."""
        for trial in range(trials):
            bag = self._out / f"recording-{trial}"
            if not bag.exists():
                self._say(f"Recording run {trial} ...")
                if not record_reference(self._scenario, bag, trial, self._interrupt):
                    return
            for fault in PROCESS_FAULTS:
                if (fault.name, trial) not in self._done and not self._interrupt:
                    folder = self._out / "running"
                    outcome = run_process_trial(
                        self._scenario, folder, bag, fault, trial, self._interrupt
                    )
                    if outcome is not None:
                        self._keep(outcome)

    def table(self, faults: tuple[AnyFault, ...]) -> dict[str, Any]:
        """Write table and page of what has been run of some faults; return the table."""
        return write_table(self._out, self._scenario, self._done, faults)

    def _keep(self, outcome: Outcome) -> None:
        document = outcome.document()
        self._done[outcome.fault, outcome.trial] = document
        with (self._out / OUTCOMES).open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(document) + "\n")
        self._say(f"{outcome.fault}, trial {outcome.trial}: {_words(document)}")


def run_campaign(
    scenario: Scenario,
    out: Path,
    trials: tuple[int, int],
    quick: bool,
    interrupt: Interrupt,
    say: Say,
) -> dict[str, Any]:
    """Run what has not been run yet; return the table.

    Parameters
    ----------
    trials : (int, int)
        Of each fault within one process, and of each fault of processes.

    Raises
    ------
    InputError
        Scenario or folder cannot be used.
    GraphError
        The run without fault failed.
    """
    campaign = Campaign(scenario, out, interrupt, say)
    campaign.run(trials[0], quick)
    if not quick:
        campaign.run_processes(trials[1])
    return campaign.table((*chosen(quick), *(() if quick else PROCESS_FAULTS)))


def _read(path: Path) -> dict[tuple[str, int], dict[str, Any]]:
    """Return the outcomes on disk; a line that is cut off is left out."""
    found = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        try:
            outcome = json.loads(line)
            found[outcome["fault"], outcome["trial"]] = outcome
        except (ValueError, KeyError, TypeError):
            continue
    return found


def _words(outcome: dict[str, Any]) -> str:
    if outcome["crash"]:
        return f"CRASH {outcome['crash']}"
    told = outcome["told_after"]
    return (
        f"{'not told' if told is None else f'told after {told:.0f} s'}, error"
        f" {outcome['error_after'] or float('nan'):.0f} m after it"
    )
