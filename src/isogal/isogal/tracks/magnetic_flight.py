"""Flights with a scalar and a vector magnetometer in text files, and the files of base
stations."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.errors import InputError
from isogal.files import write_atomic
from isogal.magnetics.diurnal import BaseStation
from isogal.magnetics.readings import Readings
from isogal.sensors.magnetometer import MainField, decimal_year, is_absolute
from isogal.tracks.csv_file import CsvTrack
from isogal.tracks.text_rows import (
    DUMMIES,
    MISSING,
    PLACE_NAMES,
    PLACE_RANGES,
    TextRows,
    iso_seconds,
    read_rows,
)

_VECTOR = ("vector_x", "vector_y", "vector_z")
_NAMES = {
    **PLACE_NAMES,
    "height": ("height", "altitude", "alt"),
    "scalar": ("scalar", "total_field", "total"),
    "vector_x": ("vector_x", "flux_x", "bx"),
    "vector_y": ("vector_y", "flux_y", "by"),
    "vector_z": ("vector_z", "flux_z", "bz"),
    "reference": ("reference",),
}
"""Names of columns, in any case."""
_CURRENT = "current_"
_REQUIRED = ("time", "scalar", *_VECTOR)
_WITH_GAPS = ("scalar", *_VECTOR, "reference")
_RANGES = PLACE_RANGES | {"height": (-12e3, 1e5)}


@dataclass(frozen=True, slots=True, eq=False)
class MagneticFlight:
    """N readings of both magnetometers, and where they were taken."""

    readings: Readings
    latitude: Array | None
    """(N,) rad; None = not recorded."""
    longitude: Array | None
    height: Array | None
    """(N,) m above the ellipsoid."""
    reference: Array | None
    """(N,) nT, the true total field there."""

    @property
    def time(self) -> Array:
        """(N,) s, since 1970 UTC or since the start of the recording."""
        return self.readings.time

    @property
    def dated(self) -> bool:
        """Whether the times say the date."""
        return is_absolute(self.time)

    def main_field(self, epoch: float, height: float | None = None) -> Array:
        """Return (N,) the Earth's main field, nT: on the readings' dates where their times say
        them, else in a decimal year.

        Parameters
        ----------
        epoch : float
        height : float, optional
            m above the ellipsoid, where the file has none.

        Raises
        ------
        InputError
            The file has no positions or no heights.
        """
        latitude, longitude = self._places()
        up = self.height if self.height is not None else height
        if up is None:
            raise InputError(f"{self.readings.where}: has no column height, nor is one given")
        field = MainField(latitude, longitude, float(np.median(up)), epoch)
        year = decimal_year(self.time) if self.dated else None
        return field.value(latitude, longitude, up, year)

    def track(self, anomaly: Array) -> CsvTrack:
        """Return the flight as a recorded track with the anomaly (N,) nT as value; raises
        InputError where it has no positions."""
        latitude, longitude = self._places()
        return CsvTrack(
            self.readings.where,
            self.time,
            np.degrees(latitude),
            np.degrees(longitude),
            anomaly,
            None,
            None,
        )

    def _places(self) -> tuple[Array, Array]:
        if self.latitude is None or self.longitude is None:
            raise InputError(f"{self.readings.where}: has no columns latitude and longitude")
        return self.latitude, self.longitude

    @property
    def heading(self) -> Array | None:
        """(N,) rad, of the way over ground; None where no positions are recorded."""
        if self.latitude is None or self.longitude is None:
            return None
        east = np.gradient(np.unwrap(self.longitude)) * np.cos(self.latitude)
        return np.arctan2(east, np.gradient(self.latitude))


def read_magnetic_flight(path: str | Path) -> MagneticFlight:
    """Read a flight: columns ``time`` (s or ISO 8601), ``scalar`` (nT), ``vector_x``,
    ``vector_y``, ``vector_z`` (nT, body axes), and where there are any ``latitude``,
    ``longitude`` (deg), ``height`` (m above the ellipsoid), ``current_NAME`` (A), ``reference``
    (nT). Separators, comments and missing readings are those of
    `isogal.tracks.csv_file.read_csv_tracks`.

    Raises
    ------
    InputError
        The file cannot be read, lacks a column, or a cell is not what it should be; or the
        readings are refused by `Readings`.
    """
    where = str(path)
    rows = read_rows(path, ", ".join(_REQUIRED))
    index = _locate(rows.names, _REQUIRED, where)
    columns = {name: _column(rows, i, name, where) for name, i in index.items()}
    currents = {
        name.removeprefix(_CURRENT): _column(rows, i, name, where)
        for i, name in enumerate(rows.names)
        if name.startswith(_CURRENT)
    }
    vector = np.stack([columns[name] for name in _VECTOR], axis=-1)
    readings = Readings(columns["time"], columns["scalar"], vector, where, currents)
    placed = {
        name: np.radians(columns[name]) if name in columns else None
        for name in ("latitude", "longitude")
    }
    return MagneticFlight(
        readings, **placed, height=columns.get("height"), reference=columns.get("reference")
    )


def read_base_station(path: str | Path) -> BaseStation:
    """Read a base station's file: columns ``time`` (on the flight's clock) and ``scalar`` (nT);
    rows without a reading are left out.

    Raises
    ------
    InputError
        As `read_magnetic_flight`, or the readings are refused by `BaseStation`.
    """
    where = str(path)
    rows = read_rows(path, "time, scalar")
    index = _locate(rows.names, ("time", "scalar"), where)
    time, value = (_column(rows, index[name], name, where) for name in ("time", "scalar"))
    known = np.isfinite(value)
    return BaseStation(time[known], value[known], where)


def without_diurnal(flight: MagneticFlight, station: BaseStation | None) -> MagneticFlight:
    """Return a flight less the daily variation that a base station measured."""
    if station is None:
        return flight
    variation = station.variation(flight.time, flight.readings.where)
    total = flight.readings.total - variation
    return replace(flight, readings=replace(flight.readings, total=total))


def write_compensated(
    path: str | Path, flight: MagneticFlight, total: Array, anomaly: Array
) -> None:
    """Write a track as `isogal match` reads it: the anomaly (N,) nT as ``value``, and the total
    field (N,) nT without the vehicle as ``total``; empty where there is none.

    Raises
    ------
    InputError
        The file cannot be written, or the flight has no positions.
    """
    track = flight.track(anomaly)
    lines = ["time,latitude,longitude,value,total"]
    for row in zip(
        track.time,
        track.latitude,
        track.longitude,
        track.value,
        total,
        strict=True,
    ):
        time, latitude, longitude, *fields = row
        cells = ["" if math.isnan(one) else f"{one:.3f}" for one in fields]
        lines.append(f"{time:.4f},{latitude:.8f},{longitude:.8f},{','.join(cells)}")
    write_atomic(path, "\n".join(lines) + "\n")


def _locate(names: list[str], required: tuple[str, ...], where: str) -> dict[str, int]:
    index = {
        name: names.index(found[0])
        for name, aliases in _NAMES.items()
        if (found := [alias for alias in aliases if alias in names])
    }
    missing = [name for name in required if name not in index]
    if missing:
        allowed = " or ".join(f"'{alias}'" for alias in _NAMES[missing[0]])
        raise InputError(
            f"{where}: has no column {allowed}; it has"
            f" {', '.join(name or '(no name)' for name in names)}"
        )
    return index


def _column(rows: TextRows, index: int, name: str, where: str) -> Array:
    numbered = zip(rows.cells, rows.number, strict=True)
    return np.array([_number(row[index], name, number, where) for row, number in numbered])


def _number(cell: str, name: str, line: int, where: str) -> float:
    text = cell.strip()
    gaps = name in _WITH_GAPS or name.startswith(_CURRENT)
    if gaps and text.casefold() in MISSING:
        return math.nan
    try:
        value = float(text)
    except ValueError:
        if name == "time" and (stamp := iso_seconds(text)) is not None:
            return stamp
        raise InputError(
            f"{where}: {name} in line {line} is {text[:40]!r}, not a number"
        ) from None
    if gaps and value in DUMMIES:
        return math.nan
    low, high = _RANGES.get(name, (-math.inf, math.inf))
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{where}: {name} in line {line} is {text}, which cannot be")
    return value
