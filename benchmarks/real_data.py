"""Matching measurements that nobody simulated: gravity stations at Clear Lake, aeromagnetic lines
over Scotland.

    python benchmarks/real_data.py [DATA] [--out DIR] [--figures DIR] [--json]

DATA (default ../shared/data) holds the two maps and the measurements that were kept out of them;
docs/real-data.md says what they are and what comes out. Nothing is tuned on what it is reported
on: correlation length and sensor noise for a line at Clear Lake come from the other lines, those
for the tie lines of Scotland from its flight lines."""

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import json
import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import netCDF4
import numpy as np
from numpy.typing import NDArray

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.evaluation.consistency import nees_per_axis
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.matching.pmht.noise_model import residual_covariance
from isogal.scenario import Matcher
from isogal.tracks.map_error import MapError, fit_map_error
from isogal.tracks.matching import Match, Uncertainty, match_track
from isogal.tracks.track import Track, fit_to_map

AWAY = 3000.0
"""m, how far off the navigator is, and the 1-sigma per axis that it claims."""
WHOLE = 1000
"""Batch length that takes a line at once."""
GROWTH = (10, 15, 20, 30, 45, 60, 90, 120)
"""Readings after which a line's fix is looked at."""
MGAL = 1e-5
UNLEARNT = (4000.0, 0.5 * MGAL)
"""Correlation length (m) and sensor noise of somebody who has learnt nothing here: the default of
`isogal match`, and 0.5 mGal."""


