"""What the gravimeter feels, its reductions and their derivatives; noise, outliers and map error of the simulated one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import chi2

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.earth.gravity import FREE_AIR, eotvos, normal_gravity
from isogal.errors import InputError
from isogal.scenario import Gravimeter, MapError, Route, Scenario
from isogal.sensors.gravimeter import (
    GravimeterSimulator,
    draw_map_error,
    felt_gravity,
    reading_jacobian,
    reduce_disturbance,
    reduce_gravity,
    reduction_variance,
)
from isogal.sensors.trajectory import build_trajectory

latitudes = st.floats(-1.4, 1.4)
speeds = st.floats(-100.0, 100.0)


@given(st.floats(9.7, 9.9), latitudes, st.floats(0.0, 9e3), speeds, speeds)
def test_reductions_with_the_true_state_undo_what_is_felt(gravity, latitude, height, north, east):
    felt = felt_gravity(gravity, latitude, height, north, east)
    assert reduce_gravity(felt, latitude, height, north, east) == pytest.approx(gravity, abs=1e-14)
    disturbance = reduce_disturbance(felt, latitude, height, north, east)
    assert disturbance == pytest.approx(gravity - normal_gravity(latitude), abs=1e-14)


def test_felt_gravity_in_numbers():
    # SCIENCE 1: 31 mGal less 100 m up; about 220 mGal less on the default course, as going east lightens
    still = felt_gravity(9.8, -0.64, 100.0, 0.0, 0.0)
    assert (still - 9.8) / 1e-5 == pytest.approx(-30.86)
    course = np.radians(57.0)
    moving = felt_gravity(9.8, -0.64, 100.0, 22.0 * np.cos(course), 22.0 * np.sin(course))
    assert (moving - still) / 1e-5 == pytest.approx(-220.0, abs=10.0)


@pytest.mark.parametrize(("quantity", "reduce"), [("gravity", reduce_gravity), ("disturbance", reduce_disturbance)])
@given(latitudes, speeds, speeds)
def test_reading_jacobian_against_finite_differences(quantity, reduce, latitude, north, east):
    felt = felt_gravity(9.8, latitude, 0.0, north, east)
    jacobian = reading_jacobian(quantity, latitude, north, east)
    per_metre = 1.0 / metres_per_radian(latitude)[0]
    for i, (d_lat, d_lon, d_north, d_east) in enumerate(np.diag([100.0 * per_metre, 1e-5, 0.1, 0.1])):
        ends = [
            reduce(felt, latitude + sign * d_lat, 0.0, north + sign * d_north, east + sign * d_east) for sign in (1, -1)
        ]
        step = [100.0, 1.0, 0.1, 0.1][i]
        difference = (ends[0] - ends[1]) / (2.0 * step)
        assert d_lon == 0.0 or difference == 0.0  # the longitude does not enter
        # in m/s² over 1 km or 1 m/s the formula leaves out less than 1e-3 mGal (change of the radii with latitude)
        assert jacobian[i] * 10.0 * step == pytest.approx(difference * 10.0 * step, abs=1e-8)


def test_jacobian_of_other_quantities_is_zero_and_arrays_broadcast():
    assert not reading_jacobian("magnetic", np.full(3, 0.5), np.ones(3), np.ones(3)).any()
    assert reading_jacobian("gravity", np.full((2, 3), 0.5), 10.0, 5.0).shape == (2, 3, 4)


@pytest.mark.parametrize("quantity", ["gravity", "disturbance"])
def test_reduction_variance_is_that_of_drawn_navigator_errors(quantity):
    random = np.random.default_rng(4)
    latitude, north, east, height_sigma, draws = -0.64, 12.0, 18.4, 2.0, 20000
    root = np.diag([2000.0, 500.0, 0.05, 0.08]) @ (np.eye(4) + 0.3 * random.standard_normal((4, 4)))
    error = random.standard_normal((draws, 4)) @ root.T
    height = height_sigma * random.standard_normal(draws)
    felt = felt_gravity(9.8, latitude, 100.0, north, east)
    reduce = reduce_gravity if quantity == "gravity" else reduce_disturbance
    estimate = latitude + error[:, 0] / metres_per_radian(latitude)[0]
    readings = reduce(felt, estimate, 100.0 + height, north + error[:, 2], east + error[:, 3])
    variance = reduction_variance(quantity, latitude, north, east, root @ root.T, height_sigma**2)
    low, high = chi2.ppf([0.0005, 0.9995], draws - 1) / (draws - 1)
    assert low < readings.var(ddof=1) / variance < high
    alone = reduction_variance(quantity, latitude, north, east, np.zeros((4, 4)), height_sigma**2)
    assert alone == pytest.approx((FREE_AIR * height_sigma) ** 2)


def scenario(**keys):
    route = Route(start=tuple(np.degrees(ORIGIN)), end=(-36.4, 147.2), duration=600.0)
    return Scenario(**({"route": route, "gravimeter": Gravimeter(sigma=2e-5)} | keys))


def simulate(runs, field_map, **keys):
    it = scenario(**keys)
    trajectory = build_trajectory(it)
    simulator = GravimeterSimulator(it, trajectory, field_map, runs)
    i = simulator.index
    velocity = trajectory.velocity[i]
    surface = reduce_gravity(simulator.felt, trajectory.latitude[i], 100.0, velocity[:, 0], velocity[:, 1])
    return surface, trajectory.latitude[i], trajectory.longitude[i], simulator


def within(sum_of_squares, freedom):
    low, high = chi2.ppf([0.0005, 0.9995], freedom)
    return low < sum_of_squares < high


def test_simulated_readings_are_the_map_plus_white_noise():
    field_map = field_map_of(wavy)
    surface, latitude, longitude, simulator = simulate(range(20), field_map)
    assert surface.shape == (20, 60)
    np.testing.assert_array_equal(simulator.index, np.arange(10, 601, 10))
    # a map of the disturbance: normal gravity of the true latitude is added
    noise = (surface - normal_gravity(latitude) - field_map.value(latitude, longitude)) / 2e-5
    assert within((noise**2).sum(), noise.size)
    assert abs((noise[:, 1:] * noise[:, :-1]).mean()) < 4.0 / np.sqrt(noise.size)
    assert abs((noise[1:] * noise[:-1]).mean()) < 4.0 / np.sqrt(noise.size)


def test_map_of_gravity_is_taken_as_it_is():
    field_map = field_map_of(lambda north, east: 9.8 + 1e-8 * north + 0.0 * east)
    field_map = replace(field_map, quantity="gravity")
    surface, latitude, longitude, _ = simulate([0], field_map, gravimeter=Gravimeter(sigma=1e-12))
    np.testing.assert_allclose(surface[0], field_map.value(latitude, longitude), atol=1e-11)


def test_outliers_come_at_their_share_and_size():
    settings = Gravimeter(sigma=1e-5, outlier_fraction=0.1, outlier_sigma=50.0)
    flat = field_map_of(lambda north, east: 0.0 * north + 0.0 * east)
    surface, latitude, _, _ = simulate(range(50), flat, gravimeter=settings)
    noise = (surface - normal_gravity(latitude)) / 1e-5
    far = np.abs(noise) > 6.0
    share = far.mean() / 0.9045  # of N(0, 50²) that lies beyond 6
    assert abs(share - 0.1) < 4.0 * np.sqrt(0.09 / noise.size)
    assert within(
        (noise[~far] ** 2).sum() / 1.035, (~far).sum()
    )  # the rest is ordinary, but for the few small outliers
    plain, _, _, _ = simulate(range(50), flat, gravimeter=Gravimeter(sigma=1e-5))
    assert (plain[~far] == surface[~far]).mean() > 0.98  # switching outliers on leaves the other readings as they were


def test_map_error_has_the_stated_covariance():
    it = scenario(map_error=MapError(sigma=3e-5, correlation_length=4000.0))
    trajectory = build_trajectory(it)
    index = np.arange(10, 601, 10)
    runs = 600
    error = draw_map_error(it, trajectory, index, range(runs))
    apart = horizontal_difference(
        trajectory.latitude[index][:, None],
        trajectory.longitude[index][:, None],
        trajectory.latitude[index],
        trajectory.longitude[index],
    )
    covariance = 3e-5**2 * np.exp(-np.hypot(apart[..., 0], apart[..., 1]) / 4000.0)
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), error.T)
    assert within((whitened**2).sum(), runs * len(index))  # variance and correlation at once, every length scale
    measured = error.T @ error / runs
    np.testing.assert_allclose(measured, covariance, atol=4.5 * 3e-5**2 * np.sqrt(2.0 / runs))
    assert not draw_map_error(scenario(), trajectory, index, [0, 1]).any()


def test_a_run_reads_the_same_alone_and_among_others():
    keys = {"map_error": MapError(sigma=3e-5), "gravimeter": Gravimeter(outlier_fraction=0.2)}
    field_map = field_map_of(wavy)
    together = simulate([4, 1, 9], field_map, **keys)[3].felt
    assert (simulate([1], field_map, **keys)[3].felt[0] == together[1]).all()
    assert (together[0] != together[2]).all()


@pytest.mark.parametrize(("change", "message"), [
    ({"route": Route(start=(-30.0, 147.0), end=(-30.0, 148.0), duration=100.0)},
     r"does not cover the route at latitude -30.0000, longitude 147\.\d{4} deg \(10 s after the start\)"),
    ({}, "a gravimeter does not feel magnetic_anomaly; give gravity or disturbance"),
])  # fmt: skip
def test_maps_that_cannot_be_used(change, message):
    field_map = field_map_of(wavy, half=30e3, step=1000.0, provenance="test.nc")
    if not change:
        field_map = replace(field_map, quantity="magnetic_anomaly")
    with pytest.raises(InputError, match=r"map test\.nc: .*" + message):
        simulate([0], field_map, **change)


def test_eotvos_enters_with_the_velocity_of_the_scan():
    flat = field_map_of(lambda north, east: 0.0 * north + 0.0 * east)
    it = scenario(gravimeter=Gravimeter(sigma=1e-12))
    trajectory = build_trajectory(it)
    simulator = GravimeterSimulator(it, trajectory, flat, [0])
    i = simulator.index
    expected = normal_gravity(trajectory.latitude[i]) - FREE_AIR * 100.0
    expected -= eotvos(trajectory.latitude[i], 100.0, *trajectory.velocity[i, :2].T)
    np.testing.assert_allclose(simulator.felt[0], expected, atol=1e-11)
