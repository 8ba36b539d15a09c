"""Readings along lines, and the maps that they are matched against.

docs/evidence/real-data.md says where the data come from."""

from dataclasses import dataclass
from pathlib import Path

import netCDF4
import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import normal_gravity
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.tracks.track import Track

MGAL = 1e-5
"""m/s²."""
FEWEST = 100
"""Readings of a line over Scotland that is used."""
Shift = tuple[float, float]
"""North and east, m."""


@dataclass(frozen=True)
class Line:
    """Readings along a line, in order, at their surveyed positions."""

    name: str
    latitude: Array
    """(n,) rad."""
    longitude: Array
    """(n,) rad."""
    value: Array
    """(n,) gravity m/s², or magnetic anomaly nT."""
    height: Array | None = None
    """(n,) m, of gravity stations."""
    terrain: Array | None = None
    """(n,) terrain effect of gravity stations, m/s²."""

    def track(self, sensor_sigma: float, shift: Shift = (0.0, 0.0)) -> Track:
        """Return what a navigator records that is off by a shift.

        A gravimeter's reading is compared with normal gravity + map + terrain effect; normal
        gravity is taken at the navigator's latitude."""
        north, east = metres_per_radian(self.latitude)
        latitude, longitude = self.latitude + shift[0] / north, self.longitude + shift[1] / east
        gravity = self.height is not None
        offset = (
            normal_gravity(latitude, self.height) + self.terrain
            if gravity
            else np.zeros(self.value.size)
        )
        return Track(
            time=60.0 * np.arange(self.value.size),
            latitude=latitude,
            longitude=longitude,
            value=self.value,
            sigma=np.full(self.value.size, sensor_sigma),
            offset=offset,
            where=self.name,
            reduction="latitude" if gravity else "none",
        )

    def part(self, rows: slice) -> "Line":
        """Return some of the readings."""
        cut = {
            key: None if value is None else value[rows]
            for key, value in vars(self).items()
            if key != "name"
        }
        return Line(self.name, **cut)


def clear_lake(data: Path) -> tuple[FieldMap, list[Line], Line]:
    """Return the map (with its own 1-sigma), the four lines, and the scattered stations."""
    field_map = load_map(data / "clear_lake_gravity_map.nc", "bouguer_disturbance")
    v = variables_of(data / "clear_lake_gravity_stations.nc")

    def line(rows: Integers, name: str) -> Line:
        place = np.radians(v["lat"][rows]), np.radians(v["lon"][rows])
        return Line(
            name, *place, v["observed_gravity"][rows], v["height"][rows], v["terrain_effect"][rows]
        )

    lines = [
        line(_sorted(v["line"] == number, v["along_track"]), f"line {number}")
        for number in range(4)
    ]
    return field_map, lines, line(np.flatnonzero(v["line"] < 0), "scattered")


def scotland(data: Path) -> tuple[FieldMap, list[Line], list[Line]]:
    """Return the map, its flight lines and its tie lines (of `FEWEST` readings and more), each
    ordered along itself."""
    field_map = load_map(data / "scotland_magnetic_map.nc", "magnetic_anomaly")
    v = variables_of(data / "scotland_magnetic_lines.nc")
    groups: dict[int, list[Line]] = {1: [], 2: []}
    for role, lines in groups.items():
        for number in np.unique(v["line"][v["role"] == role]):
            axis = "lon" if role == 1 else "lat"  # flight lines run east, tie lines north
            rows = _sorted((v["role"] == role) & (v["line"] == number), v[axis])
            if rows.size >= FEWEST:
                place = np.radians(v["lat"][rows]), np.radians(v["lon"][rows])
                lines.append(Line(f"line {number:.0f}", *place, v["magnetic_anomaly"][rows]))
    return field_map, groups[1], groups[2]


def variables_of(path: Path) -> dict[str, Array]:
    """Return all variables of a NetCDF file; NaN = missing."""
    with netCDF4.Dataset(path) as dataset:
        return {
            name: np.ma.filled(variable[:].astype(float), np.nan)
            for name, variable in dataset.variables.items()
        }


def _sorted(chosen: Booleans, by: Array) -> Integers:
    """Return the chosen rows in the order of some numbers."""
    rows = np.flatnonzero(chosen)
    return rows[np.argsort(by[rows], kind="stable")]
