"""What is checked before the first node of a graph starts."""

import tempfile
from pathlib import Path

from isogal.errors import InputError
from isogal.fields.scenario_map import maps_for_scenario, true_map
from isogal.fields.simulator import true_readings
from isogal.maps.several import RunMap, each_map
from isogal.matching.registry import build_run_matcher
from isogal.scenario import Scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory
from isogal_ros.graph.plan import nodes_of


def checked(scenario: Scenario, simulated: bool = True) -> tuple[Trajectory, RunMap]:
    """Return route and map of a scenario; raises InputError where a node would fail with it.

    Parameters
    ----------
    simulated : bool
        Whether readings are simulated, from the map that `truth` names.
    """
    trajectory = build_trajectory(scenario)
    build_run_matcher(scenario)
    field_map = maps_for_scenario(scenario, trajectory)
    if simulated:
        for one, its_map in zip(scenario.each_field, each_map(field_map), strict=True):
            true_readings(one.true, trajectory, true_map(one, trajectory, its_map))
    nodes_of(scenario)
    return trajectory, field_map


def check_new_folder(name: str, path: str) -> None:
    """Raise InputError, which begins with an argument's name, where a folder cannot be made: it is
    tried, as some file systems refuse what their permissions allow."""
    there = Path(path).absolute()
    while not there.exists():
        there = there.parent
    try:
        with tempfile.TemporaryDirectory(prefix=".isogal-", dir=there):
            pass
    except OSError as error:
        raise InputError(f"{name}: {path}: {there} cannot be written: {error.strerror}") from None
