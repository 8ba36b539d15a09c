"""Rows of a text file with named columns: CSV, tables separated by blanks, Geosoft XYZ."""

import csv
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from isogal.errors import InputError

MISSING = ("", "*", "nan", "na", "n/a", "null", "none", "-")
"""Cells without a reading, in lower case."""
DUMMIES = (-9999.0, -99999.0, -999999.0, -9999999.0, -99999.9, 1e32, -1e32)
"""Numbers that stand for a missing reading (Geosoft's dummy is -1e32)."""
PLACE_NAMES = {
    "time": ("time", "datetime", "utc", "timestamp"),
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "long", "lng"),
}
"""Names of columns that say when and where, in lower case."""
PLACE_RANGES = {"latitude": (-90.0, 90.0), "longitude": (-180.0, 360.0)}
"""deg."""
_LINE = re.compile(r"^\s*(?:line|tie|random|base|trend|special|test)\s+(\S+)\s*$", re.IGNORECASE)
"""A row that begins a survey line in a Geosoft XYZ file."""


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
    return TextRows(names, cells[1:], [number for number, _, _ in rows], own)


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
