"""Simulated readings: the map as truth, noise, outliers, map error, and what is not measured."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest
from scipy.stats import t as student_t

from helpers.batches import ORIGIN, field_map_of, wavy
from helpers.statistics import within_chi_square
from isogal.earth.frames import horizontal_difference
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.fields.map_error import TrueMapError
from isogal.fields.simulator import ReadingSimulator
from isogal.scenario import Altimeter, Gravimeter, MapError, Route, Scenario
from isogal.sensors.gravimeter import GravityReduction
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import build_trajectory

FLAT = field_map_of(lambda north, east: 0.0 * north + 0.0 * east)


def scenario(**keys):
    route = Route(start=tuple(np.degrees(ORIGIN)), end=(-36.4, 147.2), duration=600.0)
    return Scenario(**({"route": route, "gravimeter": Gravimeter(sigma=2e-5)} | keys))


def simulate(runs, field_map, **keys):
    it = scenario(**keys)
    trajectory = build_trajectory(it)
    simulator = ReadingSimulator(it.true, trajectory, field_map, runs)
    i = simulator.index
    at = State(trajectory.latitude[i], 0.0, 100.0, *trajectory.velocity[i, :2].T)
    surface = GravityReduction().reduce(simulator.raw, at)
    return surface, trajectory.latitude[i], trajectory.longitude[i], simulator


def test_simulated_readings_are_the_map_plus_white_noise():
    field_map = field_map_of(wavy)
    surface, latitude, longitude, simulator = simulate(range(20), field_map)
    assert surface.shape == (20, 60)
    np.testing.assert_array_equal(simulator.index, np.arange(10, 601, 10))
    # a map of the disturbance: normal gravity of the true latitude is added
    noise = (surface - normal_gravity(latitude) - field_map.value(latitude, longitude)) / 2e-5
    assert within_chi_square((noise**2).sum(), noise.size)
    assert abs((noise[:, 1:] * noise[:, :-1]).mean()) < 4.0 / np.sqrt(noise.size)
    assert abs((noise[1:] * noise[:-1]).mean()) < 4.0 / np.sqrt(noise.size)


def test_map_of_gravity_is_taken_as_it_is():
    sloping = field_map_of(lambda north, east: 9.8 + 1e-8 * north + 0.0 * east)
    field_map = replace(sloping, quantity="gravity")
    surface, latitude, longitude, _ = simulate([0], field_map, gravimeter=Gravimeter(sigma=1e-12))
    np.testing.assert_allclose(surface[0], field_map.value(latitude, longitude), atol=1e-11)


def test_outliers_come_at_their_share_and_size():
    settings = Gravimeter(sigma=1e-5, outlier_fraction=0.1, outlier_sigma=50.0)
    surface, latitude, _, _ = simulate(range(50), FLAT, gravimeter=settings)
    noise = (surface - normal_gravity(latitude)) / 1e-5
    far = np.abs(noise) > 6.0
    share = far.mean() / 0.9045  # of N(0, 50²) that lies beyond 6
    assert abs(share - 0.1) < 4.0 * np.sqrt(0.09 / noise.size)
    # the rest is ordinary, but for the few small outliers
    assert within_chi_square((noise[~far] ** 2).sum() / 1.035, (~far).sum())
    # switching outliers on leaves the other readings as they were
    plain, _, _, _ = simulate(range(50), FLAT, gravimeter=Gravimeter(sigma=1e-5))
    assert (plain[~far] == surface[~far]).mean() > 0.98


def test_bias_and_drift_are_constant_in_a_run_and_drawn_anew_in_the_next():
    settings = Gravimeter(sigma=1e-9, bias=5e-5, drift=1e-7)
    surface, latitude, _, it = simulate(range(200), FLAT, gravimeter=settings)
    error = surface - normal_gravity(latitude)
    time = build_trajectory(scenario()).time[it.index]
    slope, offset = np.polyfit(time, error.T, 1)
    # nothing else but noise of 1e-9
    assert np.abs(error - (offset[:, None] + slope[:, None] * time)).max() < 1e-8
    assert within_chi_square((offset**2).sum() / 5e-5**2, 200)
    assert within_chi_square((slope**2).sum() / 1e-7**2, 200)
    assert abs(np.corrcoef(offset, slope)[0, 1]) < 0.3
    some, _, _, _ = simulate([7, 3], FLAT, gravimeter=settings)
    np.testing.assert_array_equal(some, surface[[7, 3]])


@pytest.mark.parametrize("most", [3000, 0], ids=["by a root", "by waves"])
def test_map_error_has_the_stated_covariance(monkeypatch, most):
    monkeypatch.setattr("isogal.fields.map_error._EXACT_PLACES", most)
    monkeypatch.setattr("isogal.fields.map_error._WAVES", 200)  # right in the mean with any number
    it = scenario(map_error=MapError(sigma=3e-5, correlation_length=4000.0))
    trajectory, index, runs = build_trajectory(it), np.arange(10, 601, 10), 600
    error = TrueMapError(it.true, trajectory, index, range(runs)).at_scans()
    lat, lon = trajectory.latitude[index], trajectory.longitude[index]
    apart = horizontal_difference(lat[:, None], lon[:, None], lat, lon)
    covariance = 3e-5**2 * np.exp(-np.hypot(apart[..., 0], apart[..., 1]) / 4000.0)
    whitened = np.linalg.solve(np.linalg.cholesky(covariance), error.T)
    # variance and correlation at once, every length scale
    assert within_chi_square((whitened**2).sum(), runs * len(index))
    measured = error.T @ error / runs
    np.testing.assert_allclose(measured, covariance, atol=4.5 * 3e-5**2 * np.sqrt(2.0 / runs))
    alone = TrueMapError(it.true, trajectory, index, [7]).at_scans()
    np.testing.assert_array_equal(alone[0], error[7])
    assert not TrueMapError(scenario().true, trajectory, index, [0, 1]).at_scans().any()


def test_map_error_with_tails_has_students_distribution_and_the_same_sigma():
    it = scenario(map_error=MapError(sigma=3e-5, correlation_length=500.0, tails=3.0))
    gaussian = scenario(map_error=MapError(sigma=3e-5, correlation_length=500.0))
    trajectory = build_trajectory(it)
    index = np.arange(10, 601, 100)  # 2.2 km apart: as good as independent
    error, normal = (
        TrueMapError(one.true, trajectory, index, range(1000)).at_scans() for one in (it, gaussian)
    )
    freedom = error / 3e-5 * np.sqrt(3.0)
    assert kstest(freedom.ravel(), student_t(3.0).cdf).pvalue > 0.01
    assert kstest(freedom.ravel(), "norm").pvalue < 1e-6
    np.testing.assert_array_equal(np.argsort(error, axis=0), np.argsort(normal, axis=0))
    keys = {"gradiometer": {"map_errors": "one_potential"}, "map_error": {"tails": 3.0}}
    with pytest.raises(ValueError, match="errors of one potential"):
        scenario(field="gradient", **keys)


@pytest.mark.parametrize(("change", "message"), [
    ({"route": Route(start=(-30.0, 147.0), end=(-30.0, 148.0), duration=100.0)},
     r"does not cover the route: no value at -30.0000, 147\.\d{4} deg \(point 0 of 10"),
    ({}, "a gravimeter does not measure magnetic_anomaly; give disturbance or gravity"),
])  # fmt: skip
def test_maps_that_cannot_be_used(change, message):
    field_map = field_map_of(wavy, half=30e3, step=1000.0, provenance="test.nc")
    if not change:
        field_map = replace(field_map, quantity="magnetic_anomaly")
    with pytest.raises(InputError, match=r"map:? test\.nc.*" + message):
        simulate([0], field_map, **change)


HILLS = replace(
    field_map_of(lambda north, east: 500.0 * np.cos(north / 3e3) * np.cos(east / 4e3)),
    quantity="height",
    unit="m",
    provenance="hills.nc",
)


def clearance(runs, height, **keys):
    """Readings over the hills, the ground there, and the error of its map."""
    route = Route(
        start=tuple(np.degrees(ORIGIN)), end=(-36.4, 147.2), duration=600.0, height=height
    )
    usual = {"route": route, "field": "terrain", "gravimeter": Gravimeter(sigma=3.0)}
    it = scenario(**(usual | keys))
    trajectory = build_trajectory(it)
    simulator = ReadingSimulator(it.true, trajectory, HILLS, runs)
    i = simulator.index
    error = TrueMapError(it.true, trajectory, i, runs).at_scans()
    return simulator.raw, HILLS.value(trajectory.latitude[i], trajectory.longitude[i]), error


def test_clearance_is_height_above_the_ground():
    """Which the map's error lifts."""
    felt, ground, lifted = clearance(range(20), 900.0, map_error=MapError(sigma=20.0))
    assert lifted.any()
    noise = (900.0 - felt - ground - lifted) / 3.0
    assert within_chi_square((noise**2).sum(), noise.size)
    np.testing.assert_array_equal(felt, felt.astype(np.float32))  # as the message carries it


def test_beyond_its_range_an_altimeter_gives_no_reading_and_below_the_terrain_is_no_route():
    keys = {"altimeter": Altimeter(max_range=800.0), "gravimeter": Gravimeter(sigma=1e-3)}
    felt, ground, _ = clearance([0], 900.0, **keys)
    out = 900.0 - ground > 800.0
    assert 0 < out.sum() < out.size
    np.testing.assert_array_equal(np.isnan(felt[0]), out)
    with pytest.raises(InputError, match=r"route\.height: .* \d+ m below the terrain at lat"):
        clearance([0], 300.0)
