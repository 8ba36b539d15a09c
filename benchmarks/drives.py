"""Drives of a car with a telephone, through Isogal's navigator (docs/evidence/drives.md).

    .venv/bin/python benchmarks/drives.py FOLDER [--all] [--reference] [--satellites S]
        [--variants NAME ...] [--simulated SEED ...]

FOLDER holds drive_NAME.nc and dted0_NAME.nc. Five minutes of satellites, then the gyroscope about
the vertical, the satellites' speed as an odometer, and the barometer's height against the terrain;
or heights along the drive that are drawn from what the scenario assumes of map and barometer.
"""

import math
import sys
from dataclasses import replace
from pathlib import Path

import closed_loop  # first: it asks NumPy for one thread
import numpy as np

from isogal.earth.frames import horizontal_difference
from isogal.fusion.measurements import (
    HeightReading,
    Measurement,
    SampleNoise,
    VelocityReading,
    position_fix,
    satellite_velocity,
)
from isogal.inertial.error_state import Estimate
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.navigator import Navigator
from isogal.scenario import Scenario, changed_scenario, load_scenario
from isogal.seeds import generator
from isogal.sensors.barometer import height_of, pressure_of

EXAMPLE = Path(__file__).parent.parent / "examples" / "phone_drive"
sys.path.insert(0, str(EXAMPLE))

from drive_particles import particles
from drive_variants import DRIVES, EVENTS
from phone_log import Drive, drive_of, ground_pressure, position_at, read_log, velocity_at
from road_heights import with_sigma

KNOWN = 300.0
"""s with satellites."""


def aids_at(drive: Drive, k: int, scenario: Scenario, known: float) -> list[Measurement]:
    """Return what is measured at a sample, in the order in which the nodes use it."""
    found: list[Measurement] = [SampleNoise(np.array([0.0, 0.0, drive.turn_variance[k]]), 1.0)]
    if np.isfinite(drive.pressure[k]):
        height = float(height_of(drive.pressure[k], scenario.height))
        found.append(HeightReading(height, scenario.height.sigma**2))
    forward = np.array([drive.speed[k], math.nan, math.nan])
    if np.isfinite(forward[0]):
        found.append(VelocityReading.of(scenario.velocity, forward, None, drive.rate[k]))
    if drive.time[k] < known and np.isfinite(drive.latitude[k]):
        place, covariance = position_at(drive, k)
        found.append(position_fix(scenario.gnss.positions, place, True, covariance))
        if np.isfinite(drive.course[k] + drive.speed[k]):
            velocity, spread = velocity_at(drive, k)
            found.append(satellite_velocity(scenario.gnss, velocity, drive.rate[k], spread))
    return found


