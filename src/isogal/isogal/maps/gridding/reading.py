"""Survey readings from files: tables of text, Geosoft XYZ, MGD77, NetCDF."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.gridding.rows import Column, Rows, read_rows
from isogal.maps.gridding.survey import Survey, survey_of

_NAMES = {
    "latitude": ("latitude", "lat"),
    "longitude": ("longitude", "lon", "long", "lng"),
    "x": ("x", "easting", "east", "e"),
    "y": ("y", "northing", "north", "n"),
    "height": ("height", "altitude", "alt", "elevation", "height_m", "gpsalt", "gps_height"),
    "sigma": ("sigma", "std", "standard_deviation", "uncertainty"),
    "line": ("line", "line_number", "flight_line", "fltline", "track"),
    "time": ("time", "utc_time", "utctime", "gps_time", "gpstime", "fiducial", "fid"),
}
"""Names of columns, in any case."""
_OWN = {"latitude": " deg", "longitude": " deg", "x": " m", "y": " m", "height": " m"}
_COLUMNS = {
    kind: Column(names, unit=_OWN.get(kind, ""), gaps=True) for kind, names in _NAMES.items()
}
_COLUMNS["sigma"] = _COLUMNS["sigma"]._replace(least=math.ulp(0.0))


def read_survey(
    path: str | Path,
    variable: str | None = None,
    *,
    quantity: str | None = None,
    unit: str | None = None,
    crs: str | None = None,
) -> Survey:
    """Read a survey; columns are known by their names (`_NAMES`).

    Parameters
    ----------
    path : path
        As `isogal.maps.gridding.rows.read_rows` takes it.
    variable : str, optional
        Column of the values; needed where it is not the only one that can be.
    quantity, unit : str, optional
        What the file does not say.
    crs : str, optional
        System of columns x and y, as ``EPSG:N``.

    Raises
    ------
    InputError
        The file cannot be read, lacks columns, does not say what it holds, or holds what cannot
        be.
    """
    rows = read_rows(path, "latitude, longitude, value and the like")
    used = {kind: column for kind, column in _COLUMNS.items() if rows.index(column) is not None}
    if not ({"latitude", "longitude"} <= used.keys() or {"x", "y"} <= used.keys()):
        raise InputError(
            f"{rows.where}: has no columns latitude and longitude (or x and y, with --crs); it has"
            f" {', '.join(rows.names) or 'none'}"
        )
    name = value_column(rows, used.values(), variable)
    own = rows.names.index(name)
    wanted = {kind: column for kind, column in used.items() if rows.index(column) != own}
    wanted["value"] = Column((name,), gaps=True)
    if rows.line is not None:
        wanted.pop("line", None)
    found = rows.read(wanted, ())
    own_unit = rows.in_one_unit(found, wanted, ("value", "sigma"))
    columns: dict[str, Array | None] = {**found}
    names: dict[int, str] = {}
    if rows.line is not None:
        names = _numbered(rows.line)
        number = {line: k for k, line in names.items()}
        columns["line"] = np.array([float(number[line]) for line in rows.line])
    if columns.get("latitude") is None:
        columns |= geographic(columns["x"], columns["y"], crs, rows.where)
    return survey_of(
        columns,
        unit=unit or own_unit,
        quantity=quantity or rows.quantities.get(name),
        where=f"{rows.where}:{name}",
        line_names=names,
    )


def value_column(rows: Rows, used: Iterable[Column], variable: str | None) -> str:
    """Return the name of the column of values beside those that are used for something else;
    raises InputError where it cannot be told."""
    if variable is not None:
        if variable.casefold() not in rows.names:
            raise InputError(
                f"{rows.where}: has no column '{variable}'; it has"
                f" {', '.join(rows.names) or 'none'}"
            )
        return variable.casefold()
    known = [rows.names[i] for column in used if (i := rows.index(column)) is not None]
    others = [name for name in rows.names if name not in known]
    telling = [name for name in others if rows.quantities.get(name) not in (None, "height")]
    if len(telling) == 1 or len(others) == 1:
        return telling[0] if len(telling) == 1 else others[0]
    raise InputError(
        f"{rows.where}: does not say which column holds the values; give --variable, one of"
        f" {', '.join(telling or others) or '(it has no other column)'}"
    )


def _numbered(lines: list[str]) -> dict[int, str]:
    """Return the name of each survey line by a number of its own: its name where all are whole
    numbers."""
    names = list(dict.fromkeys(lines))
    try:
        numbers = [float(name) for name in names]
    except ValueError:
        numbers = []
    if len(set(numbers)) < len(names) or any(number % 1.0 for number in numbers):
        numbers = list(map(float, range(len(names))))
    return {round(number): name for number, name in zip(numbers, names, strict=True)}


def geographic(x: Array | None, y: Array | None, crs: str | None, where: str) -> dict[str, Array]:
    """Return latitude and longitude (deg) of columns x and y; NaN where they are no places.

    Parameters
    ----------
    x, y : (N,) arrays
        In the system's unit; None = the file has no such column.
    crs : str, optional
        The system, as ``EPSG:N``.
    where : str
        File, for messages.

    Raises
    ------
    InputError
        No system, or one that is not known.
    """
    import pyproj

    if crs is None:
        raise InputError(f"{where}: has columns x and y; say their system (--crs EPSG:N)")
    try:
        turn = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.CRSError:
        raise InputError(f"--crs {crs}: is no coordinate system that is known") from None
    longitude, latitude = turn.transform(x, y)
    finite = np.isfinite(longitude) & np.isfinite(latitude)
    return {
        "latitude": np.where(finite, latitude, np.nan),
        "longitude": np.where(finite, longitude, np.nan),
    }
