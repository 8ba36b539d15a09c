"""What the commands print: results on standard output, all else on standard error."""

import math
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from json import dumps
from typing import Any

from isogal.evaluation.results import Summary
from isogal_ros.graph.domain import DISCOVERY, DOMAIN
from isogal_ros.graph.progress import Progress, Report

EVERY = 5.0
"""s between lines about the progress where there is no terminal."""


class Console:
    """Where a command tells its user."""

    def say(self, text: str) -> None:
        """Print a line that is no result."""
        print(text, file=sys.stderr, flush=True)

    def result(self, text: str) -> None:
        """Print a line of the result."""
        print(text)

    def json(self, document: Mapping[str, Any]) -> None:
        """Print the result as JSON."""
        print(dumps(document, indent=2, allow_nan=False))

    def announce(self, domain: int) -> None:
        """Say how the nodes can be watched."""
        environment = " ".join(f"{name}={value}" for name, value in DISCOVERY.items())
        self.say(
            f"The nodes and a recorder are in ROS domain {domain}. To watch them, where ros2 is"
            f" installed:\n  {DOMAIN}={domain} {environment} ros2 topic echo /nav/fix"
        )

    @contextmanager
    def progress(self) -> Iterator[Report]:
        """Yield what shows the progress: a bar on a terminal, else a line now and then."""
        from rich.console import Console as Terminal

        terminal = Terminal(stderr=True)
        if terminal.is_terminal:
            with _bar(terminal) as show:
                yield show
        else:
            yield self._lines()

    def _lines(self) -> Report:
        told = time.monotonic()

        def show(progress: Progress) -> None:
            nonlocal told
            if time.monotonic() - told > EVERY:
                told = time.monotonic()
                self.say("  " + ", ".join(filter(None, _words(progress))))

        return show

    def summary(self, summary: Summary) -> None:
        """Print the figures of a run."""
        from rich.console import Console as Terminal

        from isogal.evaluation.judgement import KINDS

        terminal = Terminal()
        terminal.print(_errors(summary))
        nees, fixes, took = summary["nees_per_axis"], summary["fixes"], summary["time"]
        low, high = nees["interval"]
        if nees["mean"] is not None and low is not None:
            terminal.print(
                f"NEES per axis {nees['mean']:.2f} (a consistent filter: {low:.2f} to {high:.2f}),"
                f" at all scans {summary['nees_all_scans']['mean']:.2f}"
            )
        risk, level = summary["integrity"]["risk"], summary["integrity"]["level"]["median"]
        if level is not None:
            terminal.print(f"Protection level at {risk:g} per hour: {level:.0f} m (median)")
        faults = [KINDS[kind] for kind, runs in summary["judgement"]["runs"].items() if runs]
        if faults:
            terminal.print(f"This run: {', '.join(faults)}")
        median = took["fix_ms_median"]
        each = "" if median is None else f", {median:.1f} ms each (median)"
        if fixes["failed"]:
            each += f"; the matcher failed on {fixes['failed']} batches"
        terminal.print(
            f"Fixes: {fixes['published']} published, {fixes['declined']} declined{each}; wall time"
            f" {took['wall_s']:.1f} s"
        )


@contextmanager
def _bar(terminal: Any) -> Iterator[Report]:
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.fields[text]}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %  {task.fields[error]}"),
    )
    with Bar(*columns, console=terminal) as bar:
        task = bar.add_task("run", total=None, text="Starting the nodes ...", error="")

        def show(progress: Progress) -> None:
            text, error = _words(progress)
            bar.update(
                task,
                completed=progress.simulated,
                total=progress.duration,
                text=text,
                error=error,
            )

        yield show


def _words(progress: Progress) -> tuple[str, str]:
    """Return how far it is, and the navigator's error where it is known."""
    far = f"{_clock(progress.simulated)} of {_clock(progress.duration)}"
    error = progress.position_error
    return (
        f"{far}, {progress.speed:.0f} x real time",
        "" if math.isnan(error) else f"error {error:.0f} m",
    )


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes // 60}:{minutes % 60:02d}:{rest:02d}"


def _errors(summary: Summary) -> Any:
    """Return the table of position errors."""
    from rich.table import Table

    table = Table(show_header=True, header_style="bold")
    table.add_column("position error", justify="left")
    for name in ("mean", "RMS", "RMS after 1 h"):
        table.add_column(name, justify="right")
    error, unaided, bound = summary["position_error"], summary["unaided"], summary["bound"]
    for row in (
        ("aided navigator", error["mean"], error["rms"], error["rms_after_1h"]),
        ("unaided INS", unaided["mean"], unaided["rms"], ""),
        ("bound (Cramér-Rao)", "", bound["rms"], bound["rms_after_1h"]),
    ):
        table.add_row(*map(_metres, row))
    return table


def _metres(value: float | str | None) -> str:
    """Return a distance (m) as text; a text as it is."""
    if isinstance(value, str):
        return value
    return "–" if value is None else f"{value:.1f} m"
