"""The table of a campaign: what became of each fault."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from isogal.files import write_atomic
from isogal.scenario import Scenario

TABLE, PAGE = "faults.json", "faults.md"
RECOVERED = 1.3
"""Of the error of the same runs without fault at the same time, RMS."""
ALLOWANCE = 30.0
"""m of error that is no harm in a single trial, where there is hardly any without fault; of n
trials it is as much less as the RMS of n runs is surer."""
FIGURES = ("told_after_s", "error_during_m", "error_after_m", "error_without_m")
Done = Mapping[tuple[str, int], dict[str, Any]]


def write_table(
    out: Path, scenario: Scenario, done: Done, faults: Sequence[Any]
) -> dict[str, Any]:
    """Write table and page into a folder; return the table.

    Parameters
    ----------
    done : mapping
        Outcomes by fault and trial.
    faults : sequence
        Those that are wanted, in the order of the table.
    """
    two_batches = 2.0 * scenario.matcher.batch_length * scenario.gravimeter.interval
    rows = []
    for fault in faults:
        outcomes = [outcome for (name, _), outcome in done.items() if name == fault.name]
        if outcomes:
            rows.append(_row(fault, outcomes, two_batches))
    document = {
        "faults": rows,
        "trials": sum(row["trials"] for row in rows),
        "failed": [row["fault"] for row in rows if not row["passed"]],
    }
    write_atomic(out / TABLE, json.dumps(document, indent=2))
    write_atomic(out / PAGE, page(document))
    return document


def _row(fault: Any, outcomes: Sequence[dict[str, Any]], two_batches: float) -> dict[str, Any]:
    told = [o["told_after"] for o in outcomes if o["told_after"] is not None]
    in_time = [after for after in told if after <= two_batches]
    after = np.array([o["error_after"] or np.nan for o in outcomes], float)
    without = np.array([o["error_without"] or np.nan for o in outcomes], float)
    rms, rms_without = (float(np.sqrt(np.mean(x**2))) for x in (after, without))
    bad = {
        "crashes": sum(o["crash"] is not None for o in outcomes),
        "not_finite": sum(o["not_finite"] for o in outcomes),
        "surprises": sorted({text for o in outcomes for text in o.get("surprises", ())}),
        "not_told": len(outcomes) - len(in_time) if fault.matters else 0,
    }
    recovered = rms <= RECOVERED * rms_without + ALLOWANCE / np.sqrt(len(outcomes))
    # an error that grew is no harm where the navigator knows it
    honest = all(
        (o["error_after"] or np.inf) < 3.0 * max(o["sigma_after"] or 0.0, ALLOWANCE)
        for o in outcomes
    )
    return {
        "fault": fault.name,
        "trials": len(outcomes),
        "matters": fault.matters,
        "told": len(told),
        "told_after_s": float(np.median(told)) if told else None,
        "words": next((o["told"] for o in outcomes if o["told"]), None),
        "error_during_m": float(np.max([o["error_during"] or 0.0 for o in outcomes])),
        "error_after_m": None if np.isnan(rms) else rms,
        "error_without_m": None if np.isnan(rms_without) else rms_without,
        "ratio": None if np.isnan(rms) else rms / rms_without,
        "honest": honest,
        "lost": max(o.get("lost", 0) for o in outcomes),
        "restart_s": max((o.get("restart") or 0.0 for o in outcomes), default=0.0) or None,
        **bad,
        "passed": bool(not any(bad.values()) and recovered),
    }


def page(document: Mapping[str, Any]) -> str:
    """Return a table as a page."""
    rows = document["faults"]
    trials, failed = document["trials"], document["failed"]
    lines = [
        "# Faults",
        "",
        f"{len(rows)} faults, {trials} trials; passed: all but {', '.join(failed)}."
        if failed
        else f"{len(rows)} faults, {trials} trials; all passed.",
        "",
        "told: trials in which the diagnostics said WARN or ERROR, and after how many seconds, the"
        " median (in brackets: it need not be told). Errors in m: the largest during the fault;"
        " RMS after it, with the fault and without; ratio of the two. lost: states or messages, at"
        " most; of processes also for how long a node was silent, s.",
        "",
        "| fault | trials | told | after, s | during | after | without | ratio | lost | passed |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        numbers = ["–" if row[name] is None else f"{row[name]:.0f}" for name in FIGURES]
        numbers.append("–" if row["ratio"] is None else f"{row['ratio']:.2f}")
        silent = f" ({row['restart_s']:.1f} s)" if row["restart_s"] else ""
        told = str(row["told"]) if row["matters"] else f"({row['told']})"
        passed = "yes" if row["passed"] else "**no**"
        lines.append(
            f"| {row['fault']} | {row['trials']} | {told} | {' | '.join(numbers)}"
            f" | {row['lost']}{silent} | {passed} |"
        )
    return "\n".join(lines) + "\n"
