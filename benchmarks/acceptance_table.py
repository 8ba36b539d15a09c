"""The table of `acceptance.py`."""

import math
from collections.abc import Mapping

from acceptance_figures import Comparison, RowFigures, compared
from rich.console import Console
from rich.table import Table

HEAD = (
    *("runs", "RMS m", "kept", "pair", "bound", "ratio", "INS", "NEES", "kept", "found %"),
    *("div", "decl", "> 5σ", "fix ms", "99 %", "max", "kept ms", "h/CPU s", "kept", "MB", "worse"),
)
WIDE = 210
"""Columns: a narrower terminal breaks lines, but no number is cut (`make accept | less -S`)."""


def line_of(name: str, row: RowFigures, seconds: float) -> str:
    """Return a line about a row that has just been done."""
    if "rms" not in row:
        return f"{name}: {'; '.join(f'{key}: {value}' for key, value in row.items())}"
    found = f", found {_found(row)} %" if row.get("found") else ""
    return (
        f"{name}: RMS {_number(row['rms'])} m, ratio {_number(row['ratio'], 3)}, NEES"
        f" {_number(row['nees'])}{found} ({seconds:.0f} s)"
    )


def print_table(now: Mapping[str, RowFigures], kept: Mapping[str, RowFigures]) -> None:
    """Print all rows beside the kept ones, then what they took."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column("row", overflow="fold", max_width=60)
    for title in HEAD:
        table.add_column(title, justify="right", no_wrap=True)
    for name, row in now.items():
        before = kept.get(name, {})
        if "rms" in row:
            both = compared(row, kept.get(name))
            style = "red" if both and both.worse else None
            table.add_row(name, *cells_of(row, before, both), style=style)
        else:
            reason = "; ".join(f"{key}: {value}" for key, value in row.items())
            table.add_row(f"{name} – {reason}", style="red" if "failed" in row else "dim")
    console = Console(width=max(WIDE, Console().width), soft_wrap=True)
    console.print(table)
    console.print(_totals(now))


def cells_of(row: RowFigures, kept: RowFigures, both: Comparison | None) -> list[str]:
    """Return the cells of a row, in the order of `HEAD`."""
    fix, fix_kept = row["fix_ms"], kept.get("fix_ms", {})
    pair = "–" if both is None else f"{both.ratio:.3f}±{both.ratio_error:.3f}"
    ratio = _number(row["ratio"])
    if row.get("ratio_error") is not None:
        ratio += f"±{row['ratio_error']:.2f}"
    return [
        str(row["runs"]),
        _number(row["rms"]),
        _number(kept.get("rms")),
        pair,
        _number(row["bound"]),
        ratio,
        _number(row.get("unaided")),
        _number(row["nees"]),
        _number(kept.get("nees")),
        _found(row) or "",
        *(str(row.get(key, "–")) for key in ("diverged", "declined", "beyond_claim")),
        *(_number(fix.get(key)) for key in ("median", "p99", "max")),
        _number(fix_kept.get("median")),
        _number(row.get("run_hours_per_cpu_s")),
        _number(kept.get("run_hours_per_cpu_s")),
        f"{row['memory_mb']:.0f}",
        ", ".join(both.worse) if both else "",
    ]


def _found(row: RowFigures) -> str:
    return " ".join(f"{100 * share:.0f}" for share in row.get("found", {}).values())


def _number(value: float | None, digits: int = 3) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}"


def _totals(now: Mapping[str, RowFigures]) -> str:
    """Return in a line what the rows took."""
    rows = [row for row in now.values() if "run_hours_per_cpu_s" in row]
    if not rows:
        return ""
    fixes = [(row["fixes"] + row["declined"], row["fix_ms"]) for row in rows]
    median = sorted(fix["median"] for _, fix in fixes)[len(fixes) // 2]
    slowest = max(fix["max"] for _, fix in fixes)
    speed = sorted(row["run_hours_per_cpu_s"] for row in rows)[len(rows) // 2]
    memory, failed = max(row["memory_mb"] for row in rows), sum(r["failed_fixes"] for r in rows)
    return (
        f"{len(rows)} rows of runs, {sum(count for count, _ in fixes)} fixes, of which {failed}"
        f" failed; median of rows {speed:.2f} run-hours per CPU second and {median:.1f} ms a fix,"
        f" slowest fix {slowest:.0f} ms, at most {memory:.0f} MB. Found at 30, 45, 60, 75 min."
    )
