"""Tables of text with named columns: CSV, and Geosoft XYZ with its lines.

In a Geosoft XYZ file (Geosoft, "Geosoft File Formats", XYZ) a row ``Line 100`` or ``Tie 20``
begins a survey line, a row that begins with ``/`` is a comment, the last of which before the data
names the columns, and ``*`` stands for a missing number."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError

_LINE = re.compile(r"^\s*(line|tie|random|base|trend|special|test)\s+(\S+)", re.IGNORECASE)
_NUMBER = re.compile(r"^[-+]?(\d|\.\d|nan|inf|\*)", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class TextTable:
    """Numbers with names."""

    names: list[str]
    numbers: Array
    """(N, columns); NaN = missing."""
    line: Array | None
    """(N,) index of the survey line that each row belongs to; None where the file has none."""


def read_table(path: Path) -> TextTable:
    """Read a table.

    Columns are separated by commas, semicolons, tabs or blanks, and named by the first row or, in
    a Geosoft XYZ file, by the last comment before the data.

    Raises
    ------
    InputError
        The file cannot be read, columns have no names, a row is not numbers or is too short.
    """
    where = str(path)
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{where}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{where}: is not a text file (UTF-8)") from None
    names: list[str] | None = None
    rows: list[str] = []
    numbers: list[int] = []
    lines: list[int] = []
    current: dict[str, int] = {}
    here = -1
    for number, raw in enumerate(text.splitlines(), 1):
        row = raw.strip()
        if not row or row[0] in "#>" or (row[0] == "/" and rows):
            continue
        if row[0] == "/":
            words = _words(row.lstrip("/ "))
            names = words if len(words) > 2 else names
        elif match := _LINE.match(row):
            here = current.setdefault(f"{match[1]} {match[2]}".casefold(), len(current))
        elif not rows and not _NUMBER.match(row):
            names = _words(row)
        else:
            rows.append(row)
            numbers.append(number)
            lines.append(here)
    if not rows:
        raise InputError(f"{where}: has no readings")
    if names is None:
        raise InputError(
            f"{where}: does not name its columns; its first row must, such as"
            " latitude,longitude,height,value"
        )
    table = _parsed(rows, len(names), numbers, where)
    return TextTable(names, table, np.array(lines, dtype=np.float64) if current else None)


def _words(row: str) -> list[str]:
    return [word for word in re.split(r"[\s,;]+", row.strip()) if word]


def _parsed(rows: list[str], columns: int, numbers: list[int], where: str) -> Array:
    """Parse rows of numbers to (N, columns)."""
    mark = next((mark for mark in ",;\t" if mark in rows[0]), None)
    if any("*" in row for row in rows):
        rows = [row.replace("*", "nan") for row in rows]
    try:
        table = np.loadtxt(rows, dtype=np.float64, delimiter=mark, ndmin=2, comments=None)
    except ValueError:
        table = np.empty((0, 0))
    if table.shape != (len(rows), columns):
        _name_bad_row(rows, columns, numbers, mark, where)
    return table


def _name_bad_row(
    rows: list[str], columns: int, numbers: list[int], mark: str | None, where: str
) -> None:
    for number, row in zip(numbers, rows, strict=True):
        cells = row.split(mark)
        if len(cells) != columns:
            raise InputError(
                f"{where}: row {number} has {len(cells)} cells, the columns are {columns}"
            )
        for cell in cells:
            try:
                float(cell)
            except ValueError:
                raise InputError(
                    f"{where}: row {number} holds '{cell.strip()[:40]}', which is not a number"
                ) from None
    raise InputError(f"{where}: is not a table of numbers")
