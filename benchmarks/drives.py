"""Drives of a car with a telephone, through Isogal's navigator (docs/evidence/drives.md).

    .venv/bin/python benchmarks/drives.py FOLDER

FOLDER holds drive_NAME.nc and dted0_NAME.nc. Five minutes of satellites, then the gyroscope about
the vertical, the satellites' speed as an odometer, and the barometer's height against the terrain.
"""

import argparse
import math
import sys
from pathlib import Path

import numpy as np

from isogal.earth.frames import horizontal_difference
from isogal.fusion.measurements import (
    HeightReading,
    Measurement,
    SampleNoise,
    VelocityReading,
    satellite_fix,
    satellite_velocity,
)
from isogal.inertial.error_state import Estimate
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.navigator import Navigator
from isogal.scenario import Scenario, changed_scenario, load_scenario
from isogal.sensors.barometer import height_of

EXAMPLE = Path(__file__).parent.parent / "examples" / "phone_drive"
sys.path.insert(0, str(EXAMPLE))

from phone_log import Drive, ground_pressure, position_at, read_drive, velocity_at
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
        found.append(satellite_fix(scenario.gnss, place, True, covariance))
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
        navigator.imu(t, drive.force[k], drive.rate[k])
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


def main() -> None:
    """Print a line for each drive, by dead reckoning and with the map."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="part of the name of a drive")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    arguments = parser.parse_args()
    scenario = changed_scenario(load_scenario(EXAMPLE / "car.yaml"), arguments.set, "--set")
    for path in sorted(arguments.folder.glob("drive_*.nc")):
        name = path.stem.removeprefix("drive_")
        if arguments.only not in name:
            continue
        drive = read_drive(path, KNOWN)
        terrain = with_sigma(load_map(arguments.folder / f"dted0_{name}.nc", "height"))
        for matched, what in ((False, "dead reckoning"), (True, "map")):
            navigator = navigator_of(drive, scenario, terrain)
            rows = navigate(navigator, drive, scenario, matched)
            away, nees = rows[:, 1], rows[:, 2]
            print(
                f"{name} {what:14s} median {np.median(away) / 1e3:5.2f} km,"
                f" 95 % {np.percentile(away, 95) / 1e3:5.2f} km, NEES {nees.mean():5.2f}"
                f" (median {np.median(nees):.2f})",
                flush=True,
            )


if __name__ == "__main__":
    main()
