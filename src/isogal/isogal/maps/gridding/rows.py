"""Rows of a file with named columns: CSV, tables separated by blanks, Geosoft XYZ, MGD77
(`isogal.maps.gridding.mgd77`), and NetCDF files whose variables have one dimension.

In a Geosoft XYZ file (Geosoft, "Geosoft File Formats", XYZ) a row ``Line 100`` or ``Tie 20``
begins a survey line, a row that begins with ``/`` is a comment, the last of which before the data
names the columns, and ``*`` stands for a missing number."""

import csv
import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.formats.netcdf import open_netcdf, quantity_in, text_of, unpacked
from isogal.maps.gridding import mgd77
from isogal.maps.quantities import UNITS, quantity_of, unit_factor

_MISSING = ("", "*", "nan", "na", "n/a", "null", "none", "-")
"""Cells without a reading, in lower case."""
_DUMMIES = (-9999.0, -99999.0, -999999.0, -9999999.0, -99999.9, 1e32, -1e32)
"""Numbers that stand for a missing reading (Geosoft's dummy is -1e32)."""
_NETCDF = (".nc", ".nc4", ".cdf")
_SECONDS = {
    **dict.fromkeys(("", "s", "sec", "second"), 1.0),
    **dict.fromkeys(("min", "minute"), 60.0),
    **dict.fromkeys(("h", "hr", "hour"), 3600.0),
    **dict.fromkeys(("d", "day"), 86400.0),
    **dict.fromkeys(("ms", "millisecond"), 1e-3),
    **dict.fromkeys(("us", "µs", "microsecond"), 1e-6),
    **dict.fromkeys(("ns", "nanosecond"), 1e-9),
}
"""In a unit of time, as UDUNITS names it in the singular."""
_EXAMPLE = "2026-05-01T12:00:00Z"
_LINE = re.compile(r"^\s*(line|tie|random|base|trend|special|test)\s+(\S+)\s*$", re.IGNORECASE)


class Column(NamedTuple):
    """What a column of a file may be called, and hold."""

    names: tuple[str, ...]
    """In lower case."""
    least: float = -math.inf
    most: float = math.inf
    unit: str = ""
    """Of its numbers and the limits, a blank before it; empty: whatever the file says it is."""
    gaps: bool = False
    """Whether readings may be missing."""


