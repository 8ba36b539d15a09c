"""The campaign: every fault some times, the outcomes on disk one by one, so that it can be
interrupted and goes on, and a table in the end."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from isogal.files import write_atomic
from isogal.scenario import Scenario
from isogal_ros.bags.reader import BagReader
from isogal_ros.faults.catalogue import FAULTS, QUICK, Fault
from isogal_ros.faults.process_faults import PROCESS_FAULTS, ProcessFault
from isogal_ros.faults.process_trial import run_process_trial
from isogal_ros.faults.trial import run_trial
from isogal_ros.graph.in_process import run_in_process
from isogal_ros.graph.plan import Plan
from isogal_ros.nodes.signals import Interrupt

OUTCOMES, TABLE, PAGE = "outcomes.jsonl", "faults.json", "faults.md"
QUICK_DURATION = 600.0
"""s of the route of a quick campaign."""
RECOVERED = 1.3
"""Of the error of the same run without fault, in the last third."""
ALLOWANCE = 30.0
"""m of error that is no harm where there is hardly any without fault."""
FIGURES = (
    "told_after_s", "error_during_m", "error_after_m", "error_without_m", "lost", "restart_s",
)  # fmt: skip
"""Columns of the page."""
Say = Callable[[str], None]
AnyFault = Fault | ProcessFault


def quick_scenario(scenario: Scenario) -> Scenario:
    """Return the scenario with a shorter route."""
    route = scenario.route.model_copy(update={"duration": QUICK_DURATION})
    return scenario.model_copy(update={"route": route})


def run_campaign(
    scenario: Scenario, out: Path, trials: int, quick: bool, interrupt: Interrupt, say: Say
) -> dict[str, Any]:
    """Run what has not been run yet; return the table.

    Raises
    ------
    InputError
        Scenario or folder cannot be used.
    GraphError
        The run without fault failed.
    """
    every: tuple[AnyFault, ...] = (*FAULTS, *PROCESS_FAULTS)
    faults = [fault for fault in every if not quick or fault.name in QUICK]
    done = _read(out / OUTCOMES)
    for trial in range(trials):
        bag = out / f"recording-{trial}"
        if not bag.exists():
            say(f"Recording run {trial} ...")
            run_in_process(Plan(scenario, bag, run=trial), interrupt, lambda progress: None)
        for name, fault in _wanted(faults, trial, done):
            if interrupt:
                return _table(out, done, faults, trials)
            if isinstance(fault, ProcessFault):
                result = run_process_trial(scenario, out / "running", bag, fault, trial)
            else:
                result = run_trial(BagReader(bag), fault, scenario.seed, trial)
            outcome = result.document()
            done[name, trial] = outcome
            with (out / OUTCOMES).open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(outcome) + "\n")
            say(f"{name}, trial {trial}: {_words(outcome)}")
    return _table(out, done, faults, trials)


def _wanted(
    faults: list[AnyFault], trial: int, done: dict[tuple[str, int], Any]
) -> Iterator[tuple[str, AnyFault | None]]:
    if ("none", trial) not in done:
        yield "none", None
    for fault in faults:
        if (fault.name, trial) not in done:
            yield fault.name, fault


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


def _table(
    out: Path, done: dict[tuple[str, int], dict[str, Any]], faults: list[AnyFault], trials: int
) -> dict[str, Any]:
    rows = []
    for fault in faults:
        pairs = [
            (done[fault.name, trial], done["none", trial])
            for trial in range(trials)
            if (fault.name, trial) in done and ("none", trial) in done
        ]
        if pairs:
            rows.append(_row(fault, pairs))
    document = {
        "faults": rows,
        "trials": sum(row["trials"] for row in rows),
        "failed": [row["fault"] for row in rows if not row["passed"]],
    }
    write_atomic(out / TABLE, json.dumps(document, indent=2))
    write_atomic(out / PAGE, _page(document))
    return document


def _row(fault: AnyFault, pairs: list[tuple[dict[str, Any], dict[str, Any]]]) -> dict[str, Any]:
    outcomes = [outcome for outcome, _ in pairs]
    told = [o["told_after"] for o in outcomes if o["told_after"] is not None]
    after = np.array([o["error_after"] or np.nan for o in outcomes], float)
    without = np.array([o["error_after"] or np.nan for _, o in pairs], float)
    rms, rms_without = (float(np.sqrt(np.mean(x**2))) for x in (after, without))
    crashes = sum(o["crash"] is not None for o in outcomes)
    not_finite = sum(o["not_finite"] for o in outcomes)
    recovered = bool(rms <= RECOVERED * rms_without + ALLOWANCE)
    # an error that grew is no harm where the navigator knows it
    honest = all(
        (o["error_after"] or np.inf) < 3.0 * max(o["sigma_after"] or 0.0, ALLOWANCE)
        for o in outcomes
    )
    silent = fault.matters and len(told) < len(outcomes)
    return {
        "fault": fault.name,
        "trials": len(outcomes),
        "told": len(told),
        "told_after_s": float(np.median(told)) if told else None,
        "words": next((o["told"] for o in outcomes if o["told"]), None),
        "error_during_m": float(np.max([o["error_during"] or 0.0 for o in outcomes])),
        "error_after_m": None if np.isnan(rms) else rms,
        "error_without_m": None if np.isnan(rms_without) else rms_without,
        "lost": max(o.get("lost", 0) for o in outcomes),
        "restart_s": max((o.get("restart") or 0.0 for o in outcomes), default=0.0) or None,
        "crashes": crashes,
        "not_finite": not_finite,
        "passed": not (crashes or not_finite or silent) and (recovered or honest),
    }


def _page(document: dict[str, Any]) -> str:
    lines = [
        "# Faults",
        "",
        "Errors in m: the largest during the fault; RMS over the last third of the run, with the"
        " fault and without. Of faults of processes also the most messages lost and the longest"
        " time, s, that a node said nothing.",
        "",
        "| fault | trials | told | after, s | during | after | without | lost | silent | passed |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in document["faults"]:
        numbers = ("–" if row[name] is None else f"{row[name]:.0f}" for name in FIGURES)
        passed = "yes" if row["passed"] else "**no**"
        told = f"{row['told']} of {row['trials']}"
        lines.append(
            f"| {row['fault']} | {row['trials']} | {told} | {' | '.join(numbers)} | {passed} |"
        )
    return "\n".join(lines) + "\n"


def _words(outcome: dict[str, Any]) -> str:
    if outcome["crash"]:
        return f"CRASH {outcome['crash']}"
    told = outcome["told_after"]
    return (
        f"{'not told' if told is None else f'told after {told:.0f} s'}, error"
        f" {outcome['error_after'] or float('nan'):.0f} m after it"
    )
