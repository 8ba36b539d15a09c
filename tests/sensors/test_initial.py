"""The navigator's start: truth plus errors of the scenario's size, height and vertical velocity
exact."""

import numpy as np
from scipy.spatial.transform import Rotation

from helpers.statistics import within_chi_square
from isogal.earth.frames import horizontal_difference
from isogal.scenario import InitialError, Route, Scenario
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory

RUNS = 500


def draw(runs, **sigma):
    scenario = Scenario(route=Route(duration=10.0), initial_error=InitialError(**sigma))
    trajectory = build_trajectory(scenario)
    drawn = draw_initial_state(scenario.initial_error, trajectory, scenario.seed, runs)
    return drawn, trajectory


def test_errors_have_the_sigma_of_the_scenario():
    sigma = {"position": 80.0, "velocity": 0.3, "tilt": 1e-4, "heading": 2e-3}
    nav, trajectory = draw(range(RUNS), **sigma)
    shift = horizontal_difference(
        *nav.position[:, :2].T, trajectory.latitude[0], trajectory.longitude[0]
    )
    faster = (nav.velocity - trajectory.velocity[0])[:, :2]
    true = Rotation.from_quat(trajectory.attitude[0], scalar_first=True)
    turn = (
        Rotation.from_quat(nav.attitude, scalar_first=True) * true.inv()
    ).as_rotvec()  # about north, east, down
    errors = np.column_stack([shift / 80.0, faster / 0.3, turn / [1e-4, 1e-4, 2e-3]])
    assert within_chi_square((errors**2).sum(axis=0), RUNS)
    assert np.abs(np.corrcoef(errors.T) - np.eye(7)).max() < 4.0 / np.sqrt(RUNS)
    assert np.abs(errors.mean(axis=0)).max() < 4.0 / np.sqrt(RUNS)
    assert (nav.position[:, 2] == 100.0).all()
    assert (nav.velocity[:, 2] == 0.0).all()


def test_without_errors_it_is_the_truth():
    nav, trajectory = draw([3, 4], position=0.0, velocity=0.0, tilt=0.0, heading=0.0)
    start = [trajectory.latitude[0], trajectory.longitude[0], 100.0]
    np.testing.assert_array_equal(nav.position, [start] * 2)
    np.testing.assert_array_equal(nav.velocity, [trajectory.velocity[0]] * 2)
    np.testing.assert_allclose(nav.attitude, [trajectory.attitude[0]] * 2, atol=1e-16)