@dataclass(frozen=True)
class Line:
    """Measurements along a line, in order, where they were taken."""

    name: str
    latitude: Array
    """rad."""
    longitude: Array
    value: Array
    """Gravity m/s², or anomaly nT."""
    height: Array | None = None
    """m, of gravity stations."""
    terrain: Array | None = None
    """Their terrain effect, m/s²."""

    def track(self, sensor_sigma: float, shift: tuple[float, float] = (0.0, 0.0)) -> Track:
        """Return what a navigator that is off by a shift (north, east m) records.

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

    def part(self, count: int) -> "Line":
        """Return the first readings."""
        cut = {
            key: None if value is None else value[:count]
            for key, value in vars(self).items()
            if key != "name"
        }
        return Line(self.name, **cut)


def clear_lake(data: Path) -> tuple[FieldMap, list[Line], Line]:
    """Return the map (with its own 1-sigma), the four lines, and the scattered stations."""
    field_map = load_map(data / "clear_lake_gravity_map.nc", "bouguer_disturbance")
    with netCDF4.Dataset(data / "clear_lake_gravity_stations.nc") as dataset:
        v = {
            name: np.ma.filled(variable[:].astype(float), np.nan)
            for name, variable in dataset.variables.items()
        }

    def line(rows: Any, name: str) -> Line:
        place = np.radians(v["lat"][rows]), np.radians(v["lon"][rows])
        return Line(
            name, *place, v["observed_gravity"][rows], v["height"][rows], v["terrain_effect"][rows]
        )

    lines = []
    for number in range(4):
        rows = np.flatnonzero(v["line"] == number)
        lines.append(
            line(rows[np.argsort(v["along_track"][rows], kind="stable")], f"line {number}")
        )
    return field_map, lines, line(np.flatnonzero(v["line"] < 0), "scattered")


def scotland(data: Path) -> tuple[FieldMap, list[Line], list[Line]]:
    """Return the map, its flight lines and its tie lines (of 100 readings and more), each ordered
    along itself."""
    field_map = load_map(data / "scotland_magnetic_map.nc", "magnetic_anomaly")
    with netCDF4.Dataset(data / "scotland_magnetic_lines.nc") as dataset:
        v = {
            name: np.ma.filled(variable[:].astype(float), np.nan)
            for name, variable in dataset.variables.items()
        }
    groups: dict[int, list[Line]] = {1: [], 2: []}
    for role, found in groups.items():
        for number in np.unique(v["line"][v["role"] == role]):
            rows = np.flatnonzero((v["role"] == role) & (v["line"] == number))
            if rows.size >= 100:
                axis = "lon" if role == 1 else "lat"  # flight lines run east, tie lines north
                rows = rows[np.argsort(v[axis][rows], kind="stable")]
                place = np.radians(v["lat"][rows]), np.radians(v["lon"][rows])
                found.append(Line(f"line {number:.0f}", *place, v["magnetic_anomaly"][rows]))
    return field_map, groups[1], groups[2]


def residuals(line: Line, field_map: FieldMap) -> tuple[Array, NDArray[np.bool_]]:
    """Return readings less map at the true positions, and where the map has a value and an
    error."""
    track = line.track(1.0)
    value = track.value - track.offset - field_map.value(line.latitude, line.longitude)
    return value, np.isfinite(value) & np.isfinite(
        field_map.sigma_at(line.latitude, line.longitude)
    )


def nis(
    line: Line, field_map: FieldMap, length: float, sensor_sigma: float
) -> tuple[float, float]:
    """Return the normalised innovation squared per reading, r' R⁻¹ r / n, and that of the line's
    mean residual alone.

    The second is one number with mean 1, too: it shows what a model says about errors that many
    readings share."""
    value, keep = residuals(line, field_map)
    latitude, longitude, value = line.latitude[keep], line.longitude[keep], value[keep]
    white = np.full(value.size, sensor_sigma**2)
    covariance = residual_covariance(
        latitude, longitude, white, field_map.sigma_at(latitude, longitude), length, 0.0
    )
    mean = value.mean() ** 2 / (covariance.sum() / value.size**2)
    return float(value @ np.linalg.solve(covariance, value)) / value.size, float(mean)


def bearings(count: int) -> list[tuple[float, float]]:
    """Return shifts of AWAY in evenly spread directions (north, east m)."""
    angles = 2.0 * np.pi * np.arange(count) / count
    return [(AWAY * math.cos(a), AWAY * math.sin(a)) for a in angles]


def match_line(
    line: Line,
    field_map: FieldMap,
    length: float,
    sensor_sigma: float,
    shift: tuple[float, float],
    **keys: Any,
) -> list[Match]:
    """Match a line that the navigator sees AWAY from where it is."""
    how = {"chained": keys.pop("chained", False), "checked": keys.pop("checked", True)}
    settings = Matcher(**{"batch_length": WHOLE, "map_correlation_length": length} | keys)
    track, _ = fit_to_map(line.track(sensor_sigma, shift), field_map)
    return match_track(track, field_map, settings, Uncertainty(position=AWAY), **how)


def row_of(line: Line, match: Match, aided: bool = False) -> dict[str, Any]:
    """Return error, 1-sigma axes and NEES of a match; `aided` = of the track after it, with the
    prior and all earlier fixes."""
    last = match.rows.stop - 1
    place = match.position if aided else (match.fix.latitude, match.fix.longitude)
    covariance = match.covariance[:2, :2] if aided else match.fix.covariance
    if not (match.fix.published or aided):
        return {"line": line.name, "reason": match.fix.reason}
    error = horizontal_difference(*place, line.latitude[last], line.longitude[last])
    axes = np.sqrt(np.linalg.eigvalsh(covariance))
    return {
        "line": line.name,
        "error_m": float(np.hypot(*error)),
        "sigma_long_m": float(axes[1]),
        "sigma_short_m": float(axes[0]),
        "nees_per_axis": float(nees_per_axis(error, covariance)),
        "in_sigma": float(np.hypot(*error) / math.sqrt(axes @ axes)),
    }


def summary_of(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return figures of many matches."""
    fixes = [row for row in rows if "error_m" in row]
    result: dict[str, Any] = {"fixes": len(fixes), "batches": len(rows)}
    if fixes:
        errors = np.array([row["error_m"] for row in fixes])
        result |= {
            "error_median_m": float(np.median(errors)),
            "error_90_m": float(np.percentile(errors, 90.0)),
            "error_largest_m": float(errors.max()),
            "sigma_long_median_m": float(np.median([row["sigma_long_m"] for row in fixes])),
            "nees_per_axis": float(np.mean([row["nees_per_axis"] for row in fixes])),
            "nees_per_axis_median": float(np.median([row["nees_per_axis"] for row in fixes])),
        }
    return result


