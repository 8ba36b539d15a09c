"""A run that goes on, in the terminal: progress, errors and what is claimed of them, the last
batches and messages."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.evaluation.integrity import Solution
from isogal.evaluation.view.record import ViewedRun
from isogal_ros.graph.progress import Progress, Report
from isogal_ros.graph.watching import Watch

EVERY = 1.0
"""s between looks at the recording."""
_BARS = "▁▂▃▄▅▆▇█"
_LAST = 6
"""Batches and messages shown."""
_WIDTH = 60
"""Characters of a curve."""


@contextmanager
def dashboard(watch: Watch) -> Iterator[Report]:
    """Show the dashboard as long as the block lasts; yield what is told the progress.

    Raises
    ------
    InputError
        Standard error is no terminal.
    """
    from rich.console import Console
    from rich.live import Live

    terminal = Console(stderr=True)
    if not terminal.is_terminal:
        raise InputError("--dashboard: standard error is no terminal")
    # rich calls it from a thread of its own
    look = partial(_look, watch)
    with Live(console=terminal, refresh_per_second=1.0 / EVERY, get_renderable=look):
        yield lambda progress: None


def _look(watch: Watch) -> Any:
    return picture(watch.progress, watch.look()[1])


def picture(progress: Progress | None, viewed: ViewedRun | None) -> Any:
    """Return what the terminal shows (a renderable of rich)."""
    from rich.console import Group
    from rich.panel import Panel
    from rich.progress_bar import ProgressBar

    parts: list[Any] = []
    if progress is not None:
        hours = f"{progress.simulated / 3600.0:.2f} of {progress.duration / 3600.0:.2f} h"
        parts += [
            f"{hours}, {progress.speed:.0f} x real time",
            ProgressBar(total=progress.duration, completed=progress.simulated, width=_WIDTH),
        ]
    if viewed is None:
        parts.append("Waiting for the first reading ...")
    else:
        parts += [_figures(viewed), _batches(viewed), _messages(viewed)]
    return Panel(Group(*parts), title="isogal run", expand=False)


def _figures(viewed: ViewedRun) -> Any:
    from rich.table import Table

    runs = viewed.runs
    sigma = np.sqrt(np.trace(runs.covariance[0], axis1=1, axis2=2))
    level = Solution.of(runs).level(viewed.scenario.integrity)[0]
    table = Table(box=None, pad_edge=False)
    for name in ("", "now", "so far (logarithmic)"):
        table.add_column(name, justify="right" if name == "now" else "left")
    for name, values in (
        ("error", runs.horizontal_error[0]),
        ("claimed, 1 sigma", sigma),
        ("protection level", level),
        ("unaided INS", runs.unaided_horizontal_error[0]),
    ):
        table.add_row(name, f"{values[-1]:.0f} m", curve(values))
    return table


def _batches(viewed: ViewedRun) -> Any:
    from rich.table import Table

    runs = viewed.runs
    table = Table(box=None, pad_edge=False)
    for name in ("batch", "fix error", "sigma", "outcome"):
        table.add_column(name)
    for batch in range(max(0, runs.fix_time.size - _LAST), runs.fix_time.size):
        reason = runs.fix_reason[0][batch]
        error = math.hypot(*runs.fix_error[0, batch])
        sigma = math.sqrt(float(np.trace(runs.fix_covariance[0, batch])))
        table.add_row(
            f"{(runs.fix_time[batch] - runs.time[0]) / 60.0:.0f} min",
            _metres(error),
            _metres(sigma),
            reason or "fix",
        )
    return table


def _messages(viewed: ViewedRun) -> Any:
    from rich.text import Text

    events: Sequence[Any] = viewed.events or ()
    lines = [
        f"{(event.time - viewed.runs.time[0]) / 60.0:.0f} min  {event.level}  {event.source}:"
        f" {event.text}"
        for event in events[-_LAST:]
    ]
    return Text("\n".join(lines) or "No warnings.")


def curve(values: Array) -> str:
    """Return the values as a row of bars, on a logarithmic scale from the least to the most."""
    known = values[np.isfinite(values) & (values > 0.0)]
    if known.size == 0:
        return ""
    groups = np.array_split(known, min(_WIDTH, known.size))
    heights = np.log([float(group.mean()) for group in groups])
    low, high = float(heights.min()), float(heights.max())
    scale = (len(_BARS) - 1) / (high - low) if high > low else 0.0
    return "".join(_BARS[round((height - low) * scale)] for height in heights.tolist())


def _metres(value: float) -> str:
    return f"{value:.0f} m" if math.isfinite(value) else "–"
