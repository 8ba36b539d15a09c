"""Prediction by the filter: against plain NumPy and filterpy, auxiliary states, consistency,
failures, and what is assumed."""

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from helpers.batches import field_map_of, wavy
from helpers.navigators import (
    SIGMA,
    assert_close,
    error_between,
    fly,
    identical,
    random_covariance,
    start_of,
)
from helpers.statistics import within_chi_square
from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE, radii
from isogal.earth.frames import horizontal_difference
from isogal.earth.gravity import normal_gravity
from isogal.evaluation.bound import unaided_covariance
from isogal.fields.known_gravity import KnownGravity
from isogal.fusion.assumed import filter_model
from isogal.fusion.auxiliary import AuxiliaryState
from isogal.fusion.clone import Clone
from isogal.fusion.imu_states import states
from isogal.fusion.measurements import HeightReading, PositionFix
from isogal.fusion.model import FilterModel
from isogal.fusion.prediction import FilterDivergenceError, propagate
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.gravity import compensation_by
from isogal.inertial.strapdown import propagate as propagate_ins
from isogal.maps.channels import ChannelMap
from isogal.scenario import (
    Height,
    Imu,
    Route,
    Scenario,
    Velocity,
    load_scenario,
)
from isogal.seeds import generator
from isogal.sensors.imu import simulate_imu
from isogal.sensors.imu_model import bias_sigma
from isogal.sensors.trajectory import build_trajectory


def _rates(latitude: Array, height: Array, velocity: Array) -> tuple[Array, Array]:
    """Earth rate and transport rate (P, 3), NED, rad/s (Groves 2013, eqs. 5.41, 5.44)."""
    meridian, normal = radii(latitude)
    earth = EARTH_RATE * np.stack([np.cos(latitude), 0 * latitude, -np.sin(latitude)], axis=-1)
    north, east = velocity[:, 0] / (meridian + height), velocity[:, 1] / (normal + height)
    return earth, np.stack([east, -north, -east * np.tan(latitude)], axis=-1)


def strapdown(state: Estimate, force: Array, rate: Array, dt: float) -> Estimate:
    """One interval for P points, whose attitudes are matrices body to NED (P, 3, 3), with mean
    specific force and angular rate (P, 3), body axes: written after the books, not after the
    compiled functions."""
    latitude, longitude, height = state.position.T
    u = np.einsum("pij,pj->pi", state.attitude, force) * dt
    a = np.einsum("pij,pj->pi", state.attitude, rate) * dt
    down = np.array([0.0, 0.0, 1.0])

    earth, transport = _rates(latitude, height, state.velocity)
    coriolis = np.cross(2 * earth + transport, state.velocity)
    middle = state.velocity + 0.5 * (
        u + dt * (normal_gravity(latitude, height)[:, None] * down - coriolis)
    )
    mean_velocity = 0.5 * (state.velocity + middle)
    half_way = latitude + 0.5 * dt * mean_velocity[:, 0] / (radii(latitude)[0] + height)
    height_half_way = height - 0.5 * dt * mean_velocity[:, 2]

    earth, transport = _rates(half_way, height_half_way, middle)
    z = (earth + transport) * dt
    au, zu = np.cross(a, u), np.cross(z, u)
    increment = u + 0.5 * (au - zu) + (np.cross(a, au) + np.cross(z, zu)) / 6 - np.cross(z, au) / 3
    gravity = normal_gravity(half_way, height_half_way)[:, None] * down
    velocity = (
        state.velocity + increment + dt * (gravity - np.cross(2 * earth + transport, middle))
    )

    moved = 0.5 * dt * (state.velocity + velocity)
    meridian, normal = radii(half_way)
    position = np.stack(
        [
            latitude + moved[:, 0] / (meridian + height_half_way),
            longitude + moved[:, 1] / ((normal + height_half_way) * np.cos(half_way)),
            height - moved[:, 2],
        ],
        axis=-1,
    )
    az = np.cross(a, z)
    attitude = (
        Rotation.from_rotvec(a - z + az / 2 - np.cross(a, az) / 6).as_matrix() @ state.attitude
    )
    return Estimate(position, velocity, attitude)


def random_estimates(random: np.random.Generator, count: int) -> Estimate:
    position = random.uniform([-1.3, -3.0, -4e3], [1.3, 3.0, 9e3], (count, 3))
    velocity = random.uniform(-200.0, 200.0, (count, 3))
    return Estimate(position, velocity, Rotation.random(count, random).as_quat(scalar_first=True))


