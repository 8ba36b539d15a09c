"""Drives of a car with a telephone, through Isogal's navigator (docs/evidence/drives.md).

    .venv/bin/python benchmarks/drives.py FOLDER

FOLDER holds drive_NAME.nc and dted0_NAME.nc. Five minutes of satellites, then the gyroscope about
the vertical, the satellites' speed as an odometer, and the barometer's height against the terrain.
"""

import argparse
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import uniform_filter

from isogal.earth.frames import horizontal_difference
from isogal.fusion.measurements import (
    Measurement,
    PositionFix,
    SampleNoise,
    VelocityReading,
    ZeroRotation,
)
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_angles
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.navigator import Navigator
from isogal.scenario import Scenario, changed_scenario, load_scenario
from isogal.sensors.barometer import height_of

EXAMPLE = Path(__file__).parent.parent / "examples" / "phone_drive"
sys.path.insert(0, str(EXAMPLE))

from phone_log import STANDS, Drive, read_drive

KNOWN = 300.0
"""s with satellites."""
LEAST_FIX = 3.0
"""m, 1-sigma of a position by satellites at least: its error changes slowly."""
REST_SPEED, REST_NOISE = 0.1, 1e-3
"""m/s below which a car stands still, and rad/s, 1-sigma of a sample of its gyroscope then."""
LEAST, SHARE, MOST = 9.0, 0.6, 20.0
"""m, share of the relief, m: what a road is off a map of 30 arcsec by where it is flat, where it
is not, and at most."""


def with_sigma(terrain: FieldMap) -> FieldMap:
    """Return a terrain map that says what a road may be off it by: a share of the relief between
    a node and its neighbours, and what is left where there is none."""
    heights = np.asarray(terrain.values, dtype=float)
    mean, square = uniform_filter(heights, 3), uniform_filter(heights**2, 3)
    relief = np.sqrt(np.maximum(square - mean**2, 0.0))
    sigma = np.hypot(LEAST, np.minimum(SHARE * relief, MOST))
    return replace(terrain, sigma=sigma, error_stated=True)


def start_of(drive: Drive) -> tuple[int, Estimate]:
    """Return the first sample with a position and a course at a speed, and the estimate there."""
    moving = (drive.speed > 4.0) & np.isfinite(drive.course) & np.isfinite(drive.latitude)
    first = int(np.argmax(moving & (drive.speed_sigma < 2.0)))
    heading = drive.course[first]
    return first, Estimate(
        np.array([drive.latitude[first], drive.longitude[first], drive.altitude[first]]),
        drive.speed[first] * np.array([math.cos(heading), math.sin(heading), 0.0]),
        np.asarray(from_angles(0.0, 0.0, heading)),
    )


def aids_at(drive: Drive, speed: np.ndarray, k: int, scenario: Scenario) -> list[Measurement]:
    """Return what is measured at a sample beside inertial data and height."""
    found: list[Measurement] = [SampleNoise(np.array([0.0, 0.0, drive.turn_variance[k]]), 1.0)]
    if max(speed[k - 1], speed[k]) < REST_SPEED:
        found.append(ZeroRotation(drive.rate[k], REST_NOISE))
    odometer = VelocityReading.of(scenario.velocity, np.array([speed[k], 0.0, math.nan]))
    if odometer is not None:
        found.append(odometer)
    if drive.time[k] < KNOWN and np.isfinite(drive.latitude[k]):
        sigma = max(drive.horizontal_sigma[k], LEAST_FIX)
        covariance = sigma**2 * np.eye(2)
        found.append(PositionFix(drive.latitude[k], drive.longitude[k], covariance))
    return found


def navigate(
    drive: Drive, scenario: Scenario, terrain: FieldMap, matched: bool
) -> tuple[np.ndarray, int]:
    """Return (K, 2) of each second after the satellites: error (m), NEES per axis; and how many
    measurements were beyond the gate."""
    first, start = start_of(drive)
    navigator = Navigator(scenario, [terrain], start, drive.time[first], horizon=60.0)
    height, speed = height_of(drive.pressure, scenario.height), held(drive.speed)
    rows, refused = [], 0
    for k in range(first + 1, len(drive.time)):
        t = drive.time[k]
        navigator.imu(t, drive.force[k], drive.rate[k], height[k])
        for one in aids_at(drive, speed, k, scenario):
            refused += not navigator.measure(t, one).used
        if matched and t % scenario.gravimeter.interval == 0:
            moving = speed[k] > STANDS  # one that stands still reads the same once more
            navigator.read(0, np.array([t]), np.array([height[k] if moving else math.nan]))
            navigator.fix()
        if t >= KNOWN and np.isfinite(drive.latitude[k]):
            state = navigator.state
            error = np.array(
                horizontal_difference(*state.position[:2], drive.latitude[k], drive.longitude[k])
            )
            nees = error @ np.linalg.solve(state.covariance[:2, :2], error) / 2.0
            rows.append((math.hypot(*error), nees))
    return np.array(rows), refused


def held(values: np.ndarray) -> np.ndarray:
    """Return values in which a missing one is between those beside it."""
    index, known = np.arange(len(values)), np.isfinite(values)
    return np.interp(index, index[known], values[known])


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
            rows, refused = navigate(drive, scenario, terrain, matched)
            away, nees = rows.T
            print(
                f"{name} {what:14s} median {np.median(away) / 1e3:5.2f} km,"
                f" 95 % {np.percentile(away, 95) / 1e3:5.2f} km, NEES {nees.mean():5.2f}"
                f" (median {np.median(nees):.2f}), beyond the gate {refused}",
                flush=True,
            )


if __name__ == "__main__":
    main()
