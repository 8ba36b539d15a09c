"""Scans to batches: when one is due, and that its transition is what the strapdown does to a wrong
navigator; readings that are late and filtered; horizontal gravity that nothing takes off."""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.navigators import ROUTE, random_covariance
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.fields.gravity import DISTURBANCE
from isogal.fields.known_gravity import KnownGravity, Residual
from isogal.fields.map_error import TrueMapError
from isogal.fields.simulator import ReadingSimulator
from isogal.inertial.error_state import Estimate
from isogal.inertial.strapdown import propagate
from isogal.matching.batching import BatchBuilder, fix_due
from isogal.matching.interfaces import Fix
from isogal.matching.map_matching import MapMatching
from isogal.matching.pmht.late import sensed
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.rows import rows_of
from isogal.matching.pmht.states import States
from isogal.matching.reading_noise import of_vehicle
from isogal.matching.residual_gravity import ResidualGravity
from isogal.matching.scans import Scans
from isogal.matching.transitions import carried
from isogal.scenario import (
    Altimeter,
    Gravimeter,
    Height,
    MapError,
    Matcher,
    Scenario,
    changed_scenario,
)
from isogal.sensors.gravimeter import (
    DisturbanceReduction,
    GravityReduction,
)
from isogal.sensors.lag import low_pass
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import build_trajectory

SCANS, STEP = 30, 10
PRIOR_SIGMA = np.array([300.0, 200.0, 0.3, 0.2, 5e-5, 5e-5, 5e-4])
POINTS = ((-36.5, 147.0, 22.0), (-36.48, 147.02, 35.0), (-36.52, 147.2, 22.0))
TRAJECTORY, CORNER = (
    build_trajectory(Scenario(route=ROUTE.model_copy(update={"waypoints": points})))
    for points in (None, POINTS)
)
GRAVITY = GravityReduction()
INDEPENDENT = np.diag([1e6, 1e6, 1.0, 1.0, 1.0, 1.0, 1.0])


@pytest.mark.parametrize(("length", "stride", "due"), [
    (30, None, list(range(30, 91, 5))), (4, None, list(range(4, 91, 4))),
    (30, 10, [30, 40, 50, 60, 70, 80, 90]), (40, 25, [40, 65, 90]),
])  # fmt: skip
def test_fix_due(length, stride, due):
    settings = Matcher(batch_length=length, stride=stride)
    assert [n for n in range(91) if fix_due(n, settings)] == due


@dataclass
class Flown:
    """A navigator at the scans."""

    position: np.ndarray
    """(scans, 2) rad."""
    velocity: np.ndarray
    """(scans, 2) m/s."""
    attitude: Rotation

    def error(self, truth: "Flown") -> np.ndarray:
        """(scans, 7) of position, velocity and attitude."""
        apart = horizontal_difference(*self.position.T, *truth.position.T)
        turn = (self.attitude * truth.attitude.inv()).as_rotvec()
        return np.column_stack([apart, self.velocity - truth.velocity, turn])

    @property
    def state(self) -> State:
        return State(self.position[:, 0], 0.0, 100.0, *self.velocity.T)


def flown(trajectory, error=(0.0,) * 7, scans=SCANS) -> Flown:
    """A navigator that starts with an error (7,)."""
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
    samples = trajectory.specific_force[None], trajectory.angular_rate[None]
    first = (one[:, : scans * STEP] for one in samples)
    height = trajectory.height[: scans * STEP + 1]
    _, track = propagate(nav, *first, 1.0, height, history=True)
    at = track[0, STEP - 1 :: STEP]
    return Flown(at[:, :2], at[:, 3:5], Rotation.from_quat(at[:, 6:], scalar_first=True))


def made_builder(context=0, gravimeter=None, **settings) -> BatchBuilder:
    """Of a scenario that has no errors beside white noise."""
    gravimeter = gravimeter or Gravimeter()
    return BatchBuilder(Scenario(matcher=Matcher(**settings), gravimeter=gravimeter), context)


