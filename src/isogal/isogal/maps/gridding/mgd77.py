"""Ships' track lines in the exchange format MGD77 of the National Geophysical Data Center
(Hittelman et al., "The Marine Geophysical Data Exchange Format - MGD77", Key to Geophysical
Records Documentation 10, revised 1998), and as tables of its fields (MGD77T, ``.m77t``).

A record of MGD77 has 120 characters in fixed columns without decimal points, after 24 lines of
header; nines or blanks stand for what is missing. Depths are positive downwards, and become
heights; times become UTC."""

import math
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError

SUFFIXES = (".mgd77", ".m77", ".a77", ".m77t")
_TABLE = ".m77t"
_RECORD = 120
"""Characters."""
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class _Field(NamedTuple):
    """A quantity of a record."""

    name: str
    """Of the column that it becomes."""
    first: int
    """Its first column in MGD77, from 1."""
    width: int
    factor: float
    """From its whole numbers."""
    of_table: str
    """What MGD77T calls it."""
    sign: float = 1.0


_FIELDS = (
    _Field("latitude", 28, 8, 1e-5, "LAT"),
    _Field("longitude", 36, 9, 1e-5, "LON"),
    _Field("topography[m]", 52, 6, 0.1, "CORR_DEPTH", -1.0),
    _Field("magnetic_field[nT]", 61, 6, 0.1, "MAG_TOT"),
    _Field("magnetic_anomaly[nT]", 73, 6, 0.1, "MAG_RES"),
    _Field("gravity[mGal]", 91, 7, 0.1, "GRA_OBS"),
    _Field("gravity_anomaly[mGal]", 104, 5, 0.1, "FREEAIR"),
)


def table_of(text: str, suffix: str, where: str) -> tuple[list[str], Array, list[int]]:
    """Return the names of the columns (K,), their numbers (N, K) with NaN = missing, and the
    number (N,) of each record's line in the file: times are seconds since 1970, columns without
    any number are left out, and records without a time or a place.

    Parameters
    ----------
    text : str
        Of the file.
    suffix : str
        Of its name, one of `SUFFIXES`.
    where : str
        File, for messages.

    Raises
    ------
    InputError
        There are no records, or one is damaged or of the form before 1998.
    """
    numbered = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    of_table = suffix == _TABLE
    read, lines = _tabular(numbered, where) if of_table else (_record, numbered)
    found, number = list[list[float]](), list[int]()
    for k, line in lines:
        if not of_table and line[0] not in "35":  # of the header, or a comment
            continue
        try:
            row = read(line)
        except (ValueError, IndexError, OverflowError):
            raise InputError(
                f"{where}: line {k} is no record of MGD77 since 1998: '{line[:40]}'"
            ) from None
        if all(map(math.isfinite, row[:3])):
            found.append(row)
            number.append(k)
    if not found:
        raise InputError(f"{where}: has no records of MGD77 with a time and a place")
    names = ["time", *(field.name for field in _FIELDS)]
    table = np.array(found)
    held = np.flatnonzero(np.isfinite(table).any(axis=0))
    return [names[i] for i in held], table[:, held], number


def _record(line: str) -> list[float]:
    """Return time and fields of a record in fixed columns; raises ValueError."""
    if line[0] != "5" or len(line.rstrip("\r\n")) < _RECORD:
        raise ValueError("no record")
    parts = [line[first - 1 : first - 1 + width] for first, width in _OF_TIME]
    zone, year, month, day, hour, minutes = (_number(part) for part in parts)
    return [
        _seconds(zone, [year, month, day], hour, 1e-3 * minutes),
        *(
            field.sign * field.factor * _number(line[field.first - 1 :][: field.width])
            for field in _FIELDS
        ),
    ]


_OF_TIME = (10, 3), (13, 4), (17, 2), (19, 2), (21, 2), (23, 5)
"""Columns and widths of the zone's correction (h), year, month, day, hour, and minute / 1000."""


def _tabular(
    lines: list[tuple[int, str]], where: str
) -> tuple[Callable[[str], list[float]], list[tuple[int, str]]]:
    """Return what reads a row of a table, and the rows without that of the names."""
    at = {name.strip(): k for k, name in enumerate(lines[0][1].split("\t"))} if lines else {}
    if not {"LAT", "LON"} <= at.keys():
        raise InputError(f"{where}: has no header of MGD77T, which names its fields")

    def read(line: str) -> list[float]:
        cells = [cell.strip() for cell in line.split("\t")]

        def number(name: str) -> float:
            cell = cells[at[name]] if name in at and at[name] < len(cells) else ""
            return float(cell) if cell else math.nan

        if at["LON"] >= len(cells):
            raise ValueError("cut short")
        zone, date, clock = (number(name) for name in ("TIMEZONE", "DATE", "TIME"))
        time = math.nan
        if math.isfinite(date) and math.isfinite(clock):
            day = [date // 10_000, date // 100 % 100, date % 100]
            time = _seconds(zone, day, clock // 100, clock % 100)
        return [time, *(field.sign * number(field.of_table) for field in _FIELDS)]

    return read, lines[1:]


def _number(text: str) -> float:
    """Return a whole number in fixed columns, NaN where it is missing; raises ValueError."""
    digits = text.strip().lstrip("+-")
    if not digits or (set(digits) == {"9"} and len(text.strip()) == len(text)):
        return math.nan
    return float(int(text))


def _seconds(zone: float, day: Sequence[float], hour: float, minute: float) -> float:
    """Return seconds since 1970 of a time of day, NaN where it is not known; raises ValueError."""
    if not all(map(math.isfinite, (*day, hour, minute))):
        return math.nan
    start = datetime(*(int(part) for part in day), tzinfo=UTC)  # type: ignore[arg-type, misc]
    correction = zone if math.isfinite(zone) else 0.0
    return (start - _EPOCH + timedelta(hours=hour + correction, minutes=minute)).total_seconds()
