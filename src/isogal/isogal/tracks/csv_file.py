"""Recorded tracks in text files with the columns latitude, longitude (or x and y) and value, and
optionally time, sigma, offset and line."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.inertial.ins_file import ANGLES, VELOCITY
from isogal.maps.gridding.reading import geographic
from isogal.maps.gridding.rows import LATITUDE, LONGITUDE, TIME, Column, Rows, read_rows
from isogal.tracks.track import Track

REQUIRED = ("latitude", "longitude", "value")
_PLACES = {"latitude": LATITUDE, "longitude": LONGITUDE}
_PROJECTED = {
    "x": Column(("x", "easting", "east"), unit=" m"),
    "y": Column(("y", "northing", "north"), unit=" m"),
}


def read_csv_tracks(
    path: str | Path, crs: str | None = None, column: str | Sequence[str] = "value"
) -> list[Track]:
    """Read a file with a header line (`isogal.maps.gridding.rows`): a track for each survey line.

    Other columns are ignored. Times are seconds, or dates and times by ISO 8601 (UTC unless they
    say another zone), then seconds since 1970. An empty cell, ``*``, ``NaN`` or a dummy such as
    -99999 is a missing reading.

    Parameters
    ----------
    path : path
    crs : str, optional
        System of columns x and y (or easting and northing), as ``EPSG:N``.
    column : str or sequence of str
        Of the readings, or the names that it may have. With another than ``value`` the columns
        NAME_sigma and NAME_offset go with it, not sigma and offset.

    Raises
    ------
    InputError
        The file cannot be read or lacks a column; or a cell is not a number, a place is out of
        range, or times do not increase, with the number of the line.
    """
    rows = read_rows(path, ", ".join(REQUIRED))
    names = (column,) if isinstance(column, str) else column
    names = tuple(name.strip().casefold() for name in names)
    readings = {
        "time": TIME,
        "value": Column(names, gaps=True),
        "sigma": Column(_beside(names, "sigma"), least=math.ulp(0.0), gaps=True),
        "offset": Column(_beside(names, "offset"), gaps=True),
    }
    projected = rows.index(LATITUDE) is None and None not in map(rows.index, _PROJECTED.values())
    places = _PROJECTED if projected else _PLACES
    columns = rows.read(places | readings, (*places, "value"))
    unit = rows.in_one_unit(columns, readings, ("value", "sigma", "offset"))
    if projected:
        columns |= geographic(columns["x"], columns["y"], crs, rows.where)
        if not np.isfinite(columns["latitude"]).all():
            raise InputError(f"{rows.where}: x and y are not places in {crs}")
    lines = [None] * len(rows) if rows.line is None else rows.line
    of_line = {
        one: np.flatnonzero([name == one for name in lines]) for one in dict.fromkeys(lines)
    }
    return [
        replace(_track(columns, rows, which, one, projected), unit=unit)
        for one, which in of_line.items()
    ]


def _beside(names: Sequence[str], what: str) -> tuple[str, ...]:
    """Return what the columns of sigma or offset beside readings may be called."""
    return tuple(what if name == "value" else f"{name}_{what}" for name in names)


def _track(
    columns: dict[str, Array], rows: Rows, which: Integers, line: str | None, projected: bool
) -> Track:
    own = {name: column[which] for name, column in columns.items() if name not in _PROJECTED}
    count = np.arange(which.size, dtype=np.float64)
    time = own.get("time", count)
    rows.check_times(time, which.tolist())
    offset = own.get("offset", 0.0 * count)
    return Track(
        time=time,
        latitude=np.radians(own["latitude"]),
        longitude=np.radians(own["longitude"]),
        value=np.where(np.isfinite(offset), own["value"], np.nan),
        sigma=own.get("sigma", math.nan * count),
        offset=np.nan_to_num(offset),
        where=rows.where if line is None else f"{rows.where}, line {line}",
        line=line,
        timed="time" in own,
        projected=projected,
        unused=tuple(name for name in (*VELOCITY, *ANGLES) if name in rows.names),
    )
