"""XYZ text: a table of longitude, latitude and value, one point a line, on a regular grid.

Columns are those of `isogal.maps.gridding.rows`, named by the first line (``lon lat dg``; a
leading # is allowed); a unit may follow a name in brackets (``dg[mGal]``). A file without such a
line needs the order of its columns, ``lon,lat,dg``, as the variable asked for."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.formats.format import Asked, FileGrid, file_format
from isogal.maps.formats.points import grid_of_points
from isogal.maps.gridding.reading import value_column
from isogal.maps.gridding.rows import LATITUDE, LONGITUDE, Column, Rows, rows_of_text

_COLUMNS = {
    name: Column(one.names, unit=one.unit) for name, one in (("lat", LATITUDE), ("lon", LONGITUDE))
}
"""Without limits: what is beyond them is looked at as a grid."""


@contextmanager
def _open(path: Path, asked: Asked) -> Iterator[FileGrid]:
    """Read a file: the column that is asked for, or all columns where their order is asked for."""
    rows = _rows(path, asked.variable)
    ordered = asked.variable is not None and "," in asked.variable
    name = value_column(rows, _COLUMNS.values(), None if ordered else asked.variable)
    found = rows.read(_COLUMNS | {"value": Column((name,), gaps=True)}, tuple(_COLUMNS))
    latitude, longitude, values = grid_of_points(
        found["lat"], found["lon"], found["value"], where=rows.where
    )
    yield FileGrid(
        where=f"{rows.where}:{name}",
        latitude=latitude,
        longitude=longitude,
        values=values,
        unit=rows.units.get(name),
        quantity=rows.quantities.get(name),
    )


def _rows(path: Path, order: str | None) -> Rows:
    """Return the rows of a file; `order`: names of its columns, where it does not name them."""
    with reading(path):
        text = path.read_text(encoding="utf-8-sig", errors="replace")
    if not text.strip():
        raise InputError(f"{path}: is empty; it needs columns of longitude, latitude and values")
    first, _, rest = text.partition("\n")
    words = re.split(r"[\s,;]+", re.sub(r"[\[(].*?[\])]", "", first.lstrip("#> ")).casefold())
    if not all(set(words) & set(column.names) for column in _COLUMNS.values()):
        if order is None or order.count(",") < 2:
            raise InputError(
                f"{path}: does not name its columns; give variable= (--variable, map.variable)"
                " their order, for example lon,lat,dg"
            )
        mark = next((mark for mark in ",;" if mark in first), " ")
        first, rest = order.replace(",", mark), text
    return rows_of_text(f"{first.lstrip('#> ')}\n{rest}", "longitude, latitude, value", str(path))


FORMAT = file_format("xyz", (".xyz", ".txt", ".csv", ".dat"), _open)
