"""What a map format is: how it is recognised and read. Formats are found by name
(`isogal.plugins`)."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap


class Reader(Protocol):
    """How every format is read."""

    def __call__(
        self,
        path: Path,
        variable: str | None,
        window: Window | None,
        *,
        quantity: str | None,
        unit: str | None,
    ) -> FieldMap:
        """Read a map, or what it has in a window with the nodes around it that interpolation
        needs; raises InputError."""
        ...


@dataclass(frozen=True)
class Format:
    """One map format: its name in scenarios, what it recognises, and its reader."""

    name: str
    matches: Callable[[Path], bool]
    """Whether a file or folder has this format, by its name or by the names of its files."""
    read: Reader
    takes_crs: bool = False
    """Whether the reader takes the argument ``crs``."""


def by_suffix(*suffixes: str) -> Callable[[Path], bool]:
    """Return what recognises files by the end of their name, in any case: ``by_suffix(".nc")``."""
    return lambda path: path.suffix.casefold() in suffixes
