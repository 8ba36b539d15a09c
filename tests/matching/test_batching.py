"""Scans to batches: when one is due, and that its transition is what the strapdown does to a wrong
navigator."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers.navigators import ROUTE, random_covariance
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.inertial.error_state import Estimate
from isogal.inertial.strapdown import propagate
from isogal.matching.batching import BatchBuilder, fix_due
from isogal.matching.expansion import Soundings
from isogal.matching.transitions import carried
from isogal.scenario import Altimeter, Height, Matcher, Scenario, changed_scenario
from isogal.sensors.altimeter import TerrainReduction
from isogal.sensors.gravimeter import (
    DisturbanceReduction,
    GravityReduction,
)
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import build_trajectory

SCANS, STEP = 30, 10
PRIOR_SIGMA = np.array([300.0, 200.0, 0.3, 0.2, 5e-5, 5e-5, 5e-4])
TRAJECTORY = build_trajectory(Scenario(route=ROUTE))
CORNER = build_trajectory(
    Scenario(
        route=ROUTE.model_copy(
            update={
                "waypoints": ((-36.5, 147.0, 22.0), (-36.48, 147.02, 35.0), (-36.52, 147.2, 22.0))
            }
        )
    )
)


@pytest.mark.parametrize(("length", "stride", "due"), [
    (30, None, list(range(30, 91, 5))), (4, None, list(range(4, 91, 4))), (30, 30, [30, 60, 90]),
    (30, 10, [30, 40, 50, 60, 70, 80, 90]), (30, 1, list(range(30, 91))), (40, 25, [40, 65, 90]),
])  # fmt: skip
def test_fix_due(length, stride, due):
    settings = Matcher(batch_length=length, stride=stride)
    assert [n for n in range(91) if fix_due(n, settings)] == due


def flown(trajectory, error=(0.0,) * 7, scans=SCANS):
    """Position (scans, 2), velocity (scans, 2) and attitudes at the scans of a navigator that
    starts with an error (7,)."""
    error = np.array(error)
    metres = np.array([*metres_per_radian(trajectory.latitude[0], 100.0), 1.0])
    attitude = Rotation.from_rotvec(error[4:]) * Rotation.from_quat(
        trajectory.attitude[0], scalar_first=True
    )
    nav = Estimate(
        np.array([[trajectory.latitude[0], trajectory.longitude[0], 100.0]])
        + np.append(error[:2], 0.0) / metres,
        trajectory.velocity[:1] + np.append(error[2:4], 0.0),
        attitude.as_quat(scalar_first=True)[None],
    )
    position, velocity, attitudes = [], [], []
    for k in range(0, scans * STEP, STEP):
        force, rate = (
            trajectory.specific_force[None, k : k + STEP],
            trajectory.angular_rate[None, k : k + STEP],
        )
        nav, _ = propagate(nav, force, rate, 1.0, trajectory.height[k : k + STEP + 1])
        position.append(nav.position[0, :2])
        velocity.append(nav.velocity[0, :2])
        attitudes.append(nav.attitude[0])
    return (
        np.array(position),
        np.array(velocity),
        Rotation.from_quat(np.array(attitudes), scalar_first=True),
    )


REDUCTIONS = {
    "gravity": GravityReduction(),
    "disturbance": DisturbanceReduction(),
    "terrain": TerrainReduction(Altimeter()),
}


def builder_of(position, velocity, reading=None, quantity="gravity", context=0, **settings):
    builder = BatchBuilder(Matcher(**settings), REDUCTIONS[quantity], context)
    reading = np.arange(len(position)) * 1e-5 if reading is None else reading
    for t, (p, v, r) in enumerate(zip(position, velocity, reading, strict=True)):
        builder.add_scan(10.0 * (t + 1), p[0], p[1], v, r, 1e-5, 2e-6)
    return builder


def independent_prior():
    return np.diag([1e6, 1e6, 1.0, 1.0, 1.0, 1.0, 1.0])


ERRORS = {
    "position": [400.0, -300.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "velocity": [0.0, 0.0, 0.5, -0.4, 0.0, 0.0, 0.0],
    "tilt": [0.0, 0.0, 0.0, 0.0, 1e-4, -5e-5, 0.0],
    "heading": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3],
    "all": [300.0, 200.0, -0.3, 0.2, 5e-5, 1e-4, -1e-3],
}


@pytest.mark.parametrize("trajectory", [TRAJECTORY, CORNER], ids=["straight", "corner"])
@pytest.mark.parametrize("name", ERRORS)
def test_transition_is_what_the_strapdown_does(name, trajectory):
    position, velocity, attitude = flown(trajectory, np.array(ERRORS[name]))
    true_position, true_velocity, true_attitude = flown(trajectory)
    actual = horizontal_difference(*position.T, *true_position.T)
    xi = np.concatenate([actual[-1], (velocity - true_velocity)[-1]])
    psi = (attitude[-1] * true_attitude[-1].inv()).as_rotvec()
    batch = builder_of(position, velocity).build(independent_prior())
    predicted = batch.by_error[:, :2] @ np.concatenate([xi, psi])
    within = 0.1 if trajectory is TRAJECTORY else 0.3 + 0.02 * np.abs(predicted - actual[-1]).max()
    np.testing.assert_allclose(predicted, actual, atol=within)
    moved = np.abs(actual - actual[-1]).max()
    assert name == "position" or moved > 1.0  # staying put would be wrong
    np.testing.assert_allclose(batch.by_error[-1, :2], np.eye(2, 7), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_what_xi_explains_and_the_drift_make_up_the_navigators_covariance(seed):
    """Covariance of the errors at the scans, and with xi, as from the joint prior: nothing lost,
    nothing counted twice."""
    prior = random_covariance(PRIOR_SIGMA, seed)
    builder = builder_of(*flown(TRAJECTORY)[:2])
    batch = builder.build(prior)
    back = batch.by_error[:, :2]
    np.testing.assert_array_equal(batch.prior, 0.5 * (prior + prior.T)[:4, :4])
    joint = back @ prior @ back.transpose(0, 2, 1)
    split = batch.transition @ prior[:4, :4] @ batch.transition.transpose(0, 2, 1)
    rest = batch.nuisance[:, :2]
    split += rest @ rest.transpose(0, 2, 1)
    np.testing.assert_allclose(split, joint, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(
        batch.transition @ prior[:4, :4], back @ prior[:, :4], rtol=1e-9, atol=1e-6
    )


@pytest.mark.parametrize(
    ("quantity", "reduction"),
    [("gravity", GravityReduction()), ("disturbance", DisturbanceReduction())],
)
def test_readings_of_a_wrong_navigator_are_wrong_by_the_jacobian(quantity, reduction):
    position, velocity, attitude = flown(TRAJECTORY, ERRORS["all"])
    true_position, true_velocity, true_attitude = flown(TRAJECTORY)
    here, there = (
        State(place[:, 0], 0.0, 100.0, *speed.T)
        for place, speed in ((position, velocity), (true_position, true_velocity))
    )
    felt = GravityReduction().raw(9.8, there)
    wrong = reduction.reduce(felt, here) - reduction.reduce(felt, there)
    xi = np.concatenate(
        [horizontal_difference(*position[-1], *true_position[-1]), (velocity - true_velocity)[-1]]
    )
    psi = (attitude[-1] * true_attitude[-1].inv()).as_rotvec()
    batch = builder_of(position, velocity, quantity=quantity).build(independent_prior())
    assert np.abs(wrong).max() > 2e-5
    np.testing.assert_allclose(
        batch.reading_jacobian @ xi + batch.nuisance[:, 2] @ psi, wrong, atol=3e-7
    )


@pytest.mark.parametrize(
    ("quantity", "reduction"),
    [("gravity", GravityReduction()), ("disturbance", DisturbanceReduction())],
)
def test_correcting_brings_back_truth_and_its_readings(quantity, reduction):
    error = np.array(ERRORS["all"])
    position, velocity, attitude = flown(TRAJECTORY, error)
    true_position, true_velocity, true_attitude = flown(TRAJECTORY)
    here, there = (
        State(place[:, 0], 0.0, 100.0, *speed.T)
        for place, speed in ((position, velocity), (true_position, true_velocity))
    )
    felt = GravityReduction().raw(9.8, there)
    builder = builder_of(position, velocity, reduction.reduce(felt, here), quantity)
    jump = np.concatenate([
        -horizontal_difference(*position[-1], *true_position[-1]), (true_velocity - velocity)[-1],
        (true_attitude[-1] * attitude[-1].inv()).as_rotvec(),
    ])  # fmt: skip
    builder.correct(300.0, jump)
    batch = builder.build(random_covariance(PRIOR_SIGMA))
    off = horizontal_difference(batch.latitude, batch.longitude, *true_position.T)
    np.testing.assert_allclose(off, 0.0, atol=0.1)
    np.testing.assert_allclose(batch.velocity, true_velocity, atol=2e-3)
    right = reduction.reduce(felt, there)
    wrong = reduction.reduce(felt, here)
    assert np.abs(wrong - right).max() > 2e-5
    np.testing.assert_allclose(batch.reading, right - 2e-6, atol=3e-7)


def test_correcting_leaves_later_scans_alone_and_forgives_an_empty_builder():
    position, velocity, _ = flown(TRAJECTORY)
    builder = builder_of(position, velocity)
    before = builder.build(independent_prior())
    builder.correct(150.0, np.array([100.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    after = builder.build(independent_prior())
    moved = horizontal_difference(
        after.latitude, after.longitude, before.latitude, before.longitude
    )
    np.testing.assert_allclose(moved[:15], [[100.0, 0.0]] * 15, atol=0.05)
    assert not moved[15:].any()
    BatchBuilder(Matcher(), REDUCTIONS["gravity"]).correct(10.0, np.ones(7))


def test_batches_hold_context_and_count_what_is_new():
    position, velocity, _ = flown(TRAJECTORY, scans=50)
    builder = BatchBuilder(Matcher(batch_length=20, stride=10), REDUCTIONS["gravity"], context=15)
    lengths, new, first = [], [], []
    for t in range(50):
        assert not builder.ready or t == 0
        builder.add_scan(float(t), *position[t], velocity[t], np.nan if t == 3 else 1e-5 * t, 1e-5)
        if builder.ready:
            batch = builder.build(independent_prior())
            lengths.append(len(batch))
            new.append(batch.new)
            first.append(int(batch.time[0]))
            assert batch.time[-1] == t
    assert lengths == [20, 30, 35, 35]
    assert first == [0, 0, 5, 15]
    assert new == [20, 10, 10, 10]


def test_scans_come_out_as_they_went_in():
    position, velocity, _ = flown(TRAJECTORY)
    batch = builder_of(position, velocity).build(independent_prior())
    np.testing.assert_array_equal(np.column_stack([batch.latitude, batch.longitude]), position)
    np.testing.assert_array_equal(batch.velocity, velocity)
    np.testing.assert_array_equal(batch.reading, 1e-5 * np.arange(SCANS) - 2e-6)
    assert (batch.sigma == 1e-5).all()
    assert batch.new == SCANS


def test_soundings_of_several_beams_come_out_less_their_offset():
    position, velocity, _ = flown(TRAJECTORY)
    beams = Soundings(2, 0.0)
    builder = BatchBuilder(Matcher(), REDUCTIONS["terrain"], expansion=beams)
    for t, (place, speed) in enumerate(zip(position, velocity, strict=True)):
        heights = np.array([[100.0, 0.0, 0.0, 50.0], [90.0, 30.0, 0.0, 50.0]])
        builder.add_scan(10.0 * (t + 1), *place, speed, heights, 1.0, 7.0)
    batch = builder.build(independent_prior())
    np.testing.assert_array_equal(batch.reading, np.tile([93.0, 83.0], SCANS))


@pytest.mark.parametrize("name", ERRORS)
def test_back_to_where_the_last_batch_ended(name):
    """The error there is what that at the end says, velocity and attitude as well as position."""
    position, velocity, attitude = flown(TRAJECTORY, np.array(ERRORS[name]))
    true_position, true_velocity, true_attitude = flown(TRAJECTORY)
    builder = builder_of(position[:20], velocity[:20], batch_length=20, stride=10, context=0)
    builder.build(independent_prior())
    for t in range(20, 30):
        builder.add_scan(10.0 * (t + 1), *position[t], velocity[t], 0.0, 1e-5)
    batch = builder.build(independent_prior())
    north, east = horizontal_difference(*position.T, *true_position.T).T
    error = np.column_stack([north, east, velocity - true_velocity])
    psi = (attitude[-1] * true_attitude[-1].inv()).as_rotvec()
    then = batch.backward[-batch.new - 1] @ np.concatenate([error[-1], psi])
    np.testing.assert_allclose(then[:2], error[19, :2], atol=0.05)
    np.testing.assert_allclose(then[2:4], error[19, 2:], atol=1e-3)
    there = (attitude[19] * true_attitude[19].inv()).as_rotvec()
    np.testing.assert_allclose(then[4:], there, atol=2e-7)


def across_a_gap(before: np.ndarray, after: np.ndarray):
    """A batch of ten scans 10 s apart, with a gap from 42 s to 66 s; the covariances (7, 7) at
    both ends."""
    builder = BatchBuilder(Matcher(batch_length=10, stride=10), GravityReduction())
    position, velocity, _ = flown(TRAJECTORY, scans=10)
    for scan in range(10):
        reading = np.nan if scan in (4, 5) else 9.8
        builder.add_scan(10.0 * (scan + 1), *position[scan], velocity[scan], reading, 1e-5)
        if scan == 5:
            builder.bridge(42.0, before, 66.0, after)
    return builder


def test_a_gap_in_the_inertial_data_leaves_the_scans_before_it_what_they_were():
    """Position errors before the gap have the covariance that the navigator had, those after it
    the one it has; before, a jump of the velocity was carried back through the gap."""
    before = random_covariance(PRIOR_SIGMA, 1)
    forward = carried(before, (TRAJECTORY.latitude[0], TRAJECTORY.velocity[0, :2], 42.0), 66.0)
    unknown = random_covariance(np.array([300.0, 300.0, 10.0, 10.0, 1e-4, 1e-4, 0.1]), 2)
    after = forward + unknown
    builder = across_a_gap(before, after)
    end = carried(after, (TRAJECTORY.latitude[0], TRAJECTORY.velocity[0, :2], 66.0), 100.0)
    batch = builder.build(end)
    assert batch.cut == 6
    for scan, (time, expected) in {2: (30.0, before), 7: (80.0, after)}.items():
        by_xi, rest = batch.transition[scan], batch.nuisance[scan, :2]
        P = by_xi @ batch.prior @ by_xi.T + rest @ rest.T
        at = 42.0 if scan == 2 else 66.0
        turn = carried(expected, (TRAJECTORY.latitude[0], TRAJECTORY.velocity[0, :2], at), time)
        np.testing.assert_allclose(P, turn[:2, :2], rtol=0.01, atol=0.5)
    # a correction of the velocity after the gap does not move the scans before it by 60 s of it
    builder.correct(100.0, np.array([0.0, 0.0, 8.0, 0.0, 0.0, 0.0, 0.0]))
    shift = builder.collected.scans[2].latitude - batch.latitude[2]
    assert abs(shift) * 6.36e6 < 0.2 * 8.0 * 70.0


def test_readings_before_a_gap_before_the_last_are_given_up():
    P = random_covariance(PRIOR_SIGMA, 1)
    builder = across_a_gap(P, 4.0 * P)
    builder.bridge(92.0, P, 104.0, 4.0 * P)
    readings = [scan.reading for scan in builder.collected.scans]
    assert np.isnan(readings[:6]).all()
    assert np.isfinite(readings[6:]).all()
    again = BatchBuilder(Matcher(batch_length=10, stride=10), GravityReduction())
    again.restore(builder.collected)
    assert again.build(P).cut == 10


def test_two_sensors_of_the_height_leave_less_of_their_errors():
    """Readings are off by what the weighted mean of both heights is off by."""
    keys = {"source": "barometer", "bias": 3.0, "scale": 0.0, "weather_sigma": 6.0}
    scenario = Scenario(matcher=Matcher(batch_length=2), height=Height(**keys))
    second = {"name": "aft", "bias": 4.0, "scale": 0.0, "weather_sigma": 0.0}
    both = changed_scenario(scenario, [f"heights=[{second}]"], "test")
    found = []
    for one in (scenario, both):
        builder = BatchBuilder.of(one)
        for t in range(2):
            builder.add_scan(10.0 * (t + 1), -0.6, 2.5, np.array([10.0, 10.0]), 9.8, 1e-5)
        states = builder.build(np.eye(7)).instrument.parameters
        found.append(dict(zip(states.names, states.sigma, strict=True)))
    assert found[0] == {"height_bias": 3.0, "height_weather": 6.0}
    assert found[1] == {"height_bias": pytest.approx(2.4)}