TIME = Column(("time", "datetime", "utc", "timestamp"))
LATITUDE = Column(("latitude", "lat"), -90.0, 90.0, " deg")
LONGITUDE = Column(("longitude", "lon", "long", "lng"), -180.0, 360.0, " deg")
HEIGHT = Column(("height", "altitude", "alt"), -12e3, 1e5, " m")


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """N rows of a file."""

    names: list[str]
    """Of the columns, in lower case, without a unit in brackets."""
    columns: list[Sequence[str] | Array]
    """(N,) each: cells of a text, or numbers with NaN = missing."""
    number: list[int]
    """Of each row in the file, from 1."""
    line: list[str] | None
    """Survey line of each row, by a column ``line`` or by rows that begin one; None = there are
    none."""
    where: str
    """File, for messages."""
    units: dict[str, str] = field(default_factory=dict)
    """Of the columns whose unit the file says."""
    quantities: dict[str, str] = field(default_factory=dict)
    """Of the columns of which the file, or their name, says it."""

    def __len__(self) -> int:
        return len(self.number)

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
        if not len(self):
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
        cells, unit = self.columns[i], self.units.get(self.names[i], "")
        plain = isinstance(cells, np.ndarray) or all(map(_is_number, cells))
        if isinstance(cells, np.ndarray):
            found = np.array(cells)
        else:
            found = np.empty(len(cells))
            for k, text in enumerate(cells):
                try:
                    found[k] = _number(text.strip(), column)
                except ValueError:
                    shown = f"'{text.strip()[:40]}'" if text.strip() else "empty"
                    hint = " (write 1.5, not 1,5)" if "," in text else ""
                    if column is TIME and ":" in text:
                        hint = f" or a date and time by ISO 8601 that there is: {_EXAMPLE}"
                    raise self._bad(name, k, f"{shown}, not a number{hint}") from None
        if column is TIME and plain:
            found = _seconds(found, unit, f"{self.where}: {self.names[i]}")
        found *= self._factor(self.names[i], column)
        if column.gaps:
            found[np.isin(found, _DUMMIES)] = np.nan
        beyond = (found < column.least) | (found > column.most)
        bad = ~np.isfinite(found) & ~(column.gaps & np.isnan(found)) | beyond
        if bad.any():
            k = int(np.argmax(bad))
            if not math.isfinite(found[k]):
                raise self._bad(name, k, f"{found[k]}, not a finite number (leave the line out)")
            limits = f"{column.least:g} to {column.most:g}" if column.most < math.inf else "> 0"
            raise self._bad(name, k, f"{found[k]:.10g}{column.unit}, must be {limits}")
        return found

    def _factor(self, name: str, column: Column) -> float:
        """Return the number of a column's own unit in that which the file says; raises InputError
        where that is none of those known."""
        unit = self.units.get(name)
        if unit is None or not column.unit:
            return 1.0
        inside, own = UNITS[column.unit.strip()]
        return unit_factor(unit, f"{self.where}: {name}", inside)[1] / own

    def in_one_unit(
        self, found: dict[str, Array], columns: Mapping[str, Column], names: Sequence[str]
    ) -> str | None:
        """Bring some columns that have been read to the unit of the first of which the file says
        one, and return that; None where it says none. Raises InputError where units do not go
        together."""
        common: str | None = None
        for name in (one for one in names if one in found):
            i = self.index(columns[name])
            unit = None if i is None else self.units.get(self.names[i])
            common = common or unit
            if unit is not None and common is not None and unit != common:
                inside, own = unit_factor(common, f"{self.where}: {names[0]}")
                factor = unit_factor(unit, f"{self.where}: {name}", inside)[1]
                found[name] = found[name] * (factor / own)
        return common

    def _bad(self, name: str, k: int, what: str) -> InputError:
        return InputError(f"{self.where}: {name} in line {self.number[k]} is {what}")

    def _lacks(self, wanted: str) -> InputError:
        """Return the error of a file without a column; it names the one that may be meant."""
        others = [name for name in self.names if name and name not in ("latitude", "longitude")]
        close = [name for name in others if wanted.startswith(name)]
        close += difflib.get_close_matches(wanted, others, n=1, cutoff=0.6)
        hint = f" (is it '{close[0]}'?)" if close else ""
        named = ", ".join(name or "(no name)" for name in self.names)
        return InputError(f"{self.where}: has no column '{wanted}'{hint}; it has {named}")


def one_line(rows: Rows, line: str | None) -> Rows:
    """Return the rows of one survey line of a file.

    Parameters
    ----------
    rows : Rows
    line : str, optional
        Its name, `route.track_line`; None = the file has one only.

    Raises
    ------
    InputError
        The file has no such line, or several where none is named.
    """
    there = list(dict.fromkeys(rows.line or ()))
    if (line is None and len(there) <= 1) or there == [line]:
        return rows
    if rows.line is None or line not in there:
        shown = ", ".join(there[:6]) + (", ..." if len(there) > 6 else "")
        what = f"has no line '{line}'" if line else f"has {len(there)} lines"
        raise InputError(
            f"{rows.where}: {what}; route.track_line must be one of {shown or 'none'}"
        )
    chosen = [k for k, name in enumerate(rows.line) if name == line]
    columns: list[Sequence[str] | Array] = [
        one[chosen] if isinstance(one, np.ndarray) else [one[k] for k in chosen]
        for one in rows.columns
    ]
    return replace(rows, columns=columns, number=[rows.number[k] for k in chosen], line=None)