def rigid_search(
    line: Line, field_map: FieldMap, shift: tuple[float, float], reach: float = 6000.0
) -> float:
    """Return the error (m) of the place with the least squares of the residuals about their mean,
    within a reach of the navigator."""
    track = line.track(1.0, shift)
    level = track.value - track.offset
    slope = track.jacobian(field_map.quantity)[:, 0]
    north, east = metres_per_radian(track.latitude)
    side = np.arange(-reach, reach + 1.0, 100.0)
    best, found = np.inf, np.zeros(2)
    for move in side:
        latitude = track.latitude - move / north
        value = field_map.value(latitude, track.longitude - side[:, None] / east) + slope * move
        known = np.isfinite(value)
        misfit = level - value
        enough = known.mean(axis=1) > 0.8
        if not enough.any():
            continue
        spread = np.full(side.size, np.inf)
        spread[enough] = np.nanvar(misfit[enough], axis=1)
        k = int(np.argmin(spread))
        if spread[k] < best:
            best, found = float(spread[k]), np.array([move, side[k]])
    return float(np.hypot(*(found - shift)))


def study_clear_lake(
    data: Path, directions: int = 4, growth: Sequence[int] = GROWTH
) -> dict[str, Any]:
    """Return everything about Clear Lake."""
    field_map, lines, scattered = clear_lake(data)
    result: dict[str, Any] = {
        "stations": {line.name: int(line.value.size) for line in lines},
        "settings": {},
        "nis": {},
        "whole": {},
        "white": {},
        "unlearnt": {},
        "bare": {},
        "rigid_m": {},
        "growth": {},
        "batches": {},
    }
    everything = fit_map_error([line.track(1.0) for line in lines], field_map)
    result["settings"]["all lines"] = vars_of(everything)
    length, sensor = everything.correlation_length, everything.sensor_sigma
    result["nis"]["scattered"] = [
        *nis(scattered, field_map, 1.0, sensor),
        *nis(scattered, field_map, length, sensor),
    ]
    batches: dict[str, list[dict[str, Any]]] = {
        "independent": [],
        "bare": [],
        "chained": [],
        "white": [],
    }
    for line in lines:
        others = [other.track(1.0) for other in lines if other is not line]
        fit = fit_map_error(others, field_map)
        length, sensor = fit.correlation_length, fit.sensor_sigma
        result["settings"][line.name] = vars_of(fit)
        result["nis"][line.name] = [
            *nis(line, field_map, 1.0, sensor),
            *nis(line, field_map, length, sensor),
        ]
        for kind, own, noise, checked in (
            ("whole", length, sensor, True),
            ("bare", length, sensor, False),
            ("white", 1.0, sensor, False),
            ("unlearnt", *UNLEARNT, True),
        ):
            rows = [
                row_of(line, match_line(line, field_map, own, noise, shift, checked=checked)[0])
                for shift in bearings(directions)
            ]
            result[kind][line.name] = {"rows": rows, **summary_of(rows)}
        result["rigid_m"][line.name] = [
            rigid_search(line, field_map, shift) for shift in bearings(directions)
        ]
        result["growth"][line.name] = [
            {"readings": n} | growth_at(line.part(n), field_map, length, sensor, 2)
            for n in [*(n for n in growth if n < line.value.size), line.value.size]
        ]
        for shift in bearings(directions)[:2]:
            for kind, own, chained, checked in (
                ("independent", length, False, True),
                ("bare", length, False, False),
                ("chained", length, True, True),
                ("white", 1.0, False, False),
            ):
                matches = match_line(
                    line,
                    field_map,
                    own,
                    sensor,
                    shift,
                    batch_length=30,
                    chained=chained,
                    checked=checked,
                )
                batches[kind] += [row_of(line, match, aided=chained) for match in matches]
    result["batches"] = {kind: summary_of(rows) | {"rows": rows} for kind, rows in batches.items()}
    return result