def navigator_of(drive: Drive, scenario: Scenario, terrain: FieldMap) -> Navigator:
    """Return a navigator that knows nothing of the start."""
    nowhere = Estimate(np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    return Navigator(scenario, [terrain], nowhere, drive.time[0])


def navigate(
    navigator: Navigator, drive: Drive, scenario: Scenario, matched: bool, known: float = KNOWN
) -> np.ndarray:
    """Return (K, 4) of each second after the satellites that has a position: time (s), error (m),
    NEES per axis, 1-sigma of the position (m)."""
    rows, scans = [], ground_pressure(drive) if matched else {}
    for k in range(1, len(drive.time)):
        t = drive.time[k]
        missing = max(0.0, t - drive.time[k - 1] - 1.0 / scenario.imu.rate)
        navigator.imu(t, drive.force[k], drive.rate[k], missing=missing)
        for one in aids_at(drive, k, scenario, known):
            navigator.measure(t, one)
        if k in scans:
            height = float(height_of(scans[k], scenario.height))
            navigator.read(0, np.array([t]), np.array([height]))
            navigator.fix()
        if t >= known and np.isfinite(drive.latitude[k]):
            state = navigator.state
            error = np.array(
                horizontal_difference(*state.position[:2], drive.latitude[k], drive.longitude[k])
            )
            P = state.covariance[:2, :2]
            nees = error @ np.linalg.solve(P, error) / 2.0
            rows.append((t, math.hypot(*error), nees, math.sqrt(np.trace(P))))
    return np.array(rows)


def simulated(drive: Drive, scenario: Scenario, terrain: FieldMap, seed: int) -> Drive:
    """Return a drive whose pressure is that of the terrain, of an error of the map, of a slow one
    of the barometer and of white noise, as they are assumed."""
    random, count = generator(seed, 0, "heights along a drive"), len(drive.time)
    there, every = np.isfinite(drive.latitude), np.arange(count)
    place = [
        np.interp(every, every[there], degrees[there])
        for degrees in (drive.latitude, drive.longitude)
    ]
    instrument, length = scenario.gravimeter, scenario.matcher.map_correlation_length
    elapsed = np.diff(drive.time, prepend=drive.time[0])
    errors = np.column_stack(
        [
            gauss_markov(random, np.exp(-np.nan_to_num(drive.speed) * elapsed / length)),
            gauss_markov(random, np.exp(-elapsed / instrument.correlation_time)),
            random.standard_normal(count),
        ]
    )
    sizes = terrain.sigma_at(*place), instrument.correlated_sigma, instrument.sigma
    height = terrain.value(*place) + sum(one * e for one, e in zip(sizes, errors.T, strict=True))
    pressure = pressure_of(height, scenario.height)
    return replace(drive, pressure=np.where(np.isfinite(drive.pressure), pressure, np.nan))


def gauss_markov(random: np.random.Generator, keep: np.ndarray) -> np.ndarray:
    """Return (N,) a process of 1-sigma 1 of which `keep` (N,) is left from sample to sample."""
    noise = random.standard_normal(len(keep))
    for k in range(1, len(keep)):
        noise[k] = keep[k] * noise[k - 1] + math.sqrt(1.0 - keep[k] ** 2) * noise[k]
    return noise


def figures(rows: np.ndarray) -> str:
    """Return what a table has of a drive: median and 95 % of the error, km, and mean NEES."""
    away = rows[:, 1] / 1e3
    return f"{np.median(away):.2f}, {np.percentile(away, 95):.2f}, {rows[:, 2].mean():.2g}"


def main() -> None:
    """Print a row of a table for each drive: by dead reckoning, with the map, and by particles."""
    parser = closed_loop.parser(__doc__)
    parser.add_argument("folder", type=closed_loop.folder)
    parser.add_argument("--only", default="", help="part of the name of a drive")
    parser.add_argument(
        "--variants", nargs="+", default=["as logged"], choices=[*DRIVES, *EVENTS], metavar="NAME"
    )
    parser.add_argument("--all", action="store_true", help="all variants")
    parser.add_argument("--reference", action="store_true", help="a particle filter besides")
    parser.add_argument("--satellites", type=float, default=KNOWN, help="s that there are any")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--simulated", type=int, nargs="+", default=[], metavar="SEED")
    arguments = parser.parse_args()
    scenario = changed_scenario(load_scenario(EXAMPLE / "car.yaml"), arguments.set, "--set")
    known = arguments.satellites
    drives = sorted(arguments.folder.glob("drive_*.nc"))
    if not drives:
        parser.error(f"{arguments.folder}: holds no drive_NAME.nc")
    for path in drives:
        name = path.stem.removeprefix("drive_")
        if arguments.only not in name:
            continue
        log = read_log(path)
        terrain = with_sigma(load_map(arguments.folder / f"dted0_{name}.nc", "height"))
        for variant in DRIVES | EVENTS if arguments.all else arguments.variants:
            drive = drive_of((DRIVES | EVENTS)[variant](log), known)
            found = []
            if not arguments.simulated:
                found = [(drive, False), (drive, True)]
            found += [
                (simulated(drive, scenario, terrain, seed), True) for seed in arguments.simulated
            ]
            cells = []
            for one, matched in found:
                navigator = navigator_of(one, scenario, terrain)
                cells.append(figures(navigate(navigator, one, scenario, matched, known)))
            if arguments.reference:
                cells.append(figures(particles(drive, scenario, terrain, known)))
            print(f"| {name[:10]} | {variant} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