def read_rows(path: str | Path, needed: str) -> Rows:
    """Read a file; its format is known by its suffix.

    Columns of a text are separated by commas, semicolons, tabs or blanks, and named by the first
    row or, in a Geosoft XYZ file, by the last comment (``/``) before the data; rows that begin
    with ``#`` or ``>`` are comments.

    Parameters
    ----------
    path : path
        ``.nc``, ``.nc4``, ``.cdf``, one of `mgd77.SUFFIXES`, else text.
    needed : str
        Columns that a file needs, for messages.

    Raises
    ------
    InputError
        The file cannot be read, has no header, or a row has another number of cells.
    """
    path = Path(path)
    suffix = path.suffix.casefold()
    if suffix in _NETCDF:
        return _of_netcdf(path)
    with reading(path):
        text = path.read_text(encoding="utf-8-sig")
    if suffix in mgd77.SUFFIXES:
        names, table, number = mgd77.table_of(text, suffix, str(path))
        return _named(names, list(table.T), number, None, str(path))
    return rows_of_text(text, needed, str(path))


def _named(
    header: Sequence[str],
    columns: Sequence[Sequence[str] | Array],
    number: list[int],
    line: list[str] | None,
    where: str,
) -> Rows:
    """Return the rows of a header whose names may have units in brackets: ``dg[mGal]``."""
    names = [_bare(name) for name in header]
    brackets = [re.search(r"[\[(](.+?)[\])]", name) for name in header]
    units = {name: match[1] for name, match in zip(names, brackets, strict=True) if match}
    if names.count("line") == 1:
        cells = columns[names.index("line")]
        line = [cell.strip() if isinstance(cell, str) else f"{cell:.15g}" for cell in cells]
    quantities = {name: found for name in names if (found := quantity_of(name))}
    return Rows(names, list(columns), number, line, where, units, quantities)


def _bare(name: str) -> str:
    """Return the name of a column in lower case, without a unit in brackets."""
    return re.sub(r"[\[(].*", "", name).strip().casefold()


def _of_netcdf(path: Path) -> Rows:
    """Read the variables of one dimension that go along with the places, else with the times, else
    with the longest."""
    with open_netcdf(path) as dataset:
        flat = {
            name.casefold(): data
            for name, data in dataset.variables.items()
            if data.ndim == 1 and np.dtype(data.dtype).kind in "iuf"
        }
        first = [name for name in (*LATITUDE.names, "y", *TIME.names) if name in flat]
        first = first or sorted(flat, key=lambda name: -flat[name].size)
        along = flat[first[0]].dimensions if first else ()
        flat = {name: data for name, data in flat.items() if data.dimensions == along}
        values = [unpacked(data, data[:]).astype(np.float64) for data in flat.values()]
        units = {name: unit for name, data in flat.items() if (unit := text_of(data, "units"))}
        known = {name: found for name, data in flat.items() if (found := quantity_in(data))}
    number = list(range(1, len(values[0]) + 1)) if values else []
    rows = _named(list(flat), values, number, None, str(path))
    return replace(rows, units=units, quantities=known)


def rows_of_text(text: str, needed: str, where: str) -> Rows:
    """Return the rows of a text; parameters and errors as of `read_rows`, `where`: its file."""
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
            here = match[1].casefold(), match[2]
        elif not rows and _names_columns(row, header, plain):
            header, plain = raw, True
        else:
            rows.append(raw)
            numbers.append(number)
            lines.append(here)
    if header is None:
        what = "has no header" if rows else "is empty"
        raise InputError(f"{where}: {what}; it needs a header with {needed}")
    marks = [mark for mark in ",;\t" if mark in header]
    mark = max(marks, key=(rows or [header])[0].count, default=None)
    line = _lines(lines) if here[0] else None
    names, _ = _split(header, [], mark, where)
    if (table := _plain(rows, mark)) is not None and table.shape[1] == len(names):
        numeric: list[Sequence[str] | Array] = list(table.T)
        for i, name in enumerate(names):
            if _bare(name) == "line":  # lines are called what is written: 007 is not 7
                numeric[i] = [row.split(mark)[i].strip('" ') for row in rows]
        return _named(names, numeric, numbers, line, where)
    _, cells = _split(header, rows, mark, where)
    for number, one in zip(numbers, cells, strict=True):
        if len(one) != len(names):
            raise InputError(
                f"{where}: line {number} has {len(one)} cells, the header {len(names)}"
            )
    columns = list(zip(*cells, strict=True)) or [() for _ in names]
    return _named(names, columns, numbers, line, where)


