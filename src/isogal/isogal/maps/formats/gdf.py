"""ICGEM grids (.gdf) as the calculation service of icgem.gfz-potsdam.de writes them: a header of
names and values, then points."""

from itertools import islice
from pathlib import Path

import numpy as np

from isogal.errors import InputError
from isogal.files import reading
from isogal.maps.assemble import assemble
from isogal.maps.axes import Window
from isogal.maps.field_map import FieldMap
from isogal.maps.formats.format import Format, by_suffix
from isogal.maps.formats.points import drop_gaps, grid_of_points, numbers
from isogal.maps.quantities import quantity_of

_MOST_HEADER_LINES = 200
_LONGEST_LINE = 4096
_FUNCTIONALS = {
    "gravity_earth": "gravity",
    "gravity_disturbance": "disturbance",
    "gravity_disturbance_sa": "disturbance",
    "gravity_anomaly": "gravity_anomaly",
    "gravity_anomaly_cl": "gravity_anomaly",
    "gravity_anomaly_sa": "gravity_anomaly",
    "gravity_anomaly_bg": "bouguer_anomaly",
    "geoid": "geoid",
    "height_anomaly": "geoid",
    "height_anomaly_ell": "geoid",
    "topography_grd": "height",
    "topography_shm": "height",
    "etopo1_shm": "height",
}
"""Quantities of ICGEM's functionals; a disturbance in spherical approximation (_sa) differs by
under 0.1 %."""


def read_gdf(
    path: str | Path,
    variable: str | None = None,
    window: Window | None = None,
    *,
    quantity: str | None = None,
    unit: str | None = None,
) -> FieldMap:
    """Read an ICGEM grid as a map.

    Parameters
    ----------
    path : path
        File.
    variable : str, optional
        The functional, to make sure that it is the one in the file.
    window : Window, optional
        Only this part is kept.
    quantity, unit : str, optional
        Instead of what the header says.

    Raises
    ------
    InputError
        No header, an unknown functional, a table that is not a grid or not the one the header
        describes, impossible numbers.
    """
    where = str(path)
    with reading(path), Path(path).open(encoding="ascii", errors="replace") as file:
        header = _header(file, where)
        columns = 4 if header.get("height_in_file") else 3
        table = numbers(file, columns, where)
    functional = header.get("functional", "")
    if variable is not None and variable != functional:
        raise InputError(f"{where}: holds '{functional}', not '{variable}'")
    expected = header.get("number_of_gridpoints")
    if expected is not None and expected.isdecimal() and int(expected) != table.shape[0]:
        raise InputError(
            f"{where}: has {table.shape[0]} points, the header says {expected}; cut short?"
        )
    latitude, longitude, values = grid_of_points(table[:, 1], table[:, 0], table[:, -1], where)
    _check_limits(header, np.degrees(latitude), np.degrees(longitude), where)
    values = drop_gaps(values, _number(header, "gapvalue", where))
    field_map = assemble(
        latitude,
        longitude,
        values,
        unit=unit or header.get("unit") or None,
        quantity=quantity or _FUNCTIONALS.get(functional) or quantity_of(functional),
        where=f"{where}:{functional or '?'} ({header.get('modelname', 'unknown model')})",
    )
    return field_map if window is None else field_map.window(*window[:4])


def _header(file: object, where: str) -> dict[str, str]:
    """Read up to ``end_of_head``."""
    header: dict[str, str] = {}
    lines = iter(lambda: file.readline(_LONGEST_LINE), "")  # type: ignore[attr-defined]
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


def _check_limits(
    header: dict[str, str], latitude: np.ndarray, longitude: np.ndarray, where: str
) -> None:
    """Compare the points with the limits in the header: a file cut short lacks its last rows."""
    for key, found in (
        ("latlimit_north", latitude[-1]),
        ("latlimit_south", latitude[0]),
        ("longlimit_west", longitude[0]),
        ("longlimit_east", longitude[-1]),
    ):
        limit = _number(header, key, where)
        step = _number(header, "gridstep", where)
        if limit is not None and abs(limit - found) > 0.5 * (step or latitude[1] - latitude[0]):
            raise InputError(
                f"{where}: points end at {found:.6g} deg, the header says {key} {limit:.6g}; cut"
                " short, or swapped?"
            )


FORMAT = Format("gdf", by_suffix(".gdf"), read_gdf)