def matrices(nav: Estimate) -> np.ndarray:
    return Rotation.from_quat(nav.attitude, scalar_first=True).as_matrix()


@pytest.mark.parametrize("dt", [1.0, 0.01])
def test_strapdown_step_equals_reference(dt: float) -> None:
    random = np.random.default_rng(1)
    nav = random_estimates(random, 200)
    force, rate = random.normal(0.0, 10.0, (200, 1, 3)), random.normal(0.0, 0.2, (200, 1, 3))
    end, _ = propagate_ins(nav, force, rate, dt)
    start = Estimate(nav.position, nav.velocity, matrices(nav))
    expected = strapdown(start, force[:, 0], rate[:, 0], dt)
    apart = (end.position - expected.position) * [6.4e6, 6.4e6, 1.0]
    np.testing.assert_allclose(apart, 0.0, atol=1e-8)
    np.testing.assert_allclose(end.velocity, expected.velocity, rtol=0, atol=1e-8)
    np.testing.assert_allclose(matrices(end), expected.attitude, rtol=0, atol=1e-14)


def filter_start(random: np.random.Generator, sigma: np.ndarray, seed: int) -> FilterState:
    """Return a state with a full, well-scaled random covariance."""
    nav = random_estimates(random, 1)
    return FilterState(
        np.array([*nav.position[0, :2], 100.0]),
        np.array([*nav.velocity[0, :2], 0.0]),
        nav.attitude[0],
        random.normal(0.0, 1e-5, 3),
        random.normal(0.0, 1e-8, 3),
        np.zeros(0),
        random_covariance(sigma, seed),
        np.zeros(2),
    )


@pytest.mark.parametrize(
    ("heading", "alpha"),
    [(1e-3, 1.0), (1e-3, 0.5), (0.4, 1.0)],
    ids=["default", "other weights", "unknown heading"],
)
def test_filter_equals_reference(heading: float, alpha: float) -> None:
    """Also where the heading is unknown to 0.4 rad: points 1.5 rad apart."""
    random, steps, sigma = np.random.default_rng(2), 4, SIGMA.copy()
    sigma[8] = heading
    noise = (8e-5, 7e-5, 1e-2, 5e-9, 6e-9, 1.5e-7)
    model = FilterModel(noise, tuple(sigma), 1.0, 0.1, alpha)
    for seed in range(5):
        start = filter_start(random, sigma, seed)
        force = random.normal(0.0, 10.0, (steps, 3))
        rate = random.normal(0.0, 0.02, (steps, 3))
        height = 100.0 + random.normal(0.0, 0.5, steps)
        if heading > 0.1:
            # the reference adds the prediction's mean and the height's correction at once, which
            # is not the same for a large turn
            height[:] = np.nan
        compiled, by_filterpy = start.copy(), start.copy()
        for one in (compiled, by_filterpy):
            one.clone = Clone.of(one.covariance)
        track = propagate(compiled, model, force, rate, height)
        theirs = propagate(by_filterpy, replace(model, filter="reference"), force, rate, height)
        assert_close(compiled, by_filterpy, 1e-8, 2e-8)
        for ours, other in zip(compiled.clone, by_filterpy.clone, strict=True):
            unit = sigma if ours.ndim == 1 else np.outer(sigma, sigma)
            np.testing.assert_allclose(ours / unit, other / unit, atol=1e-6)
        np.testing.assert_array_equal(track[-1, :10], np.concatenate(compiled.estimate))
        np.testing.assert_allclose(track, theirs, rtol=1e-6, atol=1e-6)


# The filter is compiled for each number of states, ten seconds each: eight auxiliary states, as
# with a barometer and a log, and two, as where the map says its error, are compiled anyway.
EVERY_KIND = (
    AuxiliaryState("gravity_north", "gravity", 0, 2e-4, length=8e3),
    AuxiliaryState("gravity_down", "gravity", 2, 3e-4, length=9e3, time=900.0),
    AuxiliaryState("accelerometer_y", "accelerometer", 1, 1e-4, time=300.0),
    AuxiliaryState("gyroscope_x", "gyroscope", 0, 1e-7, time=600.0, walk=1e-10),
    AuxiliaryState("gyroscope_scale_z", "gyroscope_scale", 2, 1e-3),
    AuxiliaryState("barometer_bias", "none", 0, 5.0, walk=0.1),
    AuxiliaryState("gyroscope_misalignment", "gyroscope_scale", 0, 1e-5, source=2),
    AuxiliaryState("accelerometer_misalignment", "accelerometer_scale", 1, 1e-5, source=0),
)
SPARE = AuxiliaryState("spare", "none", 0, 1.0)
"""Does nothing."""
MAP = field_map_of(wavy)


