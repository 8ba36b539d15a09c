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
from scipy.ndimage import uniform_filter
from dataclasses import replace
from isogal.maps.field_map import FieldMap

sys.path.insert(0, str(Path(__file__).parent.parent / "examples" / "phone_drive"))
from phone_log import Drive, read_drive  # noqa: E402

from isogal.earth.frames import horizontal_difference
from isogal.fusion.measurements import PositionFix, SampleNoise, VelocityReading, ZeroRotation
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_angles
from isogal.maps.load import load_map
from isogal.navigator import Navigator
from isogal.scenario import Scenario, changed_scenario, load_scenario
from isogal.sensors.barometer import height_of

ZERO = 1e-3
LEAST, SHARE, MOST = eval(__import__('os').environ.get('SG','5.0,0.45,14.0'))
import os
FAKE = float(os.environ['FAKE']) if 'FAKE' in os.environ else None
RNG = np.random.default_rng(0)
KNOWN = 300.0
"""s with satellites."""


def scenario_of() -> Scenario:
    return load_scenario(Path(__file__).parent.parent / "examples" / "phone_drive" / "car.yaml")


def with_sigma(terrain: FieldMap) -> FieldMap:
    """Return a terrain map that says what a road may be off it by: a share of the relief between
    its nodes, and what is left where it is flat."""
    mean, square = (
        uniform_filter(np.asarray(part, dtype=float), 3)
        for part in (terrain.values, terrain.values**2.0)
    )
    relief = np.sqrt(np.maximum(square - mean**2, 0.0))
    return replace(terrain, sigma=np.hypot(LEAST, np.minimum(SHARE * relief, MOST)), error_stated=True)


def first_start(drive: Drive) -> int:
    """Return the first sample with a position and a course at a speed."""
    moving = (drive.speed > 4.0) & np.isfinite(drive.course) & np.isfinite(drive.latitude)
    return int(np.argmax(moving & (drive.speed_sigma < 2.0)))


def navigate(drive: Drive, scenario: Scenario, field_map, matched: bool, log=None) -> np.ndarray:
    """Return (K, 4) of each second after the satellites: time, error north and east (m), NEES per
    axis."""
    first = first_start(drive)
    height = height_of(drive.pressure, scenario.height)
    heading = drive.course[first]
    start = Estimate(
        np.array([drive.latitude[first], drive.longitude[first], drive.altitude[first]]),
        drive.speed[first] * np.array([math.cos(heading), math.sin(heading), 0.0]),
        np.asarray(from_angles(0.0, 0.0, heading)),
    )
    navigator = Navigator(scenario, [field_map], start, drive.time[first], horizon=60.0)
    speed = held(drive.speed)
    rows = []
    for k in range(first + 1, len(drive.time)):
        t = drive.time[k]
        navigator.imu(t, drive.force[k], drive.rate[k], height[k])
        known = t < KNOWN
        found = [SampleNoise(np.array([0.0, 0.0, drive.turn_variance[k]]), 1.0)]
        if speed[k] < 0.1 and speed[k-1] < 0.1:
            found.append(ZeroRotation(drive.rate[k], ZERO))
        reading = VelocityReading.of(scenario.velocity, np.array([speed[k], 0.0, math.nan]))
        if reading is not None:
            found.append(reading)
        if known and np.isfinite(drive.latitude[k]):
            sigma = max(drive.horizontal_sigma[k], 3.0)
            found.append(
                PositionFix(drive.latitude[k], drive.longitude[k], np.eye(2) * sigma**2)
            )
        for one in found:
            done = navigator.measure(t, one)
            if log is not None and not done.used and not isinstance(one, ZeroRotation):
                log(f"{t:.0f} {type(one).__name__} {done.reason} {done.innovation}")
        if matched and t % scenario.gravimeter.interval == 0:
            reading = height[k] if speed[k] > 0.5 else math.nan
            if FAKE is not None and np.isfinite(drive.latitude[k]):
                reading = float(field_map.value(drive.latitude[k:k+1], drive.longitude[k:k+1])[0]) + FAKE * RNG.standard_normal() + 90.0
            navigator.read(0, np.array([t]), np.array([reading]))
            applied = navigator.fix()
            if log is not None and applied is not None:
                log(f"{t:.0f} fix {applied.fix.status} {applied.fix.reason} " + " ".join(f"{a}={b:.3g}" for a,b in applied.fix.diagnostics.items()) + str([i.reason for i in applied.innovations if i.reason]))
        if not known and np.isfinite(drive.latitude[k]):
            state = navigator.state
            error = np.array(
                horizontal_difference(
                    state.position[0], state.position[1], drive.latitude[k], drive.longitude[k]
                )
            )
            P = state.covariance[:2, :2]
            rows.append([t, *error, error @ np.linalg.solve(P, error) / 2.0, math.sqrt(np.trace(P))])
            if log is not None and k % 100 == 0:
                log(f"  {t:.0f} v={speed[k]:.1f} err {np.hypot(*error):.0f} sigma {math.sqrt(np.trace(P)):.0f} nees {rows[-1][3]:.2f} heading sigma {math.sqrt(state.covariance[8,8]):.3f}")
    return np.array(rows)


def held(values: np.ndarray) -> np.ndarray:
    """Return values in which a missing one is between those beside it."""
    index = np.arange(len(values))
    known = np.isfinite(values)
    return np.interp(index, index[known], values[known])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    parser.add_argument("--log", action="store_true")
    parser.add_argument("--dead", action="store_true")
    parser.add_argument("--mapped", action="store_true")
    parser.add_argument("--set", action="append", default=[])
    arguments = parser.parse_args()
    scenario = changed_scenario(scenario_of(), arguments.set, "--set")
    for path in sorted(arguments.folder.glob("drive_*.nc")):
        name = path.stem.removeprefix("drive_")
        if arguments.only not in name:
            continue
        drive = read_drive(path, KNOWN)
        field_map = load_map(arguments.folder / f"dted0_{name}.nc", "height")
        field_map = with_sigma(field_map)
        for matched in (False,) if arguments.dead else (True,) if arguments.mapped else (False, True):
            rows = navigate(drive, scenario, field_map, matched, print if arguments.log else None)
            away = np.hypot(rows[:, 1], rows[:, 2]) / 1e3
            print(
                f"{name} {'map' if matched else 'dead reckoning':15s} median {np.median(away):.2f} km,"
                f" 95 % {np.percentile(away, 95):.2f} km, NEES {rows[:, 3].mean():.2f}"
                f" (median {np.median(rows[:, 3]):.2f}), sigma {np.median(rows[:,4])/1e3:.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