def _plain(rows: list[str], mark: str | None) -> Array | None:
    """Return the numbers (N, K) of rows of which all cells are some, in a tenth of the memory that
    cells need; None where others are among them."""
    if not rows:
        return None
    plain = (row.replace("*", "nan") for row in rows)
    try:
        return np.loadtxt(plain, delimiter=mark, comments=None, quotechar='"', ndmin=2)
    except ValueError:
        return None


def _split(
    header: str, rows: list[str], mark: str | None, where: str
) -> tuple[list[str], list[list[str]]]:
    """Return the names of the columns and the cells of each row, between marks; None = blanks."""
    if mark is None:
        return _words(header), [row.split() for row in rows]
    try:
        first, *cells = csv.reader([header, *rows], delimiter=mark, skipinitialspace=True)
    except csv.Error as error:
        raise InputError(f"{where}: is not a CSV file: {error}") from None
    if len(cells) != len(rows):
        raise InputError(f"{where}: a quoted cell runs over several lines")
    return [name.strip() for name in first], cells


def _lines(kinds: list[tuple[str, str]]) -> list[str]:
    """Return the name of each survey line, with its kind where lines of several kinds have it."""
    names = [name for _, name in dict.fromkeys(kinds)]
    return [name if names.count(name) == 1 else f"{kind} {name}" for kind, name in kinds]


def _names_columns(row: str, header: str | None, plain: bool) -> bool:
    """Whether a row before the data is none of them: it does not begin with a number; and after a
    comment, or after a title of other than so many words, it has none at all."""
    words = _words(row)
    if plain and header is not None and len(words) == len(_words(header)):
        return False
    return not any(map(_is_number, words if header else words[:1]))


def _words(row: str) -> list[str]:
    return [word for word in re.split(r"[\s,;]+", row.strip()) if word]


def _is_number(word: str) -> bool:
    try:
        _float(word.replace("*", "nan"))
    except ValueError:
        return False
    return True


def _number(text: str, column: Column) -> float:
    """Return the number in a cell, NaN where it may be missing and is; raises ValueError."""
    if column.gaps and text.casefold() in _MISSING:
        return math.nan
    try:
        return _float(text)
    except ValueError:
        if column is not TIME:
            raise
    stamp = datetime.fromisoformat(text)
    return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()


def _float(text: str) -> float:
    return float(text.replace("_", "?"))  # Python's 1_000 is none in a file


def _seconds(time: Array, unit: str, where: str) -> Array:
    """Return times in s: since 1970 where the unit says since when."""
    scale, _, since = unit.partition(" since ")
    name = scale.strip().casefold()
    factor = _SECONDS.get(name, _SECONDS.get(name.removesuffix("s")))
    try:
        start = datetime.fromisoformat(since.strip()) if since else None
    except ValueError:
        factor = start = None
    if factor is None:
        raise InputError(
            f"{where}: unknown unit '{unit}'; must be seconds, minutes, hours, days, ms, us or ns,"
            " or so many since a date and time by ISO 8601"
        )
    if start is None:
        return time * factor
    whole = start if start.tzinfo else start.replace(tzinfo=UTC)
    return np.asarray(time * factor + whole.timestamp())