def growth_at(
    line: Line, field_map: FieldMap, length: float, sensor: float, directions: int
) -> dict[str, Any]:
    """Return medians over directions of error and 1-sigma after some readings, prior and fix
    together; white: the likelihood alone."""
    result = {}
    on_map = [shift for shift in bearings(directions) if _starts_on_map(line, field_map, shift)]
    for kind, own in (("correlated", length), ("white", 1.0)):
        checked = kind == "correlated"
        rows = [
            row_of(
                line,
                match_line(line, field_map, own, sensor, shift, checked=checked)[0],
                aided=True,
            )
            for shift in on_map
        ]
        result[kind] = {
            key: float(np.median([row[key] for row in rows])) if rows else math.nan
            for key in ("error_m", "sigma_long_m", "nees_per_axis")
        }
    return result


def _starts_on_map(line: Line, field_map: FieldMap, shift: tuple[float, float]) -> bool:
    track = line.track(1.0, shift)
    return int(np.isfinite(field_map.value(track.latitude, track.longitude)).sum()) >= 4


def study_scotland(
    data: Path, directions: int = 2, thin: int = 3, swap: bool = True
) -> dict[str, Any]:
    """Return everything about Scotland: settings from the flight lines, applied to the tie lines,
    and the other way round."""
    field_map, flights, ties = scotland(data)
    result: dict[str, Any] = {}
    for name, references, lines in (("tie lines", flights, ties), ("flight lines", ties, flights)):
        fit = fit_map_error([thinned(line, thin).track(1.0) for line in references], field_map)
        own = fit.apply(field_map)
        sensor = max(fit.sensor_sigma, 1.0)  # no aeromagnetic reading of the time was better
        spread = np.concatenate([residuals(line, field_map)[0] for line in references])
        even = replace(
            field_map, sigma=np.full(field_map.values.shape, float(np.sqrt(np.nanmean(spread**2))))
        )
        runs = {
            "own": (own, fit.correlation_length, True),
            "bare": (own, fit.correlation_length, False),
            "even": (even, fit.correlation_length, True),
            "white": (own, 1.0, False),
        }
        part: dict[str, Any] = {
            "settings": vars_of(fit) | {"even_sigma": float(even.sigma.flat[0])}
        }  # type: ignore[union-attr]
        part["nis"] = {
            kind: np.mean([nis(line, used, length, sensor) for line in lines], axis=0).tolist()
            for kind, (used, length, _) in runs.items()
        }
        for kind, (used, length, checked) in runs.items():
            rows = [
                row_of(line, match_line(line, used, length, sensor, shift, checked=checked)[0])
                for line in lines
                for shift in bearings(directions)
            ]
            part[kind] = summary_of(rows) | {"rows": rows}
        errors = [
            rigid_search(line, field_map, shift)
            for line in lines
            for shift in bearings(directions)[:1]
        ]
        part["rigid"] = {
            "error_median_m": float(np.median(errors)),
            "error_90_m": float(np.percentile(errors, 90.0)),
        }
        result[name] = part
        if not swap:
            break
    return result


def thinned(line: Line, step: int) -> Line:
    """Return every `step`-th reading."""
    return Line(line.name, line.latitude[::step], line.longitude[::step], line.value[::step])


def vars_of(fit: MapError) -> dict[str, float]:
    return {name: float(getattr(fit, name)) for name in fit.__slots__}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "data", nargs="?", type=Path, default=Path("../shared/data"), help="folder of the data"
    )
    parser.add_argument("--out", type=Path, help="write the results there as real_data.json")
    parser.add_argument("--figures", type=Path, help="write the figures there")
    parser.add_argument("--json", action="store_true", help="print the results as JSON")
    options = parser.parse_args()
    if not options.data.is_dir():
        raise InputError(f"{options.data}: no such folder; name the folder of the data")
    results = {
        "clear_lake": study_clear_lake(options.data),
        "scotland": study_scotland(options.data),
    }
    if options.out:
        options.out.mkdir(parents=True, exist_ok=True)
        (options.out / "real_data.json").write_text(json.dumps(results, indent=1))
    sys.path.insert(0, str(Path(__file__).parent))
    if options.figures:
        from real_data_figures import write_figures

        write_figures(options.data, results, options.figures)
    if options.json:
        print(json.dumps(results))
    else:
        from real_data_tables import tables

        print(tables(results))


if __name__ == "__main__":
    main()
