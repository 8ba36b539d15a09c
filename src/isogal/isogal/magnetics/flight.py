"""Flights with a scalar and a vector magnetometer in text files, and the files of base
stations."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.files import write_atomic
from isogal.magnetics.readings import BaseStation, Readings
from isogal.maps.gridding.rows import HEIGHT, LATITUDE, LONGITUDE, TIME, Column, read_rows
from isogal.sensors.magnetometer import MainField, decimal_year, is_absolute

_VECTOR = ("vector_x", "vector_y", "vector_z")
_REQUIRED = ("time", "scalar", *_VECTOR)
_COLUMNS = {
    "time": TIME,
    "latitude": LATITUDE,
    "longitude": LONGITUDE,
    "height": HEIGHT,
    "scalar": Column(("scalar", "total_field", "total"), unit=" nT", gaps=True),
    **{
        f"vector_{a}": Column((f"vector_{a}", f"flux_{a}", f"b{a}"), unit=" nT", gaps=True)
        for a in "xyz"
    },
    "reference": Column(("reference",), unit=" nT", gaps=True),
}
_PLACES = ("latitude", "longitude")
_CURRENT = "current_"


@dataclass(frozen=True, slots=True, eq=False)
class MagneticFlight:
    """N readings of both magnetometers, and where they were taken."""

    readings: Readings
    places: tuple[Array, Array] | None
    """(N,) latitude and longitude, rad; None = no places are recorded."""
    height: Array | None
    """(N,) m above the ellipsoid."""
    reference: Array | None
    """(N,) nT, the true total field there."""

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
        (latitude, longitude), up = self.placed, self.height if self.height is not None else height
        if up is None:
            raise InputError(f"{self.readings.where}: has no column height, nor is one given")
        field = MainField(latitude, longitude, float(np.median(up)), epoch)
        time = self.readings.time
        year = decimal_year(time) if is_absolute(time) else None
        return field.value(latitude, longitude, up, year)

    @property
    def placed(self) -> tuple[Array, Array]:
        """The places; raises InputError where none are recorded."""
        if self.places is None:
            raise InputError(f"{self.readings.where}: has no columns latitude and longitude")
        return self.places

    @property
    def course(self) -> Array:
        """(N,) rad, from differences of the places; raises InputError where none are recorded."""
        latitude, longitude = self.placed
        north, east = metres_per_radian(latitude)
        north, east = np.gradient(latitude) * north, np.gradient(np.unwrap(longitude)) * east
        return np.arctan2(east, north)


def read_magnetic_flight(path: str | Path, base: Path | None = None) -> MagneticFlight:
    """Read a flight, less the daily variation by the file of a base station.

    Its columns are ``time`` (s or ISO 8601), ``scalar`` (nT), ``vector_x``, ``vector_y``,
    ``vector_z`` (nT, body axes), and where there are any ``latitude``, ``longitude`` (deg),
    ``height`` (m above the ellipsoid), ``current_NAME`` (A), ``reference`` (nT). Separators,
    comments and missing readings are those of `isogal.tracks.csv_file.read_csv_tracks`.

    Raises
    ------
    InputError
        A file cannot be read, lacks a column, or a cell is not what it should be; or the readings
        are refused by `Readings` or `BaseStation`.
    """
    rows = read_rows(path, ", ".join(_REQUIRED))
    placed = any(rows.index(_COLUMNS[name]) is not None for name in _PLACES)
    columns = rows.read(_COLUMNS, (*_REQUIRED, *(_PLACES if placed else ())))
    currents = {
        name.removeprefix(_CURRENT): Column((name,), unit=" A", gaps=True)
        for name in rows.names
        if name.startswith(_CURRENT)
    }
    vector = np.stack([columns[name] for name in _VECTOR], axis=-1)
    time, total = columns["time"], columns["scalar"]
    readings = Readings(time, total, vector, str(path), rows.read(currents, ()))
    if base is not None:
        variation = read_base_station(base).variation(time, readings.where)
        readings = replace(readings, total=total - variation)
    places = None
    if placed:
        places = np.radians(columns[_PLACES[0]]), np.radians(columns[_PLACES[1]])
    return MagneticFlight(readings, places, columns.get("height"), columns.get("reference"))


def read_base_station(path: str | Path) -> BaseStation:
    """Read a base station's file: columns ``time`` (on the flight's clock) and ``scalar`` (nT);
    rows without a reading are left out.

    Raises
    ------
    InputError
        As `read_magnetic_flight`, or the readings are refused by `BaseStation`.
    """
    known = {name: _COLUMNS[name] for name in ("time", "scalar")}
    time, value = read_rows(path, "time, scalar").read(known, tuple(known)).values()
    there = np.isfinite(value)
    return BaseStation(time[there], value[there], str(path))


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
    columns = flight.readings.time, *np.degrees(flight.placed), anomaly, total
    form = "{:.4f},{:.8f},{:.8f},{:.3f},{:.3f}"
    rows = (form.format(*row).replace("nan", "") for row in zip(*columns, strict=True))
    write_atomic(path, "\n".join(["time,latitude,longitude,value,total", *rows, ""]))
