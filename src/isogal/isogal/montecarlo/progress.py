"""Live progress of a study on the standard error stream: a bar on a terminal, else a line every
`LINE_EVERY` seconds."""

import sys
import time
from collections.abc import Sequence

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from isogal.montecarlo.cases import Job

LINE_EVERY = 15.0
"""s between lines where there is no terminal."""


class LiveProgress(Progress):
    """Shows how many runs are there, and how long the rest will take; use as a context.

    Parameters
    ----------
    what : str
        In front of the bar.
    """

    def __init__(self, what: str) -> None:
        super().__init__(
            "{task.description}",
            BarColumn(),
            MofNCompleteColumn(),
            "runs",
            TimeElapsedColumn(),
            "left",
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
            disable=not sys.stderr.isatty(),
        )
        self._task = self.add_task(what)
        self._kept, self._begun, self._said = 0, 0.0, 0.0

    def begin(self, todo: Sequence[Job], kept: int) -> None:
        """Take note of the runs to compute, and of how many runs were there already."""
        self._kept, self._begun = kept, time.monotonic()
        self._said = self._begun
        if kept and todo:
            self.say(f"{kept} of {kept + len(todo)} runs are there already")
        self.reset(self._task, total=kept + len(todo), completed=kept)

    def computed(self, job: Job) -> None:
        """Take note that a run is computed and kept."""
        self.advance(self._task)
        now, (task,) = time.monotonic(), self.tasks
        if self.disable and now - self._said >= LINE_EVERY:
            self._said, total = now, task.total or 0.0
            left = (now - self._begun) * (total - task.completed) / (task.completed - self._kept)
            runs = f"{task.completed:.0f}/{total:.0f} runs"
            self.say(f"{task.description}: {runs}, {left:.0f} s left")

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)
