"""What became of the navigator, and whether that was right."""

from collections.abc import Iterable, Sequence
from typing import TypedDict

import numpy as np

from isogal.arrays import Array
from isogal.scenario import Scenario
from isogal_ros.faults.catalogue import Fault

RECOVERED = 1.3
"""Of the error of the same runs without fault at the same time, RMS."""
ALLOWANCE = 30.0
"""m of error that is no harm in a single trial, where there is hardly any without fault; of n
trials it is as much less as the RMS of n runs is surer."""


class Outcome(TypedDict):
    """What became of the navigator in a run with a fault: a line of ``outcomes.jsonl``. Times in
    s, errors in m; None = not known, or it did not happen."""

    fault: str
    trial: int
    crash: str | None
    """What ended a node, or that the trial hung."""
    restart: float | None
    """For how long a faulty process said nothing, at most."""
    unexpected_errors: list[str]
    begin: float
    not_finite: int
    reported_after: float | None
    report: str | None
    error_during: float
    """The largest."""
    error_after: float | None
    """RMS, as the claimed 1-sigma and the error of the run without fault."""
    sigma_after: float | None
    error_without: float | None
    lost: int


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
    honest: bool
    lost: int
    restart_s: float | None
    crashes: int
    not_finite: int
    unexpected_errors: list[str]
    not_reported: int
    passed: bool


class Table(TypedDict):
    """``faults.json``."""

    faults: list[Row]
    trials: int
    failed: list[str]


def rms_of(values: Sequence[float | None] | Array) -> float | None:
    """Return the root mean square; None where a value is missing, or all are."""
    known = [value for value in values if value is not None]
    whole = len(known) and len(known) == len(values)
    return float(np.sqrt(np.mean(np.square(known)))) if whole else None


def two_batches(scenario: Scenario) -> float:
    """Return how long two batches take, at most, s."""
    return 2.0 * scenario.matcher.batch_length * scenario.gravimeter.interval


def table_of(scenario: Scenario, faults: Iterable[Fault], outcomes: Iterable[Outcome]) -> Table:
    """Return the table of those faults of which there are outcomes."""
    known, limit = list(outcomes), two_batches(scenario)
    rows = [
        _row(fault, own, limit)
        for fault in faults
        if (own := [one for one in known if one["fault"] == fault.name])
    ]
    return {
        "faults": rows,
        "trials": sum(row["trials"] for row in rows),
        "failed": [row["fault"] for row in rows if not row["passed"]],
    }


def _row(fault: Fault, outcomes: Sequence[Outcome], limit: float) -> Row:
    """Judge a fault, which is reported in time within a limit (s), by all of its trials."""
    after = [o["reported_after"] for o in outcomes if o["reported_after"] is not None]
    crashes = sum(o["crash"] is not None for o in outcomes)
    not_finite = sum(o["not_finite"] for o in outcomes)
    errors = sorted({text for o in outcomes for text in o["unexpected_errors"]})
    late = len(outcomes) - sum(one <= limit for one in after) if fault.matters else 0
    rms = rms_of([o["error_after"] for o in outcomes])
    plain = rms_of([o["error_without"] for o in outcomes])
    # of n trials the RMS is surer
    allowed = RECOVERED * (plain or 0.0) + ALLOWANCE / np.sqrt(len(outcomes))
    recovered = rms is not None and plain is not None and bool(rms <= allowed)
    return {
        "fault": fault.name,
        "trials": len(outcomes),
        "matters": fault.matters,
        "reported": len(after),
        "reported_after_s": float(np.median(after)) if after else None,
        "report": next((o["report"] for o in outcomes if o["report"]), None),
        "error_during_m": max(o["error_during"] for o in outcomes),
        "error_after_m": rms,
        "error_without_m": plain,
        "ratio": rms / plain if rms is not None and plain else None,
        # an error that grew is no harm where the navigator knows it
        "honest": rms is not None
        and all(
            (o["error_after"] or 0.0) < 3.0 * max(o["sigma_after"] or 0.0, ALLOWANCE)
            for o in outcomes
        ),
        "lost": max(o["lost"] for o in outcomes),
        "restart_s": max(o["restart"] or 0.0 for o in outcomes) or None,
        "crashes": crashes,
        "not_finite": not_finite,
        "unexpected_errors": errors,
        "not_reported": late,
        "passed": recovered and not (crashes or not_finite or errors or late),
    }


def page_of(table: Table) -> str:
    """Return a table as a page."""
    rows, failed = table["faults"], table["failed"]
    passed = f"passed: all but {', '.join(failed)}" if failed else "all passed"
    lines = [
        "# Faults",
        "",
        f"{len(rows)} faults, {table['trials']} trials; {passed}.",
        "",
        "reported: trials in which the diagnostics said WARN or ERROR, and after how many seconds,"
        " the median (in brackets: it need not be reported). Errors in m: the largest during the"
        " fault; RMS after it, with the fault and without; ratio of the two. lost: states,"
        " readings and fixes of a stamp, at most; of processes also for how long a node was"
        " silent, s.",
        "",
        "| fault | trials | reported | after, s | during | after | without | ratio | lost |"
        " passed |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        errors = (row["error_during_m"], row["error_after_m"], row["error_without_m"])
        numbers = [_rounded(number, 0) for number in (row["reported_after_s"], *errors)]
        numbers.append(_rounded(row["ratio"], 2))
        reported = str(row["reported"]) if row["matters"] else f"({row['reported']})"
        silent = f" ({row['restart_s']:.1f} s)" if row["restart_s"] else ""
        cells = [row["fault"], str(row["trials"]), reported, *numbers, f"{row['lost']}{silent}"]
        lines.append(f"| {' | '.join(cells)} | {'yes' if row['passed'] else '**no**'} |")
    return "\n".join(lines) + "\n"


def _rounded(number: float | None, digits: int) -> str:
    return "–" if number is None else f"{number:.{digits}f}"
