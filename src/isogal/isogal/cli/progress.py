"""Bars on the standard error stream for what takes time."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.progress import TaskID


class Bars:
    """A bar for each thing that takes time; nothing where no terminal would show it.

    Parameters
    ----------
    unit : str
        What is counted: ``bytes`` are shown with their speed, anything else as a number.
    """

    def __init__(self, unit: str) -> None:
        from rich.console import Console
        from rich.progress import (
            BarColumn,
            DownloadColumn,
            MofNCompleteColumn,
            Progress,
            ProgressColumn,
            TransferSpeedColumn,
        )

        console = Console(stderr=True)
        count: list[ProgressColumn] = [MofNCompleteColumn()]
        if unit == "bytes":
            count = [DownloadColumn(), TransferSpeedColumn()]
        self.bars = Progress(
            "{task.description}",
            BarColumn(),
            *count,
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self.tasks: dict[str, TaskID] = {}

    def __enter__(self) -> "Bars":
        self.bars.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bars.stop()

    def __call__(self, name: str, done: int, total: int) -> None:
        """Move the bar of this name."""
        if name not in self.tasks:
            self.tasks[name] = self.bars.add_task(name, total=total)
        self.bars.update(self.tasks[name], completed=done, total=total)
