"""Rows of a text file with named columns: CSV, tables separated by blanks, Geosoft XYZ."""

import csv
import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError

_MISSING = ("", "*", "nan", "na", "n/a", "null", "none", "-")
"""Cells without a reading, in lower case."""
_DUMMIES = (-9999.0, -99999.0, -999999.0, -9999999.0, -99999.9, 1e32, -1e32)
"""Numbers that stand for a missing reading (Geosoft's dummy is -1e32)."""
_LINE = re.compile(r"^\s*(?:line|tie|random|base|trend|special|test)\s+(\S+)\s*$", re.IGNORECASE)
"""A row that begins a survey line in a Geosoft XYZ file."""


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


@dataclass(frozen=True, slots=True)
class TextRows:
    """Cells of a table."""

    names: list[str]
    """Of the columns, in lower case."""
    cells: list[list[str]]
    number: list[int]
    """Of each row in the file, from 1."""
    line: list[str] | None
    """Survey line of each row by the rows that begin one; None = there are none."""
    where: str
    """File, for messages."""

    def find(self, columns: Mapping[str, Column]) -> dict[str, int]:
        """Return which column is which, of those that there are; raises InputError where two are
        called alike."""
        index = {}
        for name, column in columns.items():
            found = [alias for alias in column.names if alias in self.names]
            if not found:
                continue
            if self.names.count(found[0]) > 1:
                raise InputError(
                    f"{self.where}: has {self.names.count(found[0])} columns '{found[0]}'"
                )
            index[name] = self.names.index(found[0])
        return index

    def read(self, columns: Mapping[str, Column], required: Sequence[str]) -> dict[str, Array]:
        """Return the numbers (N,) of those columns that there are; raises InputError where one is
        missing that is required."""
        index = self.find(columns)
        for name in required:
            if name not in index:
                raise self.lacks(name)
        return {name: self.numbers(i, name, columns[name]) for name, i in index.items()}

    def lacks(self, wanted: str) -> InputError:
        """Return the error of a file without a column; it names the one that may be meant."""
        others = [name for name in self.names if name and name not in ("latitude", "longitude")]
        close = [name for name in others if wanted.startswith(name)]
        close += difflib.get_close_matches(wanted, others, n=1, cutoff=0.6)
        hint = f" (is it '{close[0]}'?)" if close else ""
        named = ", ".join(name or "(no name)" for name in self.names)
        return InputError(f"{self.where}: has no column '{wanted}'{hint}; it has {named}")

    def numbers(self, index: int, name: str, column: Column) -> Array:
        """Return (N,) the numbers of a column, NaN = missing; of ``time`` dates and times, too.
        Raises InputError for a cell that is none, or out of range."""
        numbered = zip(self.cells, self.number, strict=True)
        return np.array([self._number(row[index].strip(), name, column, n) for row, n in numbered])

    def _number(self, text: str, name: str, column: Column, line: int) -> float:
        if column.gaps and text.casefold() in _MISSING:
            return math.nan
        cell = f"{self.where}: {name} in line {line} is"
        try:
            value = float(text)
        except ValueError:
            if name == "time" and (stamp := iso_seconds(text)) is not None:
                return stamp
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


def read_rows(path: str | Path, needed: str) -> TextRows:
    """Read a file whose first row, or in a Geosoft XYZ file the last comment (``/``) before the
    data, names the columns. Cells are separated by commas, semicolons, tabs or blanks; rows that
    begin with ``#`` are comments.

    Raises
    ------
    InputError
        The file cannot be read, is empty, or a row has another number of cells than the header.
    """
    where = str(path)
    text = _text(path, where)
    header: tuple[int, str] | None = None
    rows: list[tuple[int, str, str]] = []
    line, lines = "", False
    for number, raw in enumerate(text.splitlines(), 1):
        row = raw.strip()
        if not row or row[0] == "#":
            continue
        if row[0] == "/":
            words = row.lstrip("/ ")
            if not rows and len(words.split()) > 2:
                header = number, words
        elif found := _LINE.match(row):
            line, lines = found[1], True
        elif header is None:
            header = number, raw
        else:
            rows.append((number, raw, line))
    if header is None:
        raise InputError(f"{where}: is empty; it needs a header with {needed}")
    mark = max(",;\t", key=header[1].count)
    if mark not in header[1]:
        cells = [raw.split() for raw in (header[1], *(row for _, row, _ in rows))]
    else:
        cells = _split([header[1], *(row for _, row, _ in rows)], mark, where)
    names = [name.strip().casefold() for name in cells[0]]
    for (number, _, _), found_cells in zip(rows, cells[1:], strict=True):
        if len(found_cells) != len(names):
            raise InputError(
                f"{where}: line {number} has {len(found_cells)} cells, the header {len(names)}"
            )
    own = [line for _, _, line in rows] if lines else None
    return TextRows(names, cells[1:], [number for number, _, _ in rows], own, where)


def _text(path: str | Path, where: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{where}: is not a text file (UTF-8)") from None


def _split(rows: list[str], mark: str, where: str) -> list[list[str]]:
    try:
        cells = list(csv.reader(rows, delimiter=mark, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(f"{where}: is not a CSV file: {error}") from None
    if len(cells) != len(rows):
        raise InputError(f"{where}: a quoted cell runs over several lines")
    return cells


def iso_seconds(text: str) -> float | None:
    """Return seconds since 1970 of a date and time by ISO 8601, UTC unless it says otherwise; None
    where it is none."""
    try:
        stamp = datetime.fromisoformat(text)
    except ValueError:
        return None
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()
