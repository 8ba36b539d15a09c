"""Rows of a text file with named columns: CSV, tables separated by blanks, Geosoft XYZ."""

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.gridding.text_table import read_lines

_MISSING = ("", "*", "nan", "na", "n/a", "null", "none", "-")
"""Cells without a reading, in lower case."""
_DUMMIES = (-9999.0, -99999.0, -999999.0, -9999999.0, -99999.9, 1e32, -1e32)
"""Numbers that stand for a missing reading (Geosoft's dummy is -1e32)."""


class Column(NamedTuple):
    """What a column of a file may be called, and hold."""

    names: tuple[str, ...]
    """In lower case."""
    least: float = -math.inf
    most: float = math.inf
    unit: str = ""
    """Of the limits."""
    gaps: bool = False
    """Whether readings may be missing."""


TIME = Column(("time", "datetime", "utc", "timestamp"))
LATITUDE = Column(("latitude", "lat"), -90.0, 90.0, " deg")
LONGITUDE = Column(("longitude", "lon", "long", "lng"), -180.0, 360.0, " deg")
HEIGHT = Column(("height", "altitude", "alt"), -12e3, 1e5, " m")


@dataclass(frozen=True, slots=True)
class TextRows:
    """Cells of a table."""

    names: list[str]
    """Of the columns, in lower case, without a unit in brackets."""
    cells: list[list[str]]
    number: list[int]
    """Of each row in the file, from 1."""
    line: list[str] | None
    """Survey line of each row by the rows that begin one; None = there are none."""
    where: str
    """File, for messages."""

    def index(self, column: Column) -> int | None:
        """Return which one a column is, None where there is none; raises InputError where two are
        called alike."""
        found = [name for name in column.names if name in self.names]
        if not found:
            return None
        if (count := self.names.count(found[0])) > 1:
            raise InputError(f"{self.where}: has {count} columns '{found[0]}'")
        return self.names.index(found[0])

    def read(self, columns: Mapping[str, Column], required: Sequence[str]) -> dict[str, Array]:
        """Return the numbers (N,) of those columns that there are, NaN = missing, dates and times
        of TIME as seconds since 1970.

        Raises
        ------
        InputError
            A column is missing that is required, there are no rows, or a cell is not a number or
            out of range.
        """
        index = {name: self.index(column) for name, column in columns.items()}
        for name in required:
            if index[name] is None:
                raise self._lacks(columns[name].names[0])
        if not self.number:
            raise InputError(f"{self.where}: has no readings")
        return {
            name: self._numbers(i, name, columns[name])
            for name, i in index.items()
            if i is not None
        }

    def check_times(self, time: Array, which: Sequence[int] | None = None) -> None:
        """Raise InputError unless times (s) increase; of some rows only, `which`."""
        numbers = self.number if which is None else [self.number[k] for k in which]
        for k in np.flatnonzero(np.diff(time) <= 0.0)[:1].tolist():
            raise InputError(
                f"{self.where}: times must increase; line {numbers[k + 1]} ({time[k + 1]:.10g} s)"
                f" is not later than line {numbers[k]} ({time[k]:.10g} s)"
            )

    def _numbers(self, i: int, name: str, column: Column) -> Array:
        """Return the numbers (N,) of the column that is the i-th."""
        numbered = zip(self.cells, self.number, strict=True)
        return np.array([self._number(row[i].strip(), name, column, n) for row, n in numbered])

    def _lacks(self, wanted: str) -> InputError:
        """Return the error of a file without a column; it names the one that may be meant."""
        others = [name for name in self.names if name and name not in ("latitude", "longitude")]
        close = [name for name in others if wanted.startswith(name)]
        close += difflib.get_close_matches(wanted, others, n=1, cutoff=0.6)
        hint = f" (is it '{close[0]}'?)" if close else ""
        named = ", ".join(name or "(no name)" for name in self.names)
        return InputError(f"{self.where}: has no column '{wanted}'{hint}; it has {named}")

    def _number(self, text: str, name: str, column: Column, line: int) -> float:
        if column.gaps and text.casefold() in _MISSING:
            return math.nan
        cell = f"{self.where}: {name} in line {line} is"
        try:
            value = _iso_seconds(text) if column is TIME else float(text)
        except ValueError:
            shown = f"'{text[:40]}'" if text else "empty"
            raise InputError(f"{cell} {shown}, not a number") from None
        if column.gaps and value in _DUMMIES:
            return math.nan
        if not math.isfinite(value):
            raise InputError(f"{cell} {text}, not a finite number (leave the line out)")
        if not column.least <= value <= column.most:
            limits = f"{column.least:g} to {column.most:g}" if column.most < math.inf else "> 0"
            raise InputError(f"{cell} {text}{column.unit}, must be {limits}")
        return value


def one_line(rows: TextRows, line: str | None, key: str) -> TextRows:
    """Return the rows of one survey line of a file.

    Parameters
    ----------
    rows : TextRows
    line : str, optional
        Its name; None = the file has one only.
    key : str
        By which a user names it, for messages.

    Raises
    ------
    InputError
        The file has no such line, or several where none is named.
    """
    names = rows.line
    if names is None and (i := rows.index(Column(("line",)))) is not None:
        names = [row[i].strip() for row in rows.cells]
    there = list(dict.fromkeys(names or ()))
    if (line is None and len(there) <= 1) or there == [line]:
        return rows
    if names is None or line not in there:
        shown = ", ".join(there[:6]) + (", ..." if len(there) > 6 else "")
        what = f"has no line '{line}'" if line else f"has {len(there)} lines"
        raise InputError(f"{rows.where}: {what}; {key} must be one of {shown or 'none'}")
    chosen = [k for k, name in enumerate(names) if name == line]
    cells = [rows.cells[k] for k in chosen] if rows.cells else []
    return replace(rows, cells=cells, number=[rows.number[k] for k in chosen], line=None)


def _iso_seconds(text: str) -> float:
    """Return a number, or the seconds since 1970 of a date and time by ISO 8601, UTC unless it
    says otherwise; raises ValueError."""
    try:
        return float(text)
    except ValueError:
        stamp = datetime.fromisoformat(text)
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()


def read_rows(path: str | Path, needed: str) -> TextRows:
    """Read a file by `read_lines`; raises InputError where it cannot be read or its rows are not
    those of its header."""
    found = read_lines(Path(path))
    names, cells = found.cells(needed)
    line = None if found.line is None else [name for _, name in found.line]
    plain = [re.sub(r"[\[(].*", "", name).strip().casefold() for name in names]
    return TextRows(plain, cells, found.number, line, found.where)
