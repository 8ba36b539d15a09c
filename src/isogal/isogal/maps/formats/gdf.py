"""ICGEM grids (.gdf) as the calculation service of icgem.gfz-potsdam.de writes them: a header of
names and values, then points."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TextIO

from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.formats.format import Asked, FileGrid, file_format
from isogal.maps.formats.points import drop_gaps, grid_of_points, numbers
from isogal.maps.quantities import quantity_of

_MOST_HEADER_LINES = 200


@contextmanager
def _open(path: Path, asked: Asked) -> Iterator[FileGrid]:
    """Read a file, which must hold the functional that is asked for."""
    where = str(path)
    with reading(path), path.open(encoding="ascii", errors="replace") as file:
        header = _header(file, where)
        columns = 4 if header.get("height_in_file") else 3
        table = numbers(file, columns, where)
    functional = header.get("functional", "")
    if asked.variable not in (None, functional):
        raise InputError(f"{where}: holds '{functional}', not '{asked.variable}'")
    expected = header.get("number_of_gridpoints", "")
    if expected.isdecimal() and int(expected) != table.shape[0]:
        raise InputError(
            f"{where}: has {table.shape[0]} points, the header says {expected}; cut short?"
        )
    gap = header.get("gapvalue", "nan")
    try:
        known = drop_gaps(table[:, -1], float(gap))
    except ValueError:
        raise InputError(f"{where}: header gapvalue is not a number: '{gap[:40]}'") from None
    latitude, longitude, values = grid_of_points(table[:, 1], table[:, 0], known, where=where)
    yield FileGrid(
        where=f"{where}:{functional or '?'} ({header.get('modelname', 'unknown model')})",
        latitude=latitude,
        longitude=longitude,
        values=values,
        unit=header.get("unit") or None,
        quantity=quantity_of(functional),
    )


def _header(file: TextIO, where: str) -> dict[str, str]:
    """Read up to ``end_of_head``."""
    header: dict[str, str] = {}
    for line in islice(file, _MOST_HEADER_LINES):
        name, *words = line.casefold().split() or [""]
        if name.startswith("end_of_head"):
            return header
        if name == "latitude":
            raise InputError(f"{where}: the columns must begin with longitude, latitude")
        header.setdefault(name, " ".join(line.split()[1:]))
        if name == "longitude" and len(words) > 2:
            header["height_in_file"] = words[1]
    raise InputError(
        f"{where}: has no line 'end_of_head' in its first {_MOST_HEADER_LINES} lines; not an ICGEM"
        " grid"
    )


FORMAT = file_format("gdf", (".gdf",), _open)
