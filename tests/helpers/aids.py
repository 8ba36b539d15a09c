"""A vehicle in turns for the tests of simulated aids, and where their fixes lie."""

import numpy as np

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.scenario import Scenario, load_scenario
from isogal.sensors.trajectory import Trajectory, build_trajectory

TURNS = "route.waypoints=[[-37.9, 144.8, 22], [-37.85, 144.9, 18], [-37.95, 144.95, 25]]"


def in_turns(*more: str) -> tuple[Scenario, Trajectory]:
    """Return a scenario of ten minutes with turns, and its trajectory."""
    it = load_scenario(None, ["route.duration=600", TURNS, *more])
    return it, build_trajectory(it)


def displacement(fixes, trajectory: Trajectory) -> Array:
    """Return (R, M, 3) of fixes from the true place of the inertial sensors, NED, m."""
    out = np.empty_like(fixes.values)
    for k, step in enumerate(fixes.ends):
        origin = trajectory.latitude[step], trajectory.longitude[step], trajectory.height[step]
        enu = LocalFrame(*origin).from_geodetic(*np.moveaxis(fixes.values[:, k], -1, 0))
        out[:, k] = enu[:, [1, 0, 2]] * [1.0, 1.0, -1.0]
    return out
