"""The inverse of the strapdown: it gives the samples again that made a solution, whatever they
are; what starts beside the solution moves as on the samples; solutions that are repeated or
come too late."""

import numpy as np
import pytest

from isogal.earth.frames import horizontal_difference
from isogal.inertial.error_state import Estimate
from isogal.inertial.inverse import (
    InverseStrapdown,
    NothingFeltError,
    inverse,
    level_attitude,
)
from isogal.inertial.rotations import from_heading, from_rotation_vector, multiply
from isogal.inertial.strapdown import propagate
from isogal.scenario import Imu, Route, Scenario
from isogal.sensors.trajectory import build_trajectory

CORNERS = ((-38.0, 144.5, 22.0), (-37.9, 144.6, 30.0), (-37.9, 144.8, 22.0), (-37.5, 144.9, 22.0))


def whole(start: Estimate, track) -> np.ndarray:
    first = np.concatenate([start.position, start.velocity, start.attitude], axis=1)
    return np.concatenate([first[:, None], track], axis=1)


def state_of(row) -> Estimate:
    return Estimate(row[None, :3].copy(), row[None, 3:6].copy(), row[None, 6:].copy())


@pytest.fixture(scope="module")
def voyage():
    """An INS that turns, with errors of its start and its sensors; (1, K + 1, 10), and what its
    sensors measured."""
    trajectory = build_trajectory(
        Scenario(
            route=Route(waypoints=CORNERS, duration=2400.0, turn_rate=0.03), imu=Imu(rate=1.0)
        )
    )
    draw = np.random.default_rng(3)
    force = trajectory.specific_force + 1e-5 + draw.normal(0.0, 1e-4, (2400, 3))
    rate = trajectory.angular_rate + 1e-8 + draw.normal(0.0, 1e-6, (2400, 3))
    tilted = multiply(*from_rotation_vector(1e-4, -2e-4, 1e-3), *trajectory.attitude[0])
    start = Estimate(
        np.array([[trajectory.latitude[0], trajectory.longitude[0], 100.0]]),
        trajectory.velocity[:1] + np.array([0.1, -0.1, 0.0]),
        np.array([tilted]),
    )
    samples = force[None], rate[None]
    _, track = propagate(start, *samples, 1.0, trajectory.height, history=True)
    return whole(start, track), samples, trajectory.height


@pytest.mark.parametrize("attitude", [True, False], ids=["with attitude", "course alone"])
def test_an_estimate_beside_the_solution_moves_as_on_the_samples(voyage, attitude):
    solution, samples, height = voyage
    taken = solution.copy()
    if not attitude:
        taken[0, :, 6:] = level_attitude(solution[0, :, 3:6])
    ends = []
    for track, felt in ((solution, samples), (taken, inverse(taken, 1.0))):
        start = state_of(track[0, 0])
        start.position[:, :2] += 1e-5
        start.velocity[:, :2] += 0.5
        start.attitude[:] = multiply(*from_rotation_vector(1e-3, 1e-3, 5e-3), *start.attitude[0])
        end, _ = propagate(start, *felt, 1.0, height)
        ends.append((end, horizontal_difference(*end.position[0, :2], *track[0, -1, :2])))
    (_, by_samples), (_, by_solution) = ends
    assert np.hypot(*by_samples) > 500.0
    # of the kilometres that it is off, next to nothing
    assert np.hypot(*(by_samples - by_solution)) < 1e-3 * np.hypot(*by_samples)


def test_what_comes_again_is_not_taken_and_what_comes_too_late_begins_anew(voyage):
    solution, _, _ = voyage
    stream = InverseStrapdown(jump=5.0, longest=60.0)
    stream.take(0.0, solution[0, 0])
    stream.take(1.0, solution[0, 1])
    with pytest.raises(NothingFeltError, match="the one before once more"):
        stream.take(2.0, solution[0, 1])
    (felt,) = stream.take(3.0, solution[0, 3])
    assert felt.interval == 2.0
    with pytest.raises(NothingFeltError, match="97 s after the one before, too long"):
        stream.take(100.0, solution[0, 100])
    (felt,) = stream.take(101.0, solution[0, 101])
    assert felt.interval == 1.0
    # one at rest may well say the same for ever
    still = solution[0, 101].copy()
    still[3:6] = 0.0
    rest = InverseStrapdown(jump=5.0, longest=60.0)
    rest.take(0.0, still)
    (felt,) = rest.take(1.0, still)
    assert np.abs(np.linalg.norm(felt.force) - 9.8) < 0.05


def test_a_level_vehicle_points_along_its_course_and_keeps_it_at_rest():
    velocity = np.array([[0.1, 0.0, 0.0], [0.0, 3.0, 0.0], [0.2, 0.2, 0.0], [-3.0, 0.0, 1.0]])
    attitude = level_attitude(velocity)
    assert attitude == pytest.approx(from_heading([0.0, np.pi / 2, np.pi / 2, np.pi]))
    before = from_heading(1.0)
    assert level_attitude(velocity[:1], before)[0] == pytest.approx(before)
