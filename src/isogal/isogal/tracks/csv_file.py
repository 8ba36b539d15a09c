"""Recorded tracks in text files with the columns latitude, longitude (or x and y) and value, and
optionally time, sigma, offset and line."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.magnetics.diurnal import BaseStation
from isogal.maps.corridor import Corridor, corridor_of
from isogal.maps.gridding.reading import geographic
from isogal.tracks.text_rows import LATITUDE, LONGITUDE, TIME, Column, TextRows, read_rows
from isogal.tracks.track import Track

REQUIRED = ("latitude", "longitude", "value")
_COLUMNS = {
    "time": TIME,
    "latitude": LATITUDE,
    "longitude": LONGITUDE,
    "x": Column(("x", "easting", "east")),
    "y": Column(("y", "northing", "north")),
    "value": Column(("value",), gaps=True),
    "sigma": Column(("sigma",), least=math.ulp(0.0), gaps=True),
    "offset": Column(("offset",), gaps=True),
    "line": Column(("line",)),
}


@dataclass(frozen=True, slots=True, eq=False)
class CsvTrack:
    """Columns of a file in its own units, (N,) each; None = no such column."""

    where: str
    time: Array
    latitude: Array
    """deg."""
    longitude: Array
    """deg."""
    value: Array
    sigma: Array | None
    offset: Array | None
    line: str | None = None
    """Survey line; None = the file has none."""
    timed: bool = True
    """Whether the file says when readings were taken; else times are their numbers."""
    projected: bool = False
    """Whether its places are x and y."""

    def corridor(self, margin: float) -> Corridor:
        """Return the part of the Earth within a margin (m) of the track."""
        return corridor_of(np.radians(self.latitude), np.radians(self.longitude), margin)

    def less_variation(self, station: BaseStation) -> "CsvTrack":
        """Return the track without the daily variation of a base station, values in nT; raises
        InputError where the file has no times or the station was not on at them."""
        if not self.timed:
            raise InputError(f"{self.where}: a base station needs the track's column time")
        return replace(self, value=self.value - station.variation(self.time, self.where))

    def track(self, factor: float, sensor_sigma: float | None, reduction: str = "none") -> Track:
        """Return the track, with values in the map's unit inside.

        Parameters
        ----------
        factor : float
            Number of units inside (`FieldMap.unit`) in one unit of the columns value, sigma and
            offset.
        sensor_sigma : float, optional
            1-sigma of the readings where the file has no column ``sigma``, unit inside.
        reduction : str
            See `Track.reduction`.

        Raises
        ------
        InputError
            Neither the file nor ``sensor_sigma`` says how noisy the readings are, or `Track`
            refuses them.
        """
        value = self.value * factor
        if self.offset is not None:
            value = np.where(np.isfinite(self.offset), value, np.nan)
        if self.sigma is not None:
            sigma = self.sigma * factor
            if sensor_sigma is not None:
                sigma = np.where(np.isfinite(sigma), sigma, sensor_sigma)
        elif sensor_sigma is not None:
            sigma = np.full(self.time.size, sensor_sigma)
        else:
            raise InputError(f"{self.where}: has no column sigma; give --sensor-sigma")
        return Track(
            time=self.time,
            latitude=np.radians(self.latitude),
            longitude=np.radians(self.longitude),
            value=value,
            sigma=sigma,
            offset=(
                np.zeros(self.time.size)
                if self.offset is None
                else np.nan_to_num(self.offset) * factor
            ),
            where=self.where,
            reduction=reduction,
            factor=factor,
        )


def read_csv_track(path: str | Path, crs: str | None = None) -> CsvTrack:
    """Read a file that holds one track; see `read_csv_tracks`.

    Raises
    ------
    InputError
        As there, and if the file holds several.
    """
    tracks = read_csv_tracks(path, crs)
    if len(tracks) > 1:
        raise InputError(f"{path}: holds {len(tracks)} lines; only one is wanted here")
    return tracks[0]


def read_csv_tracks(
    path: str | Path, crs: str | None = None, column: str | Sequence[str] = "value"
) -> list[CsvTrack]:
    """Read a file with a header line (`isogal.tracks.text_rows`): a track for each survey line.

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
    where = str(path)
    rows = read_rows(path, ", ".join(REQUIRED))
    aliases = tuple(
        one.strip().casefold() for one in ([column] if isinstance(column, str) else column)
    )
    known = dict(_COLUMNS)
    if aliases != ("value",):
        known["value"] = known["value"]._replace(names=aliases)
        for beside in ("sigma", "offset"):
            names = tuple(f"{one}_{beside}" for one in aliases)
            known[beside] = known[beside]._replace(names=names)
    index = rows.find(known)
    projected = "latitude" not in index and "x" in index and "y" in index
    for name in ("value",) if projected else REQUIRED:
        if name not in index:
            raise rows.lacks(aliases[0] if name == "value" else name)
    if not rows.cells:
        raise InputError(f"{where}: has no readings")
    columns = {
        name: rows.numbers(i, name, known[name]) for name, i in index.items() if name != "line"
    }
    if projected:
        columns |= geographic(columns["x"], columns["y"], crs, where)
        if not np.isfinite(columns["latitude"]).all():
            raise InputError(f"{where}: x and y are not places in {crs}")
    lines = rows.line
    if "line" in index:
        lines = [row[index["line"]].strip() for row in rows.cells]
    if lines is None:
        return [_track(columns, rows, np.arange(len(rows.cells)), None, projected)]
    return [
        _track(columns, rows, np.flatnonzero(np.array(lines) == one), one, projected)
        for one in dict.fromkeys(lines)
    ]


def _track(
    columns: dict[str, Array], rows: TextRows, which: Integers, line: str | None, projected: bool
) -> CsvTrack:
    where = rows.where
    own = {name: column[which] for name, column in columns.items()}
    timed = "time" in own
    if not timed:
        own["time"] = np.arange(which.size, dtype=np.float64)
    late = np.flatnonzero(np.diff(own["time"]) <= 0.0)
    if late.size:
        i = int(late[0])
        raise InputError(
            f"{where}: times must increase; line {rows.number[which[i + 1]]}"
            f" ({own['time'][i + 1]:.10g} s) is not later than line {rows.number[which[i]]}"
            f" ({own['time'][i]:.10g} s)"
        )
    return CsvTrack(
        where if line is None else f"{where}, line {line}",
        **{name: own[name] for name in ("time", *REQUIRED)},
        sigma=own.get("sigma"),
        offset=own.get("offset"),
        line=line,
        timed=timed,
        projected=projected,
    )
