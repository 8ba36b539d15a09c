"""Checks on the command line, as callbacks of their options: of numbers, as typer's own `min`
admits infinity and the limit itself, and of files and folders to be written, so that nobody learns
after a long computation that its result has no place."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import typer

from isogal.errors import InputError
from isogal.files import check_output

Paths = TypeVar("Paths", Path, Path | None, list[Path] | None)


def _checked(allowed: str, good: Callable[[float], bool]) -> Callable[..., float | None]:
    """Return the check of an option that may be left out; it raises InputError unless the value is
    finite, and good."""

    def check(option: typer.CallbackParam, value: float | None) -> float | None:
        if value is not None and not (math.isfinite(value) and good(value)):
            must = allowed if math.isfinite(value) else "finite"
            raise InputError(f"{option.opts[0]}: must be {must}, is {value}")
        return value

    return check


finite = _checked("finite", lambda value: True)
positive = _checked("> 0", lambda value: value > 0.0)
not_negative = _checked(">= 0", lambda value: value >= 0.0)


def output_file(value: Paths) -> Paths:
    """Return what an option names; raises InputError where a file of that name cannot be
    written."""
    for path in value if isinstance(value, list) else [value]:
        if path is not None:
            check_output(path)
    return value


def output_folder(value: Paths) -> Paths:
    """Return what an option names; raises InputError where no file can be written into a folder
    of that name."""
    if isinstance(value, Path):
        check_output(value, folder=True)
    return value
