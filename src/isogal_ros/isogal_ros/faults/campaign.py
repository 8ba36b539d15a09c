"""The campaign: every fault some times, the outcomes on disk one by one, so that it can be
interrupted and goes on; in the end each fault is judged by all of its trials, in a table."""

import json
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TypedDict

import numpy as np
import typer

from isogal.files import write_atomic
from isogal.scenario import Scenario
from isogal_ros.faults.catalogue import FAULTS, QUICK, Fault
from isogal_ros.faults.trials import Feed, Outcome, run_trial
from isogal_ros.nodes.signals import Interrupt

OUTCOMES, TABLE, PAGE = "outcomes.jsonl", "faults.json", "faults.md"
QUICK_DURATION = 600.0
"""s of the route of a quick campaign."""
RECOVERED = 1.3
"""Of the error of the same runs without fault at the same time, RMS."""
ALLOWANCE = 30.0
"""m of error that is no harm in a single trial, where there is hardly any without fault; of n
trials it is as much less as the RMS of n runs is surer."""
HEAD = """\
reported: trials in which the diagnostics said WARN or ERROR, and after how many seconds, the
median (in brackets: it need not be reported). Errors in m: the largest during the fault; RMS after
it, with the fault and without; ratio of the two. lost: states, readings and fixes of a stamp, at
most.

| fault | trials | reported | after, s | during | after | without | ratio | lost | passed |
|---|---|---|---|---|---|---|---|---|---|"""


class Row(TypedDict):
    """What became of all trials of a fault: an entry of ``faults.json``."""

    fault: str
    trials: int
    matters: bool
    reported: int
    reported_after_s: float | None
    report: str | None
    error_during_m: float
    error_after_m: float | None
    error_without_m: float | None
    ratio: float | None
    lost: int
    failures: list[str]
    """What it has not passed for; empty = it has."""


class Table(TypedDict):
    """``faults.json``."""

    faults: list[Row]
    trials: int
    failed: list[str]


def quick_scenario(scenario: Scenario) -> Scenario:
    """Return the scenario with a shorter route."""
    route = scenario.route.model_copy(update={"duration": QUICK_DURATION})
    return scenario.model_copy(update={"route": route})


def run_campaign(
    scenario: Scenario, out: Path, trials: int, quick: bool, interrupt: Interrupt
) -> Table:
    """Run what has not been run yet, with a line on standard error for each outcome, write table
    and page, and return the table.

    Parameters
    ----------
    scenario : Scenario
    out : Path
        Folder of the outcomes.
    trials : int
        Of each fault.
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
    faults = [one for one in FAULTS if not quick or one.name in QUICK]
    with suppress(KeyboardInterrupt):  # what has been run makes the table
        for trial in range(trials):
            due = [one for one in faults if (one.name, trial) not in done]
            if not due or interrupt:
                continue
            feed = Feed(scenario, trial, interrupt)
            interrupt.ends_at_once = True
            for fault in due:
                found = done[fault.name, trial] = run_trial(feed, fault)
                with (out / OUTCOMES).open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps(asdict(found)) + "\n")
                typer.echo(_words(found), err=True)
            interrupt.ends_at_once = False
    interrupt.ends_at_once = False
    table = table_of(scenario, faults, done.values())
    write_atomic(out / TABLE, json.dumps(table, indent=2))
    write_atomic(out / PAGE, page_of(table))
    return table


def _read(path: Path) -> dict[tuple[str, int], Outcome]:
    """Return the outcomes on disk, without a line that is cut off or of another version."""
    found: dict[tuple[str, int], Outcome] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else ():
        with suppress(ValueError, TypeError):
            outcome = Outcome(**json.loads(line))
            found[outcome.fault, outcome.trial] = outcome
    return found


def _words(outcome: Outcome) -> str:
    after, error = outcome.reported_after, outcome.error_after
    reported = "not reported" if after is None else f"reported after {after:.0f} s"
    left = f"error {'unknown' if error is None else f'{error:.0f} m'} after it"
    return ", ".join(
        [f"{outcome.fault}, trial {outcome.trial}: {reported}", left, *outcome.errors]
    )


def two_batches(scenario: Scenario) -> float:
    """Return how long two batches take, at most, s."""
    return 2.0 * scenario.matcher.batch_length * scenario.gravimeter.interval


def table_of(scenario: Scenario, faults: Iterable[Fault], outcomes: Iterable[Outcome]) -> Table:
    """Return the table of those faults of which there are outcomes."""
    known, limit = list(outcomes), two_batches(scenario)
    own = ((fault, [one for one in known if one.fault == fault.name]) for fault in faults)
    rows = [_row(fault, found, limit) for fault, found in own if found]
    return {
        "faults": rows,
        "trials": sum(row["trials"] for row in rows),
        "failed": [row["fault"] for row in rows if row["failures"]],
    }


def _row(fault: Fault, outcomes: Sequence[Outcome], limit: float) -> Row:
    """Judge a fault, which is reported in time within a limit (s), by all of its trials."""
    after = [o.reported_after for o in outcomes if o.reported_after is not None]
    late = len(outcomes) - sum(one <= limit for one in after) if fault.matters else 0
    rms, plain = _rms(o.error_after for o in outcomes), _rms(o.error_without for o in outcomes)
    allowed = RECOVERED * (plain or 0.0) + ALLOWANCE / len(outcomes) ** 0.5
    wrong = {
        "state not finite": sum(o.not_finite for o in outcomes),
        "not reported in time": late,
        "not recovered from": int(rms is None or plain is None or rms > allowed),
    }
    failures = [f"{count} x {what}" for what, count in wrong.items() if count]
    failures += sorted({text.splitlines()[-1] for o in outcomes for text in o.errors})
    return {
        "fault": fault.name,
        "trials": len(outcomes),
        "matters": fault.matters,
        "reported": len(after),
        "reported_after_s": float(np.median(after)) if after else None,
        "report": next((o.report for o in outcomes if o.report), None),
        "error_during_m": max(o.error_during for o in outcomes),
        "error_after_m": rms,
        "error_without_m": plain,
        "ratio": rms / plain if rms is not None and plain else None,
        "lost": max(o.lost for o in outcomes),
        "failures": failures,
    }


def _rms(values: Iterable[float | None]) -> float | None:
    """Return the root mean square; None where a value is missing."""
    found = np.array(list(values), dtype=float)
    return None if np.isnan(found).any() else float(np.sqrt(np.mean(found**2)))


def page_of(table: Table) -> str:
    """Return a table as a page."""
    failed = table["failed"]
    passed = f"passed: all but {', '.join(failed)}" if failed else "all passed"
    summary = f"{len(table['faults'])} faults, {table['trials']} trials; {passed}."
    lines = ["# Faults", "", summary, "", HEAD]
    for row in table["faults"]:
        numbers = [row["reported_after_s"], row["error_during_m"]]
        numbers += [row["error_after_m"], row["error_without_m"]]
        reported = f"{row['reported']}" if row["matters"] else f"({row['reported']})"
        cells = [row["fault"], str(row["trials"]), reported]
        cells += ["–" if number is None else f"{number:.0f}" for number in numbers]
        cells += ["–" if row["ratio"] is None else f"{row['ratio']:.2f}", str(row["lost"])]
        passed = f"**no**: {'; '.join(row['failures'])}" if row["failures"] else "yes"
        lines.append(f"| {' | '.join(cells)} | {passed} |")
    return "\n".join(lines) + "\n"
