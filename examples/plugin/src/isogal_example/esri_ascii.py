"""ESRI ASCII grids (.asc): a header of names and numbers, then the rows from north to south.

The header is ``ncols``, ``nrows``, ``xllcorner`` or ``xllcenter``, ``yllcorner`` or ``yllcenter``
(degrees), ``cellsize`` and, where values are missing, ``NODATA_value``. It says neither quantity
nor unit, so the user has to. Source: Esri, ArcGIS documentation, "Esri ASCII raster format"."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path

import numpy as np

from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.axes import check_size
from isogal.maps.formats.format import Asked, FileGrid, file_format
from isogal.maps.formats.points import drop_gaps

_KEYS = {
    *("ncols", "nrows", "xllcorner", "xllcenter", "yllcorner", "yllcenter"),
    *("cellsize", "nodata_value"),
}


@contextmanager
def open_esri_ascii(path: Path, asked: Asked) -> Iterator[FileGrid]:
    """Read a grid; see `isogal.maps.formats.format.Opener`.

    Raises
    ------
    InputError
        An incomplete header, too few or too many numbers, or a variable is asked for, of which
        this format has but one without a name.
    """
    where = str(path)
    if asked.variable is not None:
        raise InputError(f"{where}: holds one variable without a name, not '{asked.variable}'")
    with reading(path):
        lines = path.read_text(encoding="ascii", errors="replace").splitlines()
    header = _header(lines, where)
    rows, columns = (int(_number(header, where, key)) for key in ("nrows", "ncols"))
    step = _number(header, where, "cellsize")
    if min(rows, columns) < 4 or not step > 0.0:
        raise InputError(f"{where}: needs nrows and ncols of at least 4 and cellsize > 0")
    check_size(rows * columns, where)
    try:
        numbers = np.array(" ".join(lines[len(header) :]).split(), dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{where}: {error}") from None
    if numbers.size != rows * columns:
        raise InputError(
            f"{where}: has {numbers.size} values, the header says {rows} x {columns}; cut short?"
        )
    south, west = (_first_node(header, where, axis, step) for axis in "yx")
    yield FileGrid(
        where=where,
        latitude=np.radians(south + step * np.arange(rows)),
        longitude=np.radians(west + step * np.arange(columns)),
        values=drop_gaps(numbers, header.get("nodata_value")).reshape(rows, columns)[::-1],
    )


def _header(lines: list[str], where: str) -> dict[str, float]:
    header: dict[str, float] = {}
    for line in islice(lines, len(_KEYS)):
        key, *value = line.casefold().split(maxsplit=1) or [""]
        if key not in _KEYS:
            break
        try:
            header[key] = float(*value)
        except ValueError:
            raise InputError(f"{where}: {key} must be a number, not '{value[0]}'") from None
    return header


def _number(header: dict[str, float], where: str, key: str) -> float:
    if not np.isfinite(header.get(key, np.nan)):
        raise InputError(f"{where}: the header needs {key} as a number; is it an ESRI ASCII grid?")
    return header[key]


def _first_node(header: dict[str, float], where: str, axis: str, step: float) -> float:
    """Return the south (y) or west (x) node, deg: the centre of the first cell."""
    if f"{axis}llcenter" in header:
        return _number(header, where, f"{axis}llcenter")
    return _number(header, where, f"{axis}llcorner") + 0.5 * step


FORMAT = file_format("esri-ascii", (".asc",), open_esri_ascii)
