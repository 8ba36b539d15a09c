"""Make what the instruments of vehicle.yaml would have written on a voyage: imu.csv and
gravimeter.csv, in the units and axes of their makers, and truth.csv, which no vessel has.

    python examples/sensor_driver/make_logs.py out/driver
"""

import argparse
import csv
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import yaml

from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulated_vehicle import simulate_vehicle
from isogal.fields.simulator import ReadingSimulator
from isogal.scenario import Scenario, validate_scenario

VEHICLE = Path(__file__).with_name("vehicle.yaml")
DEPARTURE = 1_780_272_000
"""s since 1970, UTC: 1 June 2026."""


def main() -> None:
    """Write the three files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    scenario = vehicle_scenario()
    vehicle = simulate_vehicle(scenario, scenario.true, 0)
    trajectory = vehicle.trajectory
    readings = ReadingSimulator(
        scenario.true, trajectory, map_for_scenario(scenario, trajectory), [0]
    )
    time = DEPARTURE + trajectory.time
    folder.mkdir(parents=True, exist_ok=True)
    # velocity and angle increments since the sample before; x forward, y right, z down
    means = np.hstack([vehicle.imu.specific_force[0], vehicle.imu.angular_rate[0]])
    header = ["utc", "dv_x", "dv_y", "dv_z", "da_x", "da_y", "da_z"]
    _write(folder / "imu.csv", header, zip(time[1:], *(trajectory.dt * means).T, strict=True))
    gravity = zip(time[readings.index], readings.raw[0] / 1e-5, strict=True)
    _write(folder / "gravimeter.csv", ["utc", "gravity_mgal"], gravity)
    places = zip(time, *np.degrees([trajectory.latitude, trajectory.longitude]), strict=True)
    _write(folder / "truth.csv", ["utc", "latitude", "longitude"], places)
    print(f"{folder}: {len(trajectory)} IMU samples, {len(readings.index)} readings")


def vehicle_scenario() -> Scenario:
    """Return what vehicle.yaml says of all nodes."""
    document = yaml.safe_load(VEHICLE.read_text(encoding="utf-8"))
    return validate_scenario(document["/**"]["ros__parameters"])


def _write(path: Path, header: list[str], rows: Iterable[tuple[float, ...]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as stream:
        out = csv.writer(stream)
        out.writerow(header)
        out.writerows([f"{row[0]:.3f}", *(f"{value:.10g}" for value in row[1:])] for row in rows)


if __name__ == "__main__":
    main()