def with_states(states, filter_name="compiled") -> FilterModel:
    plain = fly().model
    return dataclasses.replace(plain, auxiliary=tuple(states), filter=filter_name)


def start(model: FilterModel, seed: int = 3) -> FilterState:
    """A start with a full covariance, and auxiliary states that are not zero."""
    plain = fly().start
    sigma = np.array([*SIGMA, *(state.sigma for state in model.auxiliary)])
    means = sigma[15:] * np.random.default_rng(seed).standard_normal(len(sigma) - 15)
    return dataclasses.replace(plain, auxiliary=means, covariance=random_covariance(sigma, seed))


OF_A_MAP = KnownGravity(
    compensation_by(ChannelMap((MAP, field_map_of(lambda north, east: wavy(-east, north)))), 1.0)
)


@pytest.mark.parametrize(
    ("count", "gravity"), [(2, KnownGravity()), (8, KnownGravity()), (2, OF_A_MAP)]
)
def test_every_kind_equals_a_filter_with_sigma_points_for_all_states(count, gravity):
    flight = fly()
    force, rate, height = flight.samples(0, 20)
    force = force + np.array([0.5, 0.0, 0.0])  # scale factors have something to act on
    rate = rate + np.array([0.0, 0.0, 0.01])
    ends = []
    for name in ("compiled", "reference"):
        model = dataclasses.replace(with_states(EVERY_KIND[:count], name), gravity=gravity)
        state = start(model)
        propagate(state, model, force, rate, height)
        ends.append(state)
    assert not np.array_equal(ends[0].position, ends[1].position)  # two filters, not one
    # the columns of auxiliary states leave out what a turning body does within a second
    assert_close(*ends, 1.2e-4, 1.2e-4)


@pytest.mark.parametrize("filter_name", ["compiled", "reference"])
def test_gravity_states_go_by_what_has_been_learnt(filter_name):
    """A navigator whose residual gravity was learnt propagates as under a model that knows it; one
    of which nothing was learnt as under its own."""
    assumed = (AuxiliaryState("gravity_north", "gravity", 0, 2e-5, length=4e3), SPARE)
    true = (AuxiliaryState("gravity_north", "gravity", 0, 2e-4, length=9e3), SPARE)
    flight, ends = fly(), []
    for each, residual in ((assumed, (2e-4, 9e3)), (true, (0.0, 0.0)), (assumed, (0.0, 0.0))):
        state = start(with_states(assumed))
        state.residual_gravity[:] = residual
        propagate(state, with_states(each, filter_name), *flight.samples(0, 20))
        ends.append(state)
    learnt, known, plain = ends
    assert known.covariance[15, 15] > 1.5 * plain.covariance[15, 15]
    np.testing.assert_array_equal(learnt.covariance, known.covariance)
    np.testing.assert_array_equal(learnt.position, known.position)


@pytest.mark.parametrize("filter_name", ["compiled", "reference"])
def test_no_place_is_learnt_from_slopes_of_the_gravity_map(filter_name):
    """A navigator that does not know its place takes off gravity of elsewhere, which a velocity
    aid would show: what is left may be so much more, and says nothing of the place."""
    left = AuxiliaryState("gravity_north", "gravity", 0, 1e-6, length=4e3)
    flight, ends = fly(), []
    for gravity, sigma in ((OF_A_MAP, 3e3), (KnownGravity(), 3e3), (OF_A_MAP, 3.0)):
        model = dataclasses.replace(with_states((left, SPARE), filter_name), gravity=gravity)
        state = start(model)
        state.covariance[:] = np.diag([*SIGMA, 1e-6, 1.0]) ** 2
        state.covariance[[0, 1], [0, 1]] = sigma**2
        propagate(state, model, *flight.samples(0, 20))
        ends.append(state.covariance)
    lost, without, known = ends
    apart = np.sqrt(without[0, 0] * without[3, 3])
    assert lost[0, 3] == pytest.approx(without[0, 3], abs=1e-3 * apart)
    assert lost[15, 15] > 100.0 * without[15, 15]
    assert known[15, 15] == pytest.approx(without[15, 15], rel=0.1)


