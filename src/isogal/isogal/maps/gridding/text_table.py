"""Tables of text with named columns: CSV, and Geosoft XYZ with its lines.

In a Geosoft XYZ file (Geosoft, "Geosoft File Formats", XYZ) a row ``Line 100`` or ``Tie 20``
begins a survey line, a row that begins with ``/`` is a comment, the last of which before the data
names the columns, and ``*`` stands for a missing number."""

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError

_LINE = re.compile(r"^\s*(line|tie|random|base|trend|special|test)\s+(\S+)\s*$", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class TextLines:
    """Rows of a text file, without comments and blank ones."""

    header: str | None
    """That which names the columns; None = there is none."""
    rows: list[str]
    number: list[int]
    """Of each row in the file, from 1."""
    line: list[tuple[str, str]] | None
    """Kind and name of the survey line of each row; None = no row begins one."""
    where: str
    """File, for messages."""

    def cells(self, needed: str) -> tuple[list[str], list[list[str]]]:
        """Return the names of the columns (K,) and the cells of each row (N, K), separated by
        commas, semicolons, tabs or blanks.

        Raises
        ------
        InputError
            There is no header, which is then said to be of the columns `needed`, or a row has
            another number of cells than that.
        """
        if self.header is None:
            what = "has no header" if self.rows else "is empty"
            raise InputError(f"{self.where}: {what}; it needs a header with {needed}")
        mark = max(",;\t", key=(self.rows or [self.header])[0].count)
        if mark not in self.header:
            names, cells = _words(self.header), [row.split() for row in self.rows]
        else:
            rows = [self.header, *self.rows]
            try:
                names, *cells = csv.reader(rows, delimiter=mark, skipinitialspace=True)
            except csv.Error as error:
                raise InputError(f"{self.where}: is not a CSV file: {error}") from None
            if len(cells) != len(self.rows):
                raise InputError(f"{self.where}: a quoted cell runs over several lines")
        for number, row in zip(self.number, cells, strict=True):
            if len(row) != len(names):
                raise InputError(
                    f"{self.where}: line {number} has {len(row)} cells, the header {len(names)}"
                )
        return [name.strip() for name in names], cells


def read_lines(path: Path) -> TextLines:
    """Read a text file. Its columns are named by the first row or, in a Geosoft XYZ file, by the
    last comment (``/``) before the data; rows that begin with ``#`` or ``>`` are comments.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: is not a text file (UTF-8)") from None
    header: str | None = None
    plain, here = False, ("", "")
    rows, numbers, lines = list[str](), list[int](), list[tuple[str, str]]()
    for number, raw in enumerate(text.splitlines(), 1):
        row = raw.strip()
        if not row or row[0] in "#>":
            continue
        if row[0] == "/":
            words = row.lstrip("/ ")
            if not rows and not plain and len(words.split()) > 2:
                header = words
        elif match := _LINE.match(row):
            here = match[1], match[2]
        elif not rows and _names_columns(row, header, plain):
            header, plain = raw, True
        else:
            rows.append(raw)
            numbers.append(number)
            lines.append(here)
    return TextLines(header, rows, numbers, lines if here[0] else None, str(path))


def _names_columns(row: str, header: str | None, plain: bool) -> bool:
    """Whether a row before the data is none of them: it does not begin with a number; and after a
    comment, or after a title of other than so many words, it has none at all."""
    words = _words(row)
    if plain and header is not None and len(words) == len(_words(header)):
        return False
    return not any(map(_is_number, words if header else words[:1]))


def _is_number(word: str) -> bool:
    try:
        float(word.replace("*", "nan"))
    except ValueError:
        return False
    return True


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
    where, found = str(path), read_lines(path)
    names, cells = found.cells("latitude, longitude, value and the like")
    if not cells:
        raise InputError(f"{where}: has no readings")
    table = np.array([
        [_number(cell, number, where) for cell in row]
        for number, row in zip(found.number, cells, strict=True)
    ])  # fmt: skip
    line: Array | None = None
    if found.line is not None:
        order: dict[str, int] = {}
        each = [" ".join(one).strip().casefold() for one in found.line]
        line = np.array([order.setdefault(one, len(order)) if one else -1 for one in each], float)
    return TextTable(names, table, line)


def _words(row: str) -> list[str]:
    return [word for word in re.split(r"[\s,;]+", row.strip()) if word]


def _number(cell: str, line: int, where: str) -> float:
    try:
        return float(
            cell.replace("*", "nan").replace("_", "?")
        )  # Python's 1_000 is none in a file
    except ValueError:
        said = cell.strip()[:40]
        raise InputError(f"{where}: line {line} holds '{said}', which is not a number") from None
