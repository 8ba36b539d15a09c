"""Checks on the command line, as callbacks of their options: of numbers, as typer's own `min`
admits infinity and the limit itself, and of files and folders to be written, so that nobody learns
after a long computation that its result has no place."""

import math
from pathlib import Path
from typing import TypeVar

import typer

from isogal.errors import InputError
from isogal.files import check_output

Paths = TypeVar("Paths", Path, Path | None, list[Path] | None)


def finite(option: typer.CallbackParam, value: float | None) -> float | None:
    """Return the value of an option; raises InputError unless it is finite."""
    return _checked(option, value, "finite", True)


def positive(option: typer.CallbackParam, value: float | None) -> float | None:
    """Return the value of an option; raises InputError unless it is finite and > 0."""
    return _checked(option, value, "> 0", value is None or value > 0.0)


def not_negative(option: typer.CallbackParam, value: float | None) -> float | None:
    """Return the value of an option; raises InputError unless it is finite and >= 0."""
    return _checked(option, value, ">= 0", value is None or value >= 0.0)


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


def _checked(
    option: typer.CallbackParam, value: float | None, allowed: str, good: bool
) -> float | None:
    if value is not None and not math.isfinite(value):
        allowed, good = "finite", False
    if value is not None and not good:
        raise InputError(f"{option.opts[0]}: must be {allowed}, is {value}")
    return value