def test_errors_agree_with_their_covariance():
    """Normalised squared errors of 60 flights of half an hour with a fix every 5 min: chi-square,
    99.9 %."""
    runs, random = 60, np.random.default_rng(8)
    R = np.array([[90.0**2, 2000.0], [2000.0, 60.0**2]])
    # the vertical channel is aided better than assumed
    keep = np.array([0, 1, 3, 4, 6, 7, 8, 9, 10, 12, 13, 14])
    sensors = Scenario().imu.sensors
    sigma = np.array([*sensors.accelerometer.bias, *sensors.gyroscope.bias])
    fix_nis, total = [], 0.0
    for run in range(runs):
        flight = fly(run, route=Route(duration=1800.0))
        state, truth = flight.start, flight.trajectory
        for stamp in range(300, 1801, 300):
            propagate(state, flight.model, *flight.samples(stamp - 300, stamp))
            if stamp < 1800:
                fix = flight.fix(stamp, *(np.linalg.cholesky(R) @ random.standard_normal(2)))
                fix_nis.append(PositionFix(*fix, R).update(state, flight.model).nis)
        bias = sigma * generator(0, run, "imu_bias").standard_normal(6)
        true = state.copy()
        true.position[:] = truth.latitude[-1], truth.longitude[-1], 100.0
        true.velocity[:], true.attitude[:] = truth.velocity[-1], truth.attitude[-1]
        true.accelerometer_bias[:], true.gyroscope_bias[:] = bias[:3], bias[3:]
        error = error_between(state, true)[keep]
        total += error @ np.linalg.solve(state.covariance[np.ix_(keep, keep)], error)
    assert within_chi_square(total, len(keep) * runs), total / (len(keep) * runs)
    assert within_chi_square(np.sum(fix_nis), 2 * len(fix_nis)), np.mean(fix_nis) / 2.0


def test_covariance_stays_symmetric_positive_definite_through_hours():
    flight = fly(route=Route(), imu=Imu(grade="quantum"))
    state = flight.start
    for stamp in range(0, len(flight.trajectory), 1620):
        propagate(state, flight.model, *flight.samples(stamp, stamp + 1620))
        covariance = state.covariance
        assert (covariance == covariance.T).all()
        deviation = np.sqrt(np.diag(covariance))
        assert np.linalg.eigvalsh(covariance / deviation / deviation[:, None])[0] > 1e-9
        # a fix to the metre after kilometres: the hardest update for positive definiteness
        PositionFix(*flight.fix(stamp + 1620, 0.0, 0.0), np.eye(2)).update(state, flight.model)
        np.linalg.cholesky(state.covariance)
    assert flight.trajectory.time[-1] == 3.6 * 3600.0


@pytest.mark.parametrize("filter_", ["compiled", "reference"])
def test_a_covariance_that_is_not_positive_definite_is_reported(filter_):
    flight = fly(fusion={"filter": filter_})
    state = flight.start.copy()
    state.covariance[0, 1] = state.covariance[1, 0] = 2.0 * state.covariance[0, 0]
    with pytest.raises(FilterDivergenceError, match="not positive definite"):
        propagate(state, flight.model, *flight.samples(0, 5))
    flight.force[1, 0] = np.nan
    with pytest.raises(FilterDivergenceError, match="not positive definite"):
        propagate(flight.start, flight.model, *flight.samples(0, 5))


def test_sensors_without_a_bias_have_a_covariance_that_is_positive_definite():
    """`imu.gyroscope.bias=0` and the like."""
    none = {"bias": 0.0, "bias_instability": 0.0, "scale_factor": 0.0, "misalignment": 0.0}
    for imu in ({"gyroscope": none}, {"accelerometer": none, "gyroscope": none}):
        flight = fly(imu=Imu.model_validate(imu))
        propagate(flight.start, flight.model, *flight.samples(0, 5))
        np.linalg.cholesky(flight.start.covariance)


BAROMETER = Height(source="barometer", bias=6.0, scale=0.02, weather_sigma=4.0)
LOG = Velocity(kind="dvl", current_sigma=0.3)


@pytest.mark.parametrize("filter_", ["compiled", "reference"])
def test_heights_with_the_inertial_data_equal_readings_of_their_own(filter_):
    """Propagation with a reading at its end against propagation without, then the reading."""
    flight = fly(height=BAROMETER, velocity=LOG, fusion={"filter": filter_})
    force, rate, _ = flight.samples(0, 3)
    inside, after = flight.start.copy(), flight.start.copy()
    propagate(inside, flight.model, force, rate, np.array([np.nan, np.nan, 107.0]))
    propagate(after, flight.model, force, rate, np.full(3, np.nan))
    HeightReading(107.0, BAROMETER.sigma**2).update(after, flight.model)
    assert_close(inside, after, 1e-6, 1e-7)
    # beyond the gate, once the height is known
    wrong, without = inside.copy(), inside.copy()
    propagate(wrong, flight.model, force[:1], rate[:1], np.array([10e3]))
    propagate(without, flight.model, force[:1], rate[:1], np.array([np.nan]))
    assert identical(wrong, without)


