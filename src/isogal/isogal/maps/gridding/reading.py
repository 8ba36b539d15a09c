"""Survey readings from files: CSV and other tables of text, Geosoft XYZ, NetCDF."""

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.maps.formats.netcdf import open_netcdf, quantity_in, text_of, unpacked
from isogal.maps.gridding.survey import Survey, survey_of
from isogal.maps.gridding.text_table import read_table
from isogal.maps.quantities import quantity_of

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


def read_survey(
    path: str | Path,
    variable: str | None = None,
    *,
    quantity: str | None = None,
    unit: str | None = None,
    crs: str | None = None,
) -> Survey:
    """Read a survey; the format is known by the file's suffix.

    Columns are known by their names (`_NAMES`). NetCDF needs variables of one dimension.

    Parameters
    ----------
    path : path
        ``.nc``, ``.nc4``, ``.cdf``, else text.
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
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}")
    netcdf = path.suffix.casefold() in (".nc", ".nc4", ".cdf")
    with _netcdf(path) if netcdf else _text(path) as table:
        used = _assign(table.names)
        _require_places(used, table.names, str(path))
        name = _value(table, used, variable, str(path))
        columns: dict[str, Array | None] = {
            kind: table.numbers(own) for kind, own in used.items() if own != name
        }
        columns["value"] = table.numbers(name)
    if table.line is not None:
        columns.setdefault("line", table.line)
    if columns.get("latitude") is None:
        columns |= geographic(columns["x"], columns["y"], crs, str(path))
    return survey_of(
        columns,
        unit=unit or table.unit[name],
        quantity=quantity or table.quantity[name],
        where=f"{path}:{name}",
    )


class _Table(NamedTuple):
    """Columns of a file, by name."""

    names: list[str]
    quantity: dict[str, str | None]
    """As the file says, or a name; None = not known."""
    unit: dict[str, str | None]
    numbers: Callable[[str], Array]
    """Returns a column (N,), NaN = missing."""
    line: Array | None = None
    """(N,) survey line by the rows that begin one; None = there are none."""


def _assign(names: Sequence[str]) -> dict[str, str]:
    """Return which of some names means which column."""
    by_name = {name.casefold(): name for name in names}
    return {
        kind: next(by_name[alias] for alias in aliases if alias in by_name)
        for kind, aliases in _NAMES.items()
        if any(alias in by_name for alias in aliases)
    }


def _value(table: _Table, used: dict[str, str], variable: str | None, where: str) -> str:
    """Return the name of the column of values."""
    names = table.names
    if variable is not None:
        found = [name for name in names if name.casefold() == variable.casefold()]
        if not found:
            raise InputError(
                f"{where}: has no column '{variable}'; it has {', '.join(names) or 'none'}"
            )
        return found[0]
    others = [name for name in names if name not in used.values()]
    telling = [name for name in others if table.quantity[name] not in (None, "height")]
    if len(telling) == 1 or len(others) == 1:
        return telling[0] if len(telling) == 1 else others[0]
    raise InputError(
        f"{where}: does not say which column holds the values; give --variable, one of"
        f" {', '.join(telling or others) or '(it has no other column)'}"
    )


def _require_places(used: dict[str, str], names: Sequence[str], where: str) -> None:
    for pair in (("latitude", "longitude"), ("x", "y")):
        if all(kind in used for kind in pair):
            return
    raise InputError(
        f"{where}: has no columns latitude and longitude (or x and y, with --crs); it has"
        f" {', '.join(names) or 'none'}"
    )


@contextmanager
def _text(path: Path) -> Iterator[_Table]:
    table = read_table(path)
    names = [re.sub(r"[\[(].*", "", name).strip() for name in table.names]
    units = [re.search(r"[\[(](.+?)[\])]", name) for name in table.names]
    yield _Table(
        names,
        {name: quantity_of(name) for name in names},
        {name: unit and unit[1] for name, unit in zip(names, units, strict=True)},
        lambda name: table.numbers[:, names.index(name)],
        table.line,
    )


@contextmanager
def _netcdf(path: Path) -> Iterator[_Table]:
    with open_netcdf(path) as dataset:
        flat = {
            name: data
            for name, data in dataset.variables.items()
            if data.ndim == 1 and np.dtype(data.dtype).kind in "iuf"
        }
        used = _assign(list(flat))
        place = used.get("latitude", used.get("y"))
        if place is not None:
            along = flat[place].dimensions
            flat = {name: data for name, data in flat.items() if data.dimensions == along}
        yield _Table(
            list(flat),
            {name: quantity_in(data) for name, data in flat.items()},
            {name: text_of(data, "units") for name, data in flat.items()},
            lambda name: unpacked(flat[name], flat[name][:]).astype(np.float64),
        )


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
