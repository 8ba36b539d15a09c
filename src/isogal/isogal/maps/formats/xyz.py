"""XYZ text: a table of longitude, latitude and value, one point a line, on a regular grid.

The columns are those that the first line names (``lon lat dg``; a leading # is allowed), separated
by blanks, tabs, commas or semicolons; a unit may follow a name in brackets (``dg[mGal]``). A file
without such a line needs the order of its columns, ``lon,lat,dg``, as the variable asked for."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.formats.format import Asked, FileGrid, file_format, grid_in_memory
from isogal.maps.formats.points import drop_gaps, grid_of_points, numbers
from isogal.maps.quantities import quantity_of

_LONGEST_LINE = 4096
_LATITUDE, _LONGITUDE = ("lat", "latitude"), ("lon", "long", "longitude")


@contextmanager
def _open(path: Path, asked: Asked) -> Iterator[FileGrid]:
    """Read a file: the column that is asked for, or all columns where their order is asked for."""
    where = str(path)
    names, table = _table(path, asked.variable, where)
    ordered = asked.variable is not None and "," in asked.variable
    plain = [re.sub(r"[\[(].*", "", name).casefold() for name in names]
    lat, lon, value = _columns(plain, None if ordered else asked.variable, where)
    *axes, values = grid_of_points(
        table[:, lat], table[:, lon], drop_gaps(table[:, value], None), where
    )
    bracket = re.search(r"[\[(](.+?)[\])]", names[value])
    yield grid_in_memory(
        f"{where}:{plain[value]}",
        (axes[0], axes[1]),
        values,
        bracket.group(1) if bracket else None,
        quantity_of(plain[value]),
    )


def _table(path: Path, variable: str | None, where: str) -> tuple[list[str], Array]:
    """Return the names of the columns and the numbers (N, columns)."""
    with reading(path), path.open(encoding="utf-8", errors="replace") as file:
        first = file.readline(_LONGEST_LINE)
        names = _names(first)
        if names is None:
            if variable is None or variable.count(",") < 2:
                raise InputError(
                    f"{where}: does not name its columns; give variable= (--variable) their order,"
                    " for example lon,lat,dg"
                )
            names = _split(variable)
            file.seek(0)
        delimiter = next((mark for mark in ",;" if mark in first), None)
        return names, numbers(file, len(names), where, delimiter)


def _split(line: str) -> list[str]:
    return [word for word in re.split(r"[\s,;]+", line.strip().lstrip("#>").strip()) if word]


def _names(line: str) -> list[str] | None:
    """Return the column names if the line holds names and not numbers."""
    words = _split(line)
    known = {re.sub(r"[\[(].*", "", word).casefold() for word in words}
    return words if known & set(_LATITUDE) and known & set(_LONGITUDE) else None


def _columns(names: list[str], variable: str | None, where: str) -> tuple[int, int, int]:
    """Return the columns of latitude, longitude and value."""
    lats, lons = (
        [i for i, name in enumerate(names) if name in wanted] for wanted in (_LATITUDE, _LONGITUDE)
    )
    others = [i for i in range(len(names)) if i not in lats + lons]
    if variable is not None:
        others = [i for i in others if names[i] == variable.casefold()]
    if len(lats) != 1 or len(lons) != 1 or len(others) != 1:
        raise InputError(
            f"{where}: needs one latitude, one longitude and one value column; has"
            f" {', '.join(names)}; give variable= (--variable)"
        )
    return lats[0], lons[0], others[0]


FORMAT = file_format("xyz", (".xyz", ".txt", ".csv", ".dat"), _open)
