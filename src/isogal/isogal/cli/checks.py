"""Checks on the command line, as callbacks of their options: of numbers, as typer's own `min`
admits infinity and the limit itself, and of files and folders to be written, so that nobody learns
after a long computation that its result has no place."""

import math
from collections.abc import Callable, Iterable
from pathlib import Path

import typer

from isogal.errors import InputError
from isogal.files import check_output

Files = Path | list[Path] | None
OUTPUT = "output"
"""Attribute of a check: what the option names is written."""
NETCDF = (".nc", ".nc4")
"""Suffixes of NetCDF files."""


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


def output_file(*suffixes: str) -> Callable[..., Files]:
    """Return the check of an option that names files to be written: it raises InputError unless
    each can be, and ends in one of the suffixes, if there are any."""

    def check(value: Files) -> Files:
        for path in value if isinstance(value, list) else [value]:
            if path is not None:
                if suffixes and path.suffix.casefold() not in suffixes:
                    raise InputError(f"{path}: must end in {' or '.join(suffixes)}")
                check_output(path)
        return value

    vars(check)[OUTPUT] = True
    return check


def not_read_too(written: Iterable[Path], read: Iterable[str]) -> None:
    """Raise InputError where a file is to be written that is also read: it would be lost."""
    there = [path for path in written if path.is_file()]
    for word in read:
        for path in there:
            if Path(word).is_file() and path.samefile(word):
                raise InputError(
                    f"{path}: is read by this command; give what is written another name"
                )


def place(option: str, text: str) -> tuple[float, float]:
    """Return latitude and longitude, deg, of what an option has as ``LAT,LON``; raises
    InputError."""
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        latitude = longitude = math.nan
    if not (-90.0 < latitude < 90.0 and -180.0 <= longitude <= 360.0):
        raise InputError(f"{option}: '{text}' must be LATITUDE,LONGITUDE in deg, as '-38,144.5'")
    return latitude, longitude


def output_folder(value: Path | None) -> Path | None:
    """Return what an option names; raises InputError where no file can be written into a folder
    of that name."""
    if value is not None:
        check_output(value, folder=True)
    return value
