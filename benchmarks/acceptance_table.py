"""The table of `acceptance.py`."""

import math
from collections.abc import Callable, Mapping

from acceptance_figures import Comparison, RowFigures, compared
from rich.console import Console
from rich.table import Table


def _number(value: float | None, digits: int = 3) -> str:
    if value is None or not math.isfinite(value):
        return "–"
    return f"{value:.0f}" if abs(value) >= 10.0**digits else f"{value:.{digits}g}"


def _found(row: RowFigures) -> str:
    return " ".join(f"{100 * share:.0f}" for share in row.get("found", {}).values())


def _ratio(row: RowFigures) -> str:
    error = row.get("ratio_error")
    return _number(row["ratio"]) + ("" if error is None else f"±{error:.2f}")


def _pair(both: Comparison | None) -> str:
    return "–" if both is None else f"{both.ratio:.3f}±{both.ratio_error:.3f}"


Cell = Callable[[RowFigures, RowFigures, Comparison | None], str]
CELLS: tuple[tuple[str, Cell], ...] = (
    ("runs", lambda row, kept, both: str(row["runs"])),
    ("RMS m", lambda row, kept, both: _number(row["rms"])),
    ("kept", lambda row, kept, both: _number(kept.get("rms"))),
    ("pair", lambda row, kept, both: _pair(both)),
    ("bound", lambda row, kept, both: _number(row["bound"])),
    ("ratio", lambda row, kept, both: _ratio(row)),
    ("INS", lambda row, kept, both: _number(row.get("unaided"))),
    ("NEES", lambda row, kept, both: _number(row["nees"])),
    ("kept", lambda row, kept, both: _number(kept.get("nees"))),
    ("found %", lambda row, kept, both: _found(row)),
    ("div", lambda row, kept, both: str(row.get("diverged", "–"))),
    ("decl", lambda row, kept, both: str(row.get("declined", "–"))),
    ("> 5σ", lambda row, kept, both: str(row.get("beyond_claim", "–"))),
    ("fix ms", lambda row, kept, both: _number(row["fix_ms"].get("median"))),
    ("99 %", lambda row, kept, both: _number(row["fix_ms"].get("p99"))),
    ("max", lambda row, kept, both: _number(row["fix_ms"].get("max"))),
    ("kept ms", lambda row, kept, both: _number(kept.get("fix_ms", {}).get("median"))),
    ("h/CPU s", lambda row, kept, both: _number(row.get("run_hours_per_cpu_s"))),
    ("kept", lambda row, kept, both: _number(kept.get("run_hours_per_cpu_s"))),
    ("MB", lambda row, kept, both: f"{row['memory_mb']:.0f}"),
    ("worse", lambda row, kept, both: ", ".join(both.worse) if both else ""),
)
"""Of a row beside the kept one, by the columns' heads."""
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
    for title, _ in CELLS:
        table.add_column(title, justify="right", no_wrap=True)
    for name, row in now.items():
        before = kept.get(name, {})
        if "rms" in row:
            both = compared(row, kept.get(name))
            style = "red" if both and both.worse else None
            cells = (cell(row, before, both) for _, cell in CELLS)
            table.add_row(name, *cells, style=style)
        else:
            reason = "; ".join(f"{key}: {value}" for key, value in row.items())
            table.add_row(f"{name} – {reason}", style="red" if "failed" in row else "dim")
    console = Console(width=max(WIDE, Console().width), soft_wrap=True)
    console.print(table)
    console.print(_totals(now))


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
        f" slowest fix {slowest:.0f} ms, at most {memory:.0f} MB. Found at 30, 45, 60, 75 min,"
        " with a bias at 75, 90, 105, 120."
    )
