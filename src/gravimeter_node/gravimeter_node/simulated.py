"""Simulated readings of a run, by stamp."""

from typing import Any

from isogal.fields.magnetic_vehicle import assumed_compensation
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulator import ReadingSimulator
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.messages.stamps import from_seconds

ByStamp = dict[int, Any]


def simulated_readings(scenario: Scenario, run: int) -> tuple[ByStamp, ByStamp | None]:
    """Return the raw reading of each scan, a number or one for each channel, and what the vector
    magnetometer of a magnetic vehicle, or of one that is taken to be, feels at each step (None =
    there is none); the map is not kept.

    Raises
    ------
    InputError
        The map does not cover the route, or the file of coefficients cannot be read.
    """
    truth = scenario.true
    trajectory = build_trajectory(scenario)
    found = ReadingSimulator(truth, trajectory, map_for_scenario(truth, trajectory), [run])
    stamps = [from_seconds(time) for time in trajectory.time]
    felt = {stamps[i]: value for i, value in zip(found.index, found.felt[0], strict=True)}
    magnetic = truth.measured_field == "magnetic" and truth.magnetometer.aircraft.magnetic
    if not magnetic and assumed_compensation(scenario) is None:
        return felt, None
    return felt, dict(zip(stamps, found.vehicle.vector[0], strict=True))