def builder_of(it: Flown, reading=None, quantity="gravity", **settings):
    builder = made_builder(gravimeter=Gravimeter(quantity=quantity), **settings)
    reading = np.arange(len(it.position)) * 1e-5 if reading is None else reading
    for t, (p, v, r) in enumerate(zip(it.position, it.velocity, reading, strict=True)):
        builder.add_scan(10.0 * (t + 1), p[0], p[1], v, r, 1e-5, 2e-6)
    return builder


ERRORS = {
    "position": [400.0, -300.0, 0.0, 0.0, 0.0, 0.0, 0.0],
    "heading": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1e-3],
    "all": [300.0, 200.0, -0.3, 0.2, 5e-5, 1e-4, -1e-3],
}


@pytest.mark.parametrize("trajectory", [TRAJECTORY, CORNER], ids=["straight", "corner"])
@pytest.mark.parametrize("name", ERRORS)
def test_transition_is_what_the_strapdown_does(name, trajectory):
    """Back to all scans for the position, to where the last batch ended for all errors."""
    it, truth = flown(trajectory, ERRORS[name]), flown(trajectory)
    actual = it.error(truth)
    batch = builder_of(it).build(INDEPENDENT)
    predicted = batch.by_error[:, :2] @ actual[-1]
    straight = trajectory is TRAJECTORY
    within = 0.1 if straight else 0.3 + 0.02 * np.abs(predicted - actual[-1, :2]).max()
    np.testing.assert_allclose(predicted, actual[:, :2], atol=within)
    moved = np.abs(actual[:, :2] - actual[-1, :2]).max()
    assert name == "position" or moved > 1.0  # staying put would be wrong
    np.testing.assert_allclose(batch.by_error[-1, :2], np.eye(2, 7), atol=1e-12)
    builder = builder_of(
        Flown(it.position[:20], it.velocity[:20], it.attitude[:20]), batch_length=20, stride=10
    )
    builder.build(INDEPENDENT)
    for t in range(20, 30):
        builder.add_scan(10.0 * (t + 1), *it.position[t], it.velocity[t], 0.0, 1e-5)
    batch = builder.build(INDEPENDENT)
    then = batch.backward[-batch.new - 1] @ actual[-1]
    size = np.array([0.05, 0.05, 1e-3, 1e-3, 2e-7, 2e-7, 2e-7])
    np.testing.assert_allclose((then - actual[19]) / size, 0.0, atol=1.0 if straight else 30.0)