def test_turn_rate_is_relative_to_the_earth():
    """Level on a meridian, nose north: the Earth's rate is along the nose and upwards."""
    state = fly().start
    state.attitude[:], state.gyroscope_bias[:] = [1.0, 0.0, 0.0, 0.0], [1e-6, 2e-6, 3e-6]
    latitude = state.position[0]
    of_earth = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    measured = np.array([0.1, 0.2, 0.3]) + of_earth + [1e-6, 2e-6, 3e-6]
    np.testing.assert_allclose(state.turn_rate(measured), [0.1, 0.2, 0.3], rtol=1e-12)


ROUND = (
    "[[-36,146,30],[-36.0,146.2,30],[-36.1,146.2,30],[-36.1,146.0,30],[-36.0,146.0,30],"
    "[-36.0,146.2,30]]"
)
RUNS = 40


def test_states_are_those_of_the_data_sheet():
    made = {state.name: state for state in states(Imu(grade="tactical").sensors)}
    assert len(made) == 6 + 3 + 2
    in_run = made["gyroscope_in_run_z"]
    assert (in_run.enters, in_run.axis, in_run.time) == ("gyroscope", 2, 100.0)
    assert in_run.sigma == pytest.approx(0.35 * np.pi / 180.0 / 3600.0)
    tilt = made["gyroscope_scale_yz"]
    assert (tilt.enters, tilt.axis, tilt.source) == ("gyroscope_scale", 1, 2)
    assert tilt.sigma == pytest.approx(20.0 * np.pi / 648000.0)


def test_what_a_level_vehicle_feels_all_the_time_is_a_bias():
    imu = Imu(
        accelerometer={"misalignment": "20arcsec", "scale_factor": "100ppm"},
        gyroscope={"g_sensitivity": "0.1deg/h/g"},
    )
    sigma = bias_sigma(imu.sensors)
    np.testing.assert_allclose(sigma[:2], 9.80665 * 20.0 * np.pi / 648000.0, rtol=1e-4)
    assert sigma[2] == pytest.approx(9.80665e-4)
    np.testing.assert_allclose(sigma[3:], np.radians(0.1) / 3600.0, rtol=1e-3)


def unaided(scenario, model):
    """Sum of the NEES of all runs at the end of the route, without aiding, and the RMS error."""
    trajectory, runs = build_trajectory(scenario), list(range(RUNS))
    imu = simulate_imu(scenario, trajectory, runs)
    place, errors, covariances = (trajectory.latitude[-1], trajectory.longitude[-1]), [], []
    for run in runs:
        state = FilterState.start(start_of(scenario, trajectory, run), model)
        samples = imu.specific_force[run], imu.angular_rate[run], trajectory.height[1:]
        propagate(state, model, *samples)
        errors.append(horizontal_difference(*state.position[:2], *place))
        covariances.append(state.covariance[:2, :2])
    error, P = np.array(errors), np.array(covariances)
    nees = np.einsum("ri,ri->", error, np.linalg.solve(P, error[..., None])[..., 0])
    return nees, np.sqrt((error**2).sum(axis=-1).mean()), np.sqrt(np.trace(P.mean(axis=0)))


def test_consistent_with_states_of_misalignment_in_turns_and_not_without_them():
    """Without them they stay, with next to nothing, since the filter is compiled for each number
    of states."""
    keys = "route.duration=2000.0", "gravity.field=normal", "imu.grade=navigation"
    scenario = load_scenario(None, [*keys, f"route.waypoints={ROUND}"])
    model = filter_model(scenario)
    nees, rms, claimed = unaided(scenario, model)
    assert within_chi_square(nees, 2 * RUNS), nees / 2 / RUNS
    assert claimed == pytest.approx(rms, rel=0.25)
    # the bound's model has the same states
    bound = unaided_covariance(scenario.true, build_trajectory(scenario))
    assert float(bound.rms_at(np.array([2000.0]))[0]) == pytest.approx(claimed, rel=0.03)
    across = [one.source not in (None, one.axis) for one in model.auxiliary]
    assert sum(across) == 2
    nothing = tuple(
        replace(one, sigma=1e-6 * one.sigma) if off else one
        for one, off in zip(model.auxiliary, across, strict=True)
    )
    assert not within_chi_square(unaided(scenario, replace(model, auxiliary=nothing))[0], 2 * RUNS)
