"""ICGEM grids (.gdf) as the calculation service of icgem.gfz-potsdam.de writes them: a header of
names and values, then points."""

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import TextIO

from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.formats.format import Asked, FileGrid, file_format, grid_in_memory
from isogal.maps.formats.points import drop_gaps, grid_of_points, numbers
from isogal.maps.quantities import quantity_of

_MOST_HEADER_LINES = 200
_LONGEST_LINE = 4096


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
    expected = header.get("number_of_gridpoints")
    if expected is not None and expected.isdecimal() and int(expected) != table.shape[0]:
        raise InputError(
            f"{where}: has {table.shape[0]} points, the header says {expected}; cut short?"
        )
    latitude, longitude, values = grid_of_points(table[:, 1], table[:, 0], table[:, -1], where)
    yield grid_in_memory(
        f"{where}:{functional or '?'} ({header.get('modelname', 'unknown model')})",
        (latitude, longitude),
        drop_gaps(values, _number(header, "gapvalue", where)),
        header.get("unit") or None,
        quantity_of(functional),
    )


def _header(file: TextIO, where: str) -> dict[str, str]:
    """Read up to ``end_of_head``."""
    header: dict[str, str] = {}
    lines = iter(lambda: file.readline(_LONGEST_LINE), "")
    for line in islice(lines, _MOST_HEADER_LINES):
        words = line.split()
        if not words:
            continue
        if words[0].startswith("end_of_head"):
            return header
        if words[0].casefold() in ("longitude", "latitude"):
            if [word.casefold() for word in words[:2]] != ["longitude", "latitude"]:
                raise InputError(
                    f"{where}: the columns must begin with longitude, latitude, not"
                    f" {' '.join(words[:2])}"
                )
            if len(words) > 3:
                header["height_in_file"] = words[2]
        header.setdefault(words[0].casefold(), " ".join(words[1:]))
    raise InputError(
        f"{where}: has no line 'end_of_head' in its first {_MOST_HEADER_LINES} lines; not an ICGEM"
        " grid"
    )


def _number(header: dict[str, str], key: str, where: str) -> float | None:
    if key not in header:
        return None
    try:
        return float(header[key].split()[0])
    except (ValueError, IndexError):
        raise InputError(f"{where}: header {key} is not a number: '{header[key][:40]}'") from None


FORMAT = file_format("gdf", (".gdf",), _open)
