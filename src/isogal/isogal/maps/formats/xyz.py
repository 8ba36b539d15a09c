"""XYZ text: a table of longitude, latitude and value, one point a line, on a regular grid."""

import re
from pathlib import Path

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.assemble import assemble
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Format, by_suffix
from isogal.maps.formats.points import drop_gaps, grid_of_points, numbers
from isogal.maps.quantities import quantity_of

_LONGEST_LINE = 4096
_LATITUDE, _LONGITUDE = ("lat", "latitude"), ("lon", "long", "longitude")


def read_xyz(
    path: str | Path,
    variable: str | None = None,
    window: Window | None = None,
    *,
    quantity: str | None = None,
    unit: str | None = None,
) -> FieldMap:
    """Read a text table as a map.

    The columns are those that the first line names (``lon lat dg``; a leading # is allowed),
    separated by blanks, tabs, commas or semicolons; a unit may follow a name in brackets
    (``dg[mGal]``). A file without such a line needs its columns named in ``variable``.

    Parameters
    ----------
    path : path
        File.
    variable : str, optional
        The column that holds the values; or all columns in order, ``lon,lat,dg``, where the file
        does not name them.
    window : Window, optional
        Only this part is kept.
    quantity, unit : str, optional
        What the columns do not say.

    Raises
    ------
    InputError
        Columns not named, a line that is not numbers, points off a regular grid, unit or quantity
        not said, impossible numbers.
    """
    where = str(path)
    names, table = _table(Path(path), variable, where)
    if variable is not None and "," in variable:
        variable = None  # the order of all columns
    plain = [re.sub(r"[\[(].*", "", name).casefold() for name in names]
    lat, lon, value = _columns(plain, variable, where)
    latitude, longitude, values = grid_of_points(
        table[:, lat], table[:, lon], drop_gaps(table[:, value], None), where
    )
    bracket = re.search(r"[\[(](.+?)[\])]", names[value])
    field_map = assemble(
        latitude,
        longitude,
        values,
        unit=unit or (bracket.group(1) if bracket else None),
        quantity=quantity or quantity_of(plain[value]),
        where=f"{where}:{plain[value]}",
    )
    return field_map if window is None else field_map.window(*window[:4])


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


FORMAT = Format("xyz", by_suffix(".xyz", ".txt", ".csv", ".dat"), read_xyz)
