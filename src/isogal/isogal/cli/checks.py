"""Checks of numbers on the command line, as callbacks of their options.

typer's own `min` admits infinity and the limit itself."""

import math

import typer

from isogal.errors import InputError


def finite(option: typer.CallbackParam, value: float | None) -> float | None:
    """Return the value of an option; raises InputError unless it is finite."""
    return _checked(option, value, "finite", True)


def positive(option: typer.CallbackParam, value: float | None) -> float | None:
    """Return the value of an option; raises InputError unless it is finite and > 0."""
    return _checked(option, value, "> 0", value is None or value > 0.0)


def not_negative(option: typer.CallbackParam, value: float | None) -> float | None:
    """Return the value of an option; raises InputError unless it is finite and >= 0."""
    return _checked(option, value, ">= 0", value is None or value >= 0.0)


def _checked(
    option: typer.CallbackParam, value: float | None, allowed: str, good: bool
) -> float | None:
    if value is not None and not math.isfinite(value):
        allowed, good = "finite", False
    if value is not None and not good:
        raise InputError(f"{option.opts[0]}: must be {allowed}, is {value}")
    return value
