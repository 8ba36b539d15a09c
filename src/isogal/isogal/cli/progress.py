"""Bars on the standard error stream for what takes time."""

from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    MofNCompleteColumn,
    Progress,
    TaskID,
    TransferSpeedColumn,
)


class Bars(Progress):
    """A bar for each thing that takes time; nothing where no terminal would show it.

    Parameters
    ----------
    unit : str
        What is counted: ``bytes`` are shown with their speed, anything else as a number.
    """

    def __init__(self, unit: str) -> None:
        console = Console(stderr=True)
        in_bytes = DownloadColumn(), TransferSpeedColumn()
        super().__init__(
            "{task.description}",
            BarColumn(),
            *(in_bytes if unit == "bytes" else [MofNCompleteColumn()]),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._by_name: dict[str, TaskID] = {}

    def __call__(self, name: str, done: int, total: int) -> None:
        """Move the bar of this name."""
        if name not in self._by_name:
            self._by_name[name] = self.add_task(name, total=total)
        self.update(self._by_name[name], completed=done, total=total)
