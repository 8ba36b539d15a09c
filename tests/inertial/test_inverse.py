"""The inverse of the strapdown: it gives the samples again that made a solution, whatever they
are; what starts beside the solution moves as on the samples; solutions that are missing, repeated,
rounded, or that jump."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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


def distance(end: Estimate, row) -> float:
    """Return how far a state is from a solution, m, horizontal."""
    return float(np.hypot(*horizontal_difference(*end.position[0, :2], *row[:2])))


@given(
    st.integers(0, 2**32 - 1),
    st.sampled_from([0.1, 1.0, 5.0]),
    st.booleans(),
    st.floats(-88.0, 88.0),
    st.floats(-180.0, 180.0),
    st.floats(0.0, 300.0),
    st.floats(0.0, 0.3),
)
@settings(max_examples=30, deadline=None)
def test_the_strapdown_gives_the_solution_again(
    seed, dt, preintegrated, latitude, longitude, speed, turn
):
    draw = np.random.default_rng(seed)
    course = draw.uniform(-np.pi, np.pi)
    start = Estimate(
        np.array([[np.radians(latitude), np.radians(longitude), draw.uniform(-100.0, 9000.0)]]),
        np.array([[speed * np.cos(course), speed * np.sin(course), draw.uniform(-3.0, 3.0)]]),
        np.array([from_rotation_vector(*draw.uniform(-2.0, 2.0, 3))]),
    )
    force = draw.normal([0.0, 0.0, -9.8], 2.0, (1, 40, 3))
    rate = draw.normal(0.0, turn / dt, (1, 40, 3))
    _, track = propagate(start, force, rate, dt, history=True, preintegrated=preintegrated)
    solution = whole(start, track)
    found = inverse(solution, dt, preintegrated)
    # as far as the last digits of a position of 1e7 m, over ten seconds, let it be known
    assert np.abs(found[0] - force).max() < 1e-7 / dt
    assert np.abs(found[1] - rate).max() < 1e-9 / dt
    again, retraced = propagate(start, *found, dt, history=True, preintegrated=preintegrated)
    assert np.abs(retraced[..., :2] - track[..., :2]).max() < 1e-14
    assert np.abs(retraced[..., 2:6] - track[..., 2:6]).max() < 1e-7
    assert np.abs(retraced[..., 6:] - track[..., 6:]).max() < 1e-12
    assert distance(again, solution[0, -1]) < 1e-6


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


def test_one_by_one_it_is_the_same(voyage):
    solution, _, _ = voyage
    force, rate = inverse(solution, 1.0)
    stream = InverseStrapdown(jump=5.0, longest=600.0)
    found = [stream.take(float(k), row) for k, row in enumerate(solution[0, :50])]
    assert found[0] == []
    assert [len(one) for one in found[1:]] == [1] * 49
    assert np.array_equal([one[0].force for one in found[1:]], force[0, :49])
    assert np.array_equal([one[0].rate for one in found[1:]], rate[0, :49])


def test_where_solutions_are_missing_the_way_there_is_not_lost(voyage):
    solution, _, _ = voyage
    stream = InverseStrapdown(jump=5.0, longest=600.0)
    stream.take(0.0, solution[0, 0])
    felt = stream.take(1.0, solution[0, 1])
    felt += stream.take(500.0, solution[0, 500])
    felt += [one for k in range(501, 560) for one in stream.take(float(k), solution[0, k])]
    state = state_of(solution[0, 0])
    for one in felt:
        state, _ = propagate(state, one.force[None, None], one.rate[None, None], one.interval)
    assert sum(one.interval for one in felt) == pytest.approx(559.0)
    assert max(one.interval for one in felt) <= 10.0
    assert distance(state, solution[0, 559]) < 0.5
    assert np.abs(state.attitude[0] - solution[0, 559, 6:]).max() < 1e-9


def test_a_jump_is_no_acceleration(voyage):
    solution, _, _ = voyage
    moved = solution[0, :100].copy()
    moved[50:, 0] += 500.0 / 6.37e6
    moved[50:, 3] += 1.0
    stream = InverseStrapdown(jump=5.0, longest=600.0)
    forces = []
    for k, row in enumerate(moved):
        if k == 50:
            with pytest.raises(NothingFeltError, match=r"jumped by 49\d.\d m.*ins.jump is 5 m"):
                stream.take(float(k), row)
            continue
        forces += [one.force for one in stream.take(float(k), row)]
    assert len(forces) == 98
    assert np.abs(np.array(forces)[:, :2]).max() < 1.0


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
