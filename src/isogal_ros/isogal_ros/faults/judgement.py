"""What became of the navigator, and whether that was right."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from isogal.scenario import Scenario
from isogal_ros.bags.collect import Collector
from isogal_ros.faults.catalogue import Fault
from isogal_ros.faults.stage import Feed, track_of
from isogal_ros.messages.stamps import to_seconds

Row = dict[str, Any]
RECOVERED = 1.3
"""Of the error of the same runs without fault at the same time, RMS."""
ALLOWANCE = 30.0
"""m of error that is no harm in a single trial, where there is hardly any without fault; of n
trials it is as much less as the RMS of n runs is surer."""
STORES = ("truth", "last_nav", "readings", "fixes")
"""Messages of a `Collector` that are lost where only the run without fault has their stamp."""
COLUMNS = ("reported_after_s", "error_during_m", "error_after_m", "error_without_m")


class Span(NamedTuple):
    """When a fault was, and when it is looked at how it was recovered from, s."""

    begin: float
    end: float
    after: float
    until: float


def outcome_of(
    fault: Fault,
    feed: Feed,
    span: Span,
    collector: Collector,
    reports: Iterable[tuple[float, str]],
    crash: str | None = None,
) -> Row:
    """Return what became of the navigator in a run with a fault, as JSON can say it.

    Parameters
    ----------
    fault : Fault
    feed : Feed
        The same run without the fault.
    span : Span
    collector : Collector
        What was published.
    reports : iterable
        When (s) something was reported at WARN or ERROR because of the fault, and what.
    crash : str, optional
        What ended a node, or that the trial hung; None = nothing did.
    """
    track = track_of(collector)
    during = track.error[(track.time >= span.begin) & (track.time <= span.end)]
    after, without = (
        (one.time > span.after) & (one.time <= span.until) for one in (track, feed.track)
    )
    first, text = next(iter(reports), (None, None))
    kept = [[getattr(one, name) for name in STORES] for one in (feed.collector, collector)]
    return {
        "fault": fault.name,
        "trial": feed.run,
        "crash": crash,
        "restart": None,
        "unexpected_errors": [],
        "begin": span.begin,
        "not_finite": track.not_finite,
        "reported_after": None if first is None else max(first - span.begin, 0.0),
        "report": text,
        "error_during": float(during.max(initial=0.0)),
        "error_after": _rms(track.error[after]),
        "sigma_after": _rms(track.sigma[after]),
        "error_without": _rms(feed.track.error[without]),
        "lost": sum(
            to_seconds(ns) <= span.until
            for before, now in zip(*kept, strict=True)
            for ns in before.keys() - now.keys()
        ),
    }


def _rms(values: Any) -> float | None:
    """Return the root mean square; None where a value is missing, or all are."""
    whole = len(values) and not any(value is None for value in values)
    return float(np.sqrt(np.mean(np.square(values)))) if whole else None


def two_batches(scenario: Scenario) -> float:
    """Return how long two batches take, at most, s."""
    return 2.0 * scenario.matcher.batch_length * scenario.gravimeter.interval


def table_of(scenario: Scenario, faults: Iterable[Fault], outcomes: Iterable[Row]) -> Row:
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


def _row(fault: Fault, outcomes: Sequence[Row], limit: float) -> Row:
    """Judge a fault, which is reported in time within a limit (s), by all of its trials."""
    after = [o["reported_after"] for o in outcomes if o["reported_after"] is not None]
    in_time = sum(one <= limit for one in after)
    bad = {
        "crashes": sum(o["crash"] is not None for o in outcomes),
        "not_finite": sum(o["not_finite"] for o in outcomes),
        "unexpected_errors": sorted({text for o in outcomes for text in o["unexpected_errors"]}),
        "not_reported": len(outcomes) - in_time if fault.matters else 0,
    }
    rms, plain = (_rms([o[name] for o in outcomes]) for name in ("error_after", "error_without"))
    both = rms is not None and plain is not None
    allowed = RECOVERED * (plain or 0.0) + ALLOWANCE / np.sqrt(len(outcomes))
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
        and all(o["error_after"] < 3.0 * max(o["sigma_after"], ALLOWANCE) for o in outcomes),
        "lost": max(o["lost"] for o in outcomes),
        "restart_s": max(o["restart"] or 0.0 for o in outcomes) or None,
        **bad,
        "passed": bool(not any(bad.values()) and both and rms <= allowed),
    }


def page_of(table: Mapping[str, Any]) -> str:
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
        numbers = ["–" if row[name] is None else f"{row[name]:.0f}" for name in COLUMNS]
        numbers.append("–" if row["ratio"] is None else f"{row['ratio']:.2f}")
        reported = str(row["reported"]) if row["matters"] else f"({row['reported']})"
        silent = f" ({row['restart_s']:.1f} s)" if row["restart_s"] else ""
        cells = [row["fault"], str(row["trials"]), reported, *numbers, f"{row['lost']}{silent}"]
        lines.append(f"| {' | '.join(cells)} | {'yes' if row['passed'] else '**no**'} |")
    return "\n".join(lines) + "\n"
