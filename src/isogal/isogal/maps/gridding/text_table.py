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
    return TextLines(header, rows, numbers, lines if here[0] else None)


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
    if not found.rows:
        raise InputError(f"{where}: has no readings")
    if found.header is None:
        raise InputError(
            f"{where}: does not name its columns; its first row must, such as"
            " latitude,longitude,height,value"
        )
    names = _words(found.header)
    table = _parsed(found.rows, len(names), found.number, where)
    line: Array | None = None
    if found.line is not None:
        order: dict[str, int] = {}
        each = [" ".join(one).strip().casefold() for one in found.line]
        line = np.array([order.setdefault(one, len(order)) if one else -1 for one in each], float)
    return TextTable(names, table, line)


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