def test_what_xi_explains_and_the_drift_make_up_the_navigators_covariance():
    """Covariance of the errors at the scans, and with xi, as from the joint prior: nothing lost,
    nothing counted twice."""
    prior = random_covariance(PRIOR_SIGMA, 1)
    batch = builder_of(flown(TRAJECTORY)).build(prior)
    back = batch.by_error[:, :2]
    np.testing.assert_array_equal(batch.prior, 0.5 * (prior + prior.T)[:4, :4])
    joint = back @ prior @ back.transpose(0, 2, 1)
    split = batch.transition @ prior[:4, :4] @ batch.transition.transpose(0, 2, 1)
    rest = batch.nuisance[:, :2]
    split += rest @ rest.transpose(0, 2, 1)
    np.testing.assert_allclose(split, joint, rtol=1e-9, atol=1e-6)
    with_xi = batch.transition @ prior[:4, :4], back @ prior[:, :4]
    np.testing.assert_allclose(*with_xi, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("quantity", ["gravity", "disturbance"])
def test_wrong_readings_are_wrong_by_the_jacobian_and_correcting_makes_them_right(quantity):
    reduction = GRAVITY if quantity == "gravity" else DisturbanceReduction()
    it, truth = flown(TRAJECTORY, ERRORS["all"]), flown(TRAJECTORY)
    error = it.error(truth)
    felt = GRAVITY.raw(9.8, truth.state)
    wrong, right = reduction.reduce(felt, it.state), reduction.reduce(felt, truth.state)
    assert np.abs(wrong - right).max() > 2e-5
    builder = builder_of(it, wrong, quantity)
    batch = builder.build(INDEPENDENT)
    by_xi = batch.reading_jacobian @ error[-1, :4] + batch.nuisance[:, 2] @ error[-1, 4:]
    np.testing.assert_allclose(by_xi, wrong - right, atol=3e-7)
    builder.correct(300.0, -error[-1])
    batch = builder.build(random_covariance(PRIOR_SIGMA))
    off = horizontal_difference(batch.latitude, batch.longitude, *truth.position.T)
    np.testing.assert_allclose(off, 0.0, atol=0.1)
    np.testing.assert_allclose(batch.velocity, truth.velocity, atol=2e-3)
    np.testing.assert_allclose(batch.reading, right - 2e-6, atol=3e-7)


def test_batches_hold_context_and_count_what_is_new():
    it = flown(TRAJECTORY, scans=50)
    builder = made_builder(15, batch_length=20, stride=10)
    batches = []
    for t in range(50):
        assert not builder.ready or t == 0
        reading = np.nan if t == 3 else 1e-5 * t
        builder.add_scan(float(t), *it.position[t], it.velocity[t], reading, 1e-5)
        if builder.ready:
            batches.append(builder.build(INDEPENDENT))
            assert batches[-1].time[-1] == t
    assert [len(batch) for batch in batches] == [20, 30, 35, 35]
    assert [batch.time[0] for batch in batches] == [0.0, 0.0, 5.0, 15.0]
    assert [batch.new for batch in batches] == [20, 10, 10, 10]


def test_scans_come_out_as_they_went_in():
    it = flown(TRAJECTORY)
    batch = builder_of(it).build(INDEPENDENT)
    np.testing.assert_array_equal(np.column_stack([batch.latitude, batch.longitude]), it.position)
    np.testing.assert_array_equal(batch.velocity, it.velocity)
    np.testing.assert_array_equal(batch.reading, 1e-5 * np.arange(SCANS) - 2e-6)
    assert (batch.sigma == 1e-5).all()
    assert batch.new == SCANS


def test_soundings_of_several_beams_come_out_less_their_offset():
    it = flown(TRAJECTORY)
    sounder = {"gravimeter": Gravimeter(sigma=1.0), "altimeter": Altimeter(beams=2)}
    builder = BatchBuilder(Scenario(field="terrain", **sounder))
    builder.correct(10.0, np.ones(7))  # of nothing
    for t, (place, speed) in enumerate(zip(it.position, it.velocity, strict=True)):
        heights = np.array([[100.0, 0.0, 0.0, 50.0], [90.0, 30.0, 0.0, 50.0]])
        builder.add_scan(10.0 * (t + 1), *place, speed, heights, 1.0, 7.0)
    batch = builder.build(INDEPENDENT)
    np.testing.assert_array_equal(batch.reading, np.tile([93.0, 83.0], SCANS))


def across_a_gap(before: np.ndarray, after: np.ndarray):
    """A batch of ten scans 10 s apart, with a gap from 42 s to 66 s; the covariances (7, 7) at
    both ends."""
    builder = made_builder(batch_length=10, stride=10)
    it = flown(TRAJECTORY, scans=10)
    for scan in range(10):
        reading = np.nan if scan in (4, 5) else 9.8
        builder.add_scan(10.0 * (scan + 1), *it.position[scan], it.velocity[scan], reading, 1e-5)
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
    shift = builder.collected.scans.latitude[2] - batch.latitude[2]
    assert abs(shift) * 6.36e6 < 0.2 * 8.0 * 70.0


def test_readings_before_a_gap_before_the_last_are_given_up():
    P = random_covariance(PRIOR_SIGMA, 1)
    builder = across_a_gap(P, 4.0 * P)
    builder.bridge(92.0, P, 104.0, 4.0 * P)
    readings = builder.collected.scans.reading
    assert np.isnan(readings[:6]).all()
    assert np.isfinite(readings[6:]).all()
    again = made_builder(batch_length=10, stride=10)
    again.collected = builder.collected
    assert again.build(P).cut == 10


def test_what_errors_of_a_measured_height_change_by_is_not_the_vehicle_s() -> None:
    time, rng = 5.0 * np.arange(30), np.random.default_rng(3)
    barometer = Height(source="barometer", sigma=0.5, weather_sigma=5.0)
    walk = np.cumsum(rng.normal(0.0, math.sqrt(2.0 * 5.0**2 / 7200.0 * 5.0), time.shape))
    errors = walk + 0.3 * rng.standard_normal(time.shape)
    for climbing in (0.0, 2.0):
        seen = of_vehicle(barometer, time, 100.0 + climbing * time + errors)
        np.testing.assert_allclose(np.diff(seen, 2), 0.0, atol=1e-9)  # a straight line
        assert seen[-1] - seen[0] == pytest.approx(climbing * time[-1], abs=2.0)
    dive = -np.clip(time - 60.0, 0.0, 40.0)  # of 40 m, which ends
    assert np.abs(of_vehicle(barometer, time, dive + errors) - dive - errors).max() < 2.0
    known = Height()
    assert of_vehicle(known, time, errors) is errors


def test_changes_of_a_measured_height_may_be_errors_but_not_a_climb() -> None:
    """What readings have beside white noise, per unit of the share that is error: all that the
    height has changed by, but of a climb no more than three 1-sigmas of its errors."""
    sensor = {"source": "barometer", "sigma": 0.3, "bias": 0.0, "scale": 0.0, "weather_sigma": 0.4}
    builder = BatchBuilder(
        Scenario(
            matcher=Matcher(batch_length=5),
            height=Height(**sensor),
            gravimeter=Gravimeter(quantity="disturbance"),
        )
    )
    for t, height in enumerate([100.0, 101.0, 99.0, 200.0, 199.5]):
        place = 10.0 * (t + 1), -0.6, 2.5, np.array([10.0, 10.0])
        builder.add_scan(*place, 0.0, 1e-5, height=height)
    states = builder.build(np.eye(7)).instrument.parameters
    assert states is not None
    column = states.reading[:, states.names.index("height_change")]
    weather = states.reading[:, states.names.index("height_weather")]
    np.testing.assert_allclose(column / weather, [0.0, 1.0, -1.0, 1.5, 1.0], rtol=1e-9)


def test_two_sensors_of_the_height_leave_less_of_their_errors():
    """Readings are off by what the weighted mean of both heights is off by."""
    keys = {"source": "barometer", "bias": 3.0, "scale": 0.0, "weather_sigma": 6.0}
    scenario = Scenario(matcher=Matcher(batch_length=2), height=Height(**keys))
    second = {"name": "aft", "bias": 4.0, "scale": 0.0, "weather_sigma": 0.0}
    both = changed_scenario(scenario, [f"heights=[{second}]"], "test")
    found = []
    for one in (scenario, both):
        builder = BatchBuilder(one)
        for t in range(2):
            builder.add_scan(10.0 * (t + 1), -0.6, 2.5, np.array([10.0, 10.0]), 9.8, 1e-5)
        states = builder.build(np.eye(7)).instrument.parameters
        found.append(dict(zip(states.names, states.sigma, strict=True)))
    assert found[0] == {"height_bias": 3.0, "height_weather": 6.0, "height_change": 1.0}
    assert found[1] == {"height_bias": pytest.approx(2.4), "height_change": 1.0}


SIGMA, SPEED, SPAN = 2e-4, 22.0, 600.0
TIMES = np.arange(0.0, SPAN + 1.0, 20.0)
VELOCITY = np.tile([0.6 * SPEED, 0.8 * SPEED], (len(TIMES), 1))
PRIOR = np.diag([30.0, 30.0, 0.1, 0.1, 1e-5, 1e-5, 1e-4]) ** 2


@pytest.mark.parametrize("length", [6_000.0, 20_000.0, 1e9])
def test_covariance_is_that_of_the_process_integrated(length: float) -> None:
    apart = ResidualGravity(SIGMA, length).apart(VELOCITY, TIMES, SPAN, PRIOR)
    fine = np.linspace(0.0, SPAN, 1201)
    step = fine[1]
    process = SIGMA**2 * np.exp(-np.abs(fine[:, None] - fine) * SPEED / length)
    weight = np.full(len(fine), step)
    weight[[0, -1]] = step / 2.0
    later = np.maximum(fine - TIMES[:, None], 0.0)
    moves = np.concatenate([later * weight, -np.sign(later) * weight])  # position, velocity
    expected = moves @ process @ moves.T
    scale = np.sqrt(np.diag(expected).reshape(2, -1).max(axis=1)).repeat(len(TIMES))
    for axis in range(2):
        root = np.concatenate([apart[:, axis], apart[:, 2 + axis]])
        np.testing.assert_allclose(
            root @ root.T / scale / scale[:, None], expected / scale / scale[:, None], atol=0.02
        )
    assert not (apart[:, 0] * apart[:, 1]).any()
    assert not apart[:, 4:].any()
    assert not apart[-1].any()
    # what is too small to matter is left out
    small = ResidualGravity(0.05 * SIGMA, length)
    assert small.apart(VELOCITY, TIMES, SPAN, PRIOR).shape == (31, 7, 0)
    assert small.apart(VELOCITY, TIMES, SPAN, PRIOR / 100.0).shape[2] > 0


def build(sigma: float):
    builder = made_builder(10, batch_length=20, stride=10)
    gravity = ResidualGravity(sigma, 20_000.0)
    builder.collected = replace(builder.collected, gravity=gravity)
    for k, (time, velocity) in enumerate(zip(TIMES, VELOCITY, strict=True)):
        builder.add_scan(time, -0.6, 2.4 + 1e-7 * time, velocity, 0.0, 1e-5)
        if k == 20:
            builder.build(PRIOR)
    return builder.build(PRIOR)


def test_a_batch_has_it_beside_the_attitude() -> None:
    without, batch = build(0.0), build(SIGMA)
    assert without.nuisance.shape[2] == 3
    count = batch.nuisance.shape[2]
    assert count > 3
    np.testing.assert_array_equal(batch.nuisance[..., :3], without.nuisance)
    # the first scan is 580 s before the end: half of that squared, 34 m, a little less for the
    # process does not stay as it is
    moved = np.sqrt((batch.nuisance[0, :2, 3:] ** 2).sum(axis=1))
    np.testing.assert_allclose(moved, 0.5 * SIGMA * 580.0**2, rtol=0.15)


def test_batches_go_by_the_map_error_that_a_fix_tells() -> None:
    def fresh() -> MapMatching:
        return MapMatching(Scenario(), [MAP], gravity=known)

    known = KnownGravity(residual=Residual(0.0, 1.0), map_sigma=2e-5)
    matching = fresh()
    first = matching.collected[0].gravity
    assert first == ResidualGravity.of(known)
    fix = Fix(0.0, 0.0, 0.0, np.eye(2))
    matching._learn(fix)
    assert matching.collected[0].gravity == first
    matching._learn(replace(fix, map_error=(8e-5, 3e3)))
    learnt = matching.collected[0].gravity
    assert learnt == ResidualGravity(pytest.approx(np.hypot(8e-5 / np.sqrt(2.0), 1e-6)), 3e3)
    again = fresh()
    again.restore(matching.collected)  # a checkpoint keeps it
    again.forget_scans()
    assert again.collected[0].gravity == learnt
    again.begin_anew()
    assert again.collected[0].gravity == first


START = tuple(np.degrees(ORIGIN))
BENT = {
    "waypoints": [
        [*START, 22.0],
        [START[0] + 0.05, START[1] + 0.05, 22.0],
        [START[0] + 0.02, START[1] + 0.16, 22.0],
    ],
    "duration": 700.0,
}
MAP = field_map_of(wavy)
WIDE_PRIOR = np.diag(np.array([200.0, 200.0, 0.1, 0.1, 5e-5, 5e-5, 5e-4]) ** 2)


def scenario(route=BENT, **keys):
    return Scenario(
        route=route, gravimeter=Gravimeter(quantity="disturbance", sigma=1e-12, **keys)
    )


def batch_of(it, scans=60, error=(0.0, 0.0), told=True, matcher="pmht"):
    """The batch of a navigator that knows its state, or is wrong by a constant (m)."""
    trajectory = build_trajectory(it)
    simulator = ReadingSimulator(it, trajectory, MAP, [0])
    reduction = DISTURBANCE.reduction(it)
    instrument = it.gravimeter if told else scenario().gravimeter
    builder = made_builder(gravimeter=instrument, name=matcher, batch_length=40)
    metres = horizontal_difference(ORIGIN[0] + 1e-5, ORIGIN[1] + 1e-5, *ORIGIN) / 1e-5
    for j in range(scans):
        i = simulator.index[j]
        at = State(
            trajectory.latitude[i] + error[0] / metres[0],
            trajectory.longitude[i] + error[1] / metres[1],
            trajectory.height[i],
            *trajectory.velocity[i, :2],
        )
        reading = reduction.reduce(simulator.raw[0, j], at)
        builder.add_scan(
            trajectory.time[i], at.latitude, at.longitude, trajectory.velocity[i, :2],
            float(reading), 1e-6, height=at.height,
        )  # fmt: skip
    return builder.build(WIDE_PRIOR), trajectory


@pytest.mark.parametrize(("delay", "filter_time"), [(20.0, 0.0), (13.0, 0.0), (0.0, 20.0),
                                                    (20.0, 30.0)])  # fmt: skip
def test_a_late_reading_is_the_map_s_value_where_the_vehicle_was(delay, filter_time):
    """Of a matcher without filters: where it was in the mean."""
    it = scenario(delay=delay, filter_time=filter_time)
    batch, trajectory = batch_of(it, matcher="sitan")
    assert len(batch) == 40
    then = batch.time - delay - filter_time
    where = [
        np.interp(then, trajectory.time, values)
        for values in (trajectory.latitude, trajectory.longitude)
    ]
    assert np.abs(horizontal_difference(batch.latitude, batch.longitude, *where)).max() < 2.0
    assert batch.end == (trajectory.latitude[600], trajectory.longitude[600])
    along = MAP.value(trajectory.latitude, trajectory.longitude)
    smooth = low_pass(along, float(np.diff(trajectory.time)[0]), filter_time)
    residual = batch.reading - np.interp(batch.time - delay, trajectory.time, smooth)
    assert np.isfinite(residual).all()
    scale = np.abs(batch.reading - MAP.value(batch.latitude, batch.longitude)).max()
    if filter_time:
        assert scale > 5e-6  # the filter matters here
    turning = np.abs(np.gradient(batch.velocity, axis=0)).max(axis=1) > 0.05
    turning |= np.convolve(turning, np.ones(15), "full")[:40] > 0  # what a filter remembers
    assert 15 < turning.sum() < 30
    assert np.abs(residual[~turning]).max() < 1e-7
    # the Eötvös acceleration changes by 70 mGal in the turn, which begins between two scans
    assert np.abs(residual).max() < (1e-5 if filter_time else 2e-5)
    other, _ = batch_of(it)  # of one with filters: where it was a delay ago
    where = [
        np.interp(other.time - delay, trajectory.time, values)
        for values in (trajectory.latitude, trajectory.longitude)
    ]
    assert np.abs(horizontal_difference(other.latitude, other.longitude, *where)).max() < 2.0
    assert other.instrument.filter_time == filter_time


def test_rows_have_what_a_delay_nobody_tells_of_does_in_a_turn():
    """70 mGal are added more, or less, after the turn; a straight line into the past is 100 m
    off."""
    batch, _ = batch_of(scenario(delay=20.0), told=False)
    states = States.of(batch, MAP)
    rows, _ = rows_of(batch, MAP, states, np.array([4000.0]), None)
    assert rows is not None

    def foretold(age):
        place = zip(rows.latitude, rows.longitude, strict=True)
        return [sensed(MAP.grid, rows.past, t, *at, 0, age)[0] for t, at in enumerate(place)]

    residual = rows.level - foretold(20.0)
    assert np.abs(residual).max() < 2e-5
    assert np.median(np.abs(residual)) < 1e-7
    assert np.abs(rows.level - foretold(0.0)).max() > 2e-4
    assert np.abs(residual).max() < 0.2 * np.abs(rows.level - foretold(15.0)).max()


def test_the_posterior_is_at_the_navigator_s_error():
    """Late, filtered or both: also far from where the navigator believes to be, where no straight
    line stands for the map."""
    for keys in ({"delay": 20.0}, {"delay": 5.0, "filter_time": 20.0}, {"filter_time": 30.0}):
        error = np.array([400.0, -300.0])
        batch, _ = batch_of(scenario(**keys), error=error)
        fix, _ = Pmht.from_settings(Matcher(map_sigma=0.0)).match(batch, MAP, None)
        assert fix.published, fix.reason
        seen = -horizontal_difference(fix.latitude, fix.longitude, *batch.end)
        assert np.abs(seen - error).max() < 20.0
        assert np.sqrt(np.trace(fix.covariance)) < 40.0


def test_map_error_between_scans_is_a_gauss_markov_process():
    it = scenario(route={"start": START, "end": (-36.4, 147.2), "duration": 200.0})
    it = it.model_copy(update={"map_error": MapError(sigma=1.0, correlation_length=500.0)})
    trajectory = build_trajectory(it)
    runs = 4000
    step = np.exp(-220.0 / 500.0)
    random = np.random.default_rng(2)
    at_scans = np.empty((runs, 20))
    at_scans[:, 0] = random.standard_normal(runs)
    for k in range(1, 20):
        fresh = np.sqrt(1.0 - step**2) * random.standard_normal(runs)
        at_scans[:, k] = step * at_scans[:, k - 1] + fresh
    drawn = TrueMapError(it, trajectory, np.arange(10, 201, 10), range(runs))
    error = drawn.between(at_scans)
    np.testing.assert_array_equal(error[:, 10:201:10], at_scans)
    which = [0, 3, 10, 14, 17, 25, 61]
    distance = 22.0 * np.abs(np.subtract.outer(which, which))
    measured = error[:, which].T @ error[:, which] / runs
    np.testing.assert_allclose(measured, np.exp(-distance / 500.0), atol=5.0 * np.sqrt(2 / runs))


@given(most=st.integers(1, 7), added=st.integers(1, 40), channels=st.integers(1, 2))
def test_the_last_scans_are_kept_in_their_order(most: int, added: int, channels: int) -> None:
    scans = Scans.none((channels, 2))
    for k in range(added):
        reading = np.arange(2.0 * channels).reshape(channels, 2) + k if k % 2 else np.nan
        scans = scans.added(
            most, 10.0 * k, -0.6, 2.5, np.array([10.0, -k]), reading, 1.0, 0.5 * k, 100.0, 0.0
        )
    kept = np.arange(added)[-most:]
    np.testing.assert_array_equal(scans.time, 10.0 * kept)
    np.testing.assert_array_equal(scans.velocity, np.stack([0.0 * kept + 10.0, -kept], axis=1))
    np.testing.assert_array_equal(scans.offset, 0.5 * kept)
    each = np.arange(2.0 * channels).reshape(channels, 2) + kept[:, None, None]
    np.testing.assert_array_equal(
        scans.reading, np.where(kept[:, None, None] % 2 == 1, each, np.nan)
    )
