"""Recorded tracks in text files with the columns latitude, longitude (or x and y) and value, and
optionally time, sigma, offset and line."""

import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from isogal.arrays import Array, Integers
from isogal.errors import InputError
from isogal.magnetics.diurnal import BaseStation
from isogal.maps.corridor import Corridor, corridor_of
from isogal.tracks.text_rows import (
    DUMMIES,
    MISSING,
    PLACE_NAMES,
    PLACE_RANGES,
    TextRows,
    iso_seconds,
    read_rows,
)
from isogal.tracks.track import Track

REQUIRED = ("latitude", "longitude", "value")
_NAMES = {
    **PLACE_NAMES,
    "x": ("x", "easting", "east"),
    "y": ("y", "northing", "north"),
    "value": ("value",),
    "sigma": ("sigma",),
    "offset": ("offset",),
    "line": ("line",),
}
"""Names of columns, in any case."""
_MAY_BE_MISSING = ("value", "sigma", "offset")


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
    aliases = [one.strip().casefold() for one in ([column] if isinstance(column, str) else column)]
    index = _locate(rows.names, where, aliases)
    if not rows.cells:
        raise InputError(f"{where}: has no readings")
    columns = {
        name: np.array(
            [
                _number(row[i], name, n, where)
                for row, n in zip(rows.cells, rows.number, strict=True)
            ]
        )
        for name, i in index.items()
        if name != "line"
    }
    if "latitude" not in columns:
        columns |= _geographic(columns.pop("x"), columns.pop("y"), crs, where)
        columns["projected"] = columns["value"]
    for name in set(columns) - {*REQUIRED, "time", "sigma", "offset", "projected"}:
        del columns[name]
    names = rows.line
    if "line" in index:
        names = [row[index["line"]].strip() for row in rows.cells]
    if names is None:
        return [_track(columns, rows, np.arange(len(rows.cells)), None, where)]
    return [
        _track(columns, rows, np.flatnonzero(np.array(names) == one), one, where)
        for one in dict.fromkeys(names)
    ]


def _track(
    columns: dict[str, Array], rows: TextRows, which: Integers, line: str | None, where: str
) -> CsvTrack:
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
        projected="projected" in own,
    )


def _locate(header: list[str], where: str, readings: list[str]) -> dict[str, int]:
    index: dict[str, int] = {}
    names = dict(_NAMES)
    if readings != ["value"]:
        names["value"] = tuple(readings)
        for beside in ("sigma", "offset"):
            names[beside] = tuple(f"{one}_{beside}" for one in readings)
    for name, aliases in names.items():
        found = [alias for alias in aliases if alias in header]
        if found and header.count(found[0]) > 1:
            raise InputError(f"{where}: has {header.count(found[0])} columns '{found[0]}'")
        if found:
            index[name] = header.index(found[0])
    if "latitude" not in index and "x" in index and "y" in index:
        required: tuple[str, ...] = ("value",)
    else:
        required = REQUIRED
    for name in required:
        if name not in index:
            wanted = readings[0] if name == "value" else name
            others = [h for h in header if h and h not in REQUIRED]
            close = [h for h in others if wanted.startswith(h)] + difflib.get_close_matches(
                wanted, others, n=1, cutoff=0.6
            )
            hint = f" (is it '{close[0]}'?)" if close else ""
            raise InputError(
                f"{where}: has no column '{wanted}'{hint}; it has"
                f" {', '.join(h or '(no name)' for h in header)}"
            )
    return index


def _geographic(x: Array, y: Array, crs: str | None, where: str) -> dict[str, Array]:
    """Return latitude and longitude (deg) of columns x and y."""
    import pyproj

    if crs is None:
        raise InputError(f"{where}: has columns x and y; say their system (--crs EPSG:N)")
    try:
        turn = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True)
    except pyproj.exceptions.CRSError:
        raise InputError(f"--crs {crs}: is no coordinate system that is known") from None
    longitude, latitude = (np.asarray(one) for one in turn.transform(x, y))
    if not (np.isfinite(longitude) & np.isfinite(latitude)).all():
        raise InputError(f"{where}: x and y are not places in {crs}")
    return {"latitude": latitude, "longitude": longitude}


def _number(cell: str, name: str, line: int, where: str) -> float:
    text = cell.strip()
    missing = text.casefold() in MISSING
    if missing and name in _MAY_BE_MISSING:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        if name == "time" and (stamp := iso_seconds(text)) is not None:
            return stamp
        shown = f"'{text[:40]}'" if text else "empty"
        raise InputError(f"{where}: {name} in line {line} is {shown}, not a number") from None
    if name in _MAY_BE_MISSING and value in DUMMIES:
        return math.nan
    if not np.isfinite(value):
        raise InputError(
            f"{where}: {name} in line {line} is {text}, not a finite number (leave the line out)"
        )
    low, high = PLACE_RANGES.get(name, (-np.inf, np.inf))
    if not low <= value <= high:
        raise InputError(
            f"{where}: {name} in line {line} is {text} deg, must be {low:g} to {high:g}"
        )
    if name == "sigma" and value <= 0.0:
        raise InputError(f"{where}: sigma in line {line} is {text}, must be > 0")
    return value
