"""What `colcon test` runs of this package; all others are in the folder tests beside src."""

import pytest

from isogal.earth.gravity import normal_gravity
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory


def test_the_default_route() -> None:
    trajectory = build_trajectory(load_scenario(None, ["route.duration=60"]))
    assert len(trajectory) == 60


def test_normal_gravity_of_the_equator() -> None:
    assert float(normal_gravity(0.0)) == pytest.approx(9.78033, abs=1e-5)
