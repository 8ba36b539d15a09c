"""Tables of text with named columns: CSV, Geosoft XYZ with its lines, MGD77.

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
from isogal.files import reading
from isogal.maps.gridding import mgd77

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

    def columns(self, needed: str) -> tuple[list[str], str | None]:
        """Return the names of the columns (K,) and what separates them: a comma, semicolon or tab;
        None = blanks.

        Raises
        ------
        InputError
            There is no header, which is then said to be of the columns `needed`.
        """
        if self.header is None:
            what = "has no header" if self.rows else "is empty"
            raise InputError(f"{self.where}: {what}; it needs a header with {needed}")
        mark = max(",;\t", key=(self.rows or [self.header])[0].count)
        if mark not in self.header:
            return _words(self.header), None
        names = next(csv.reader([self.header], delimiter=mark, skipinitialspace=True))
        return [name.strip() for name in names], mark

    def cells(self, needed: str) -> tuple[list[str], list[list[str]]]:
        """Return the names of the columns (K,) and the cells of each row (N, K).

        Raises
        ------
        InputError
            As `columns` does, or a row has another number of cells than the header.
        """
        names, mark = self.columns(needed)
        try:
            cells = (
                [row.split() for row in self.rows]
                if mark is None
                else list(csv.reader(self.rows, delimiter=mark, skipinitialspace=True))
            )
        except csv.Error as error:
            raise InputError(f"{self.where}: is not a CSV file: {error}") from None
        if len(cells) != len(self.rows):
            raise InputError(f"{self.where}: a quoted cell runs over several lines")
        for number, row in zip(self.number, cells, strict=True):
            if len(row) != len(names):
                raise InputError(
                    f"{self.where}: line {number} has {len(row)} cells, the header {len(names)}"
                )
        return names, cells


def read_lines(path: Path) -> TextLines:
    """Read a text file. Its columns are named by the first row or, in a Geosoft XYZ file, by the
    last comment (``/``) before the data; rows that begin with ``#`` or ``>`` are comments. Those
    of MGD77 (`mgd77.SUFFIXES`) are always the same.

    Raises
    ------
    InputError
        The file cannot be read.
    """
    with reading(path):
        text = path.read_text(encoding="utf-8-sig")
    if (suffix := path.suffix.casefold()) in mgd77.SUFFIXES:
        return TextLines(*mgd77.table_of(text, suffix, str(path)), None, str(path))
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
        float(word.replace("*", "nan").replace("_", "?"))  # Python's 1_000 is none in a file
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
    """(N,) number of the survey line that each row belongs to: its name where all names are
    numbers and none is there twice; None where the file has none."""


def read_table(path: Path) -> TextTable:
    """Read a table.

    Columns are separated by commas, semicolons, tabs or blanks, and named by the first row or, in
    a Geosoft XYZ file, by the last comment before the data.

    Raises
    ------
    InputError
        The file cannot be read, columns have no names, a row is not numbers or is too short.
    """
    found, needed = read_lines(path), "latitude, longitude, value and the like"
    names, mark = found.columns(needed)
    if not found.rows:
        raise InputError(f"{path}: has no readings")
    plain = [row.replace("*", "nan") for row in found.rows]
    try:
        table = np.loadtxt(plain, delimiter=mark, comments=None, quotechar='"', ndmin=2)
        if table.shape[1] != len(names):
            raise ValueError(f"has {table.shape[1]} columns, the header {len(names)}")
    except ValueError as error:
        cells = zip(found.number, found.cells(needed)[1], strict=True)
        wrong = (
            f"line {number} holds '{cell.strip()[:40]}', which is not a number"
            for number, row in cells
            for cell in row
            if not _is_number(cell)
        )
        raise InputError(f"{path}: {next(wrong, error)}") from None
    line: Array | None = None
    if found.line is not None:
        order: dict[str, int] = {}
        each = [" ".join(one).strip().casefold() for one in found.line]
        for one in each:
            order.setdefault(one, len(order))
        own = {one: one.split()[-1] for one in order if one}
        if all(map(str.isdecimal, own.values())) and len(set(own.values())) == len(own):
            order = {one: int(name) for one, name in own.items()}
        line = np.array([order[one] if one else -1 for one in each], float)
    return TextTable(names, table, line)


def _words(row: str) -> list[str]:
    return [word for word in re.split(r"[\s,;]+", row.strip()) if word]
