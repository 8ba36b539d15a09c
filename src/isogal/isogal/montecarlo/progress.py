"""Live progress of a study on the standard error stream: a bar on a terminal, else a line every
`LINE_EVERY` seconds."""

import sys
import time
from collections.abc import Sequence

from rich.console import Console
from rich.progress import BarColumn, Progress, TimeElapsedColumn, TimeRemainingColumn

from isogal.montecarlo.cases import Job

LINE_EVERY = 15.0
"""s between lines where there is no terminal."""


class LiveProgress(Progress):
    """Shows how many runs are done, how fast, and how long the rest will take; use as a context.

    Parameters
    ----------
    what : str
        In front of the bar.
    """

    def __init__(self, what: str) -> None:
        super().__init__(
            "{task.description}",
            BarColumn(),
            "{task.fields[runs]} {task.fields[speed]}",
            TimeElapsedColumn(),
            "left",
            TimeRemainingColumn(elapsed_when_finished=False),
            console=Console(stderr=True),
            transient=True,
            disable=not sys.stderr.isatty(),
        )
        self.what = what
        self._total = self._done = 0.0
        self._runs = self._kept = 0
        self._start = self._last = time.monotonic()
        self._task = self.add_task(what, runs="", speed="")

    def begin(self, todo: Sequence[Job], kept: int) -> None:
        """Take note of the runs to compute, and of how many runs were there already."""
        self._start = self._last = time.monotonic()
        self._total = sum(job.case.duration for job in todo)
        self._runs = kept + len(todo)
        self._kept = kept
        self._done = 0.0
        if kept and todo:
            self.say(f"{kept} of {self._runs} runs are there already")
        self.reset(self._task, total=self._total)
        self._show()

    def computed(self, job: Job) -> None:
        """Take note that a run is computed and kept."""
        self._done += job.case.duration
        self._kept += 1
        self._show()

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def _show(self) -> None:
        now = time.monotonic()
        done, elapsed = self._done, max(now - self._start, 1e-9)
        runs, speed = f"{self._kept}/{self._runs} runs", f"{done / elapsed:,.0f} x real time"
        self.update(self._task, completed=done, runs=runs, speed=speed)
        if self.disable and now - self._last >= LINE_EVERY and done > 0.0:
            self._last = now
            left = elapsed * (self._total - done) / done
            self.say(f"{self.what}: {runs}, {speed}, {left:.0f} s left")
