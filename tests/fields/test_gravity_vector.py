"""Gravity that the vehicle feels, its errors, and what a navigator knows of it."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import ORIGIN
from helpers.map_files import together
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.gravity import normal_gravity
from isogal.fields import gravity_vector as vector
from isogal.fields.gravity_vector import gravity_vector, sensed_gravity
from isogal.fields.known_gravity import known_gravity, true_residual_gravity
from isogal.fields.map_error import TrueMapError
from isogal.fields.simulator import scan_index
from isogal.maps import tiled_map
from isogal.maps.error_model import displacements, tensor_covariance
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import TiledMap
from isogal.scenario import Scenario
from isogal.sensors.trajectory import build_trajectory

GM = 6.674e-11 * 5e14
"""m³/s², of a point mass."""
DEPTH = 15e3


def mass_at(north, east):
    """Attraction to north, east and down (m/s²) at places (m) relative to the point over a
    mass."""
    distance = np.sqrt(north**2 + east**2 + DEPTH**2)
    return -GM * north / distance**3, -GM * east / distance**3, GM * DEPTH / distance**3


def map_with_mass(path, half, *names):
    """Write maps of a mass, 1 km between nodes, to one file: the disturbance (dg) and deflections
    of the vertical (xi, eta), three times the real ones to see which are taken."""
    metres = metres_per_radian(ORIGIN[0])
    axis = np.arange(-half, half + 100.0, 1000.0)
    latitude, longitude = ORIGIN[0] + axis / metres[0], ORIGIN[1] + axis / metres[1]
    to_north, to_east, down = mass_at(axis[:, None], axis)
    gamma = normal_gravity(latitude)[:, None]
    maps = {
        "dg": (down, "m/s²", "disturbance"),
        "xi": (-3.0 * to_north / gamma, "rad", "deflection_north"),
        "eta": (-3.0 * to_east / gamma, "rad", "deflection_east"),
    }
    return together(
        path, *(FieldMap(latitude, longitude, *maps[name]) for name in names), names=names
    )


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A route past a point mass, in a map of its disturbance."""
    path = map_with_mass(tmp_path_factory.mktemp("maps") / "mass.nc", 150e3, "dg")
    south, west = np.degrees(ORIGIN)
    return Scenario(
        route={
            "start": (south - 0.2, west - 0.2),
            "end": (south + 0.3, west + 0.2),
            "duration": 2400.0,
        },
        map={"source": str(path), "continuation": "none"},
        gravimeter={"quantity": "disturbance"},
    )


def changed(scenario, **sections):
    return Scenario(**(scenario.model_dump() | sections))


def made_by_the_mass(trajectory):
    """Horizontal and vertical attraction of the point mass in the middle of each interval."""
    metres = metres_per_radian(ORIGIN[0])
    middle = 0.5 * (trajectory.latitude[1:] + trajectory.latitude[:-1])
    across = 0.5 * (trajectory.longitude[1:] + trajectory.longitude[:-1])
    return np.stack(
        mass_at((middle - ORIGIN[0]) * metres[0], (across - ORIGIN[1]) * metres[1]), axis=-1
    )


def test_the_vehicle_feels_what_a_point_mass_does(world, monkeypatch):
    """Of a map in tiles it feels the same, but for what lies off the corridor of a long route,
    which counts as nothing."""
    trajectory = build_trajectory(world)
    expected = made_by_the_mass(trajectory)
    largest = np.abs(expected).max()
    assert np.abs(expected[:, :2]).max() > 3e-5
    # what lies beyond the map is the transform's error: a per cent of the peak
    (felt,) = sensed_gravity(world.true, trajectory, [0])
    np.testing.assert_allclose(felt, expected, atol=0.02 * largest)
    monkeypatch.setattr(vector, "_vector", vector._vector.__wrapped__)  # without a cache
    monkeypatch.setattr(tiled_map, "WHOLE_CELLS", 5000)
    assert isinstance(gravity_vector(world, trajectory).disturbance, TiledMap)
    (felt,) = sensed_gravity(world.true, trajectory, [0])
    np.testing.assert_allclose(felt, expected, atol=0.05 * largest)


def test_normal_gravity_is_no_vector(world):
    magnetic = changed(world, field="magnetic", gravimeter={"sigma": 1.0})
    scenario = changed(world, gravity={"field": "normal"})
    trajectory = build_trajectory(scenario)
    for without in (magnetic, scenario):
        assert gravity_vector(without, trajectory) is None
    assert sensed_gravity(scenario.true, trajectory, [0]) is None
    known = known_gravity(scenario, trajectory)
    assert (known.residual_sigma, known.residual) == (0.0, None)


@pytest.mark.parametrize(
    ("gravity", "told", "expected"),
    [
        ({}, {"map_sigma": 3e-5}, lambda spread: np.hypot(3e-5 / np.sqrt(2.0), 1e-6)),
        # until readings have shown it, as wrong as a map may be; of a matcher that does not learn
        ({}, {"map_sigma": "auto"}, lambda spread: np.hypot(8e-5 / np.sqrt(2.0), 1e-6)),
        ({}, {"name": "tercom"}, lambda spread: np.hypot(2e-5 / np.sqrt(2.0), 1e-6)),
        ({"compensation": "none"}, {"map_sigma": 0.0}, lambda spread: np.hypot(spread, 1e-6)),
        (
            {"compensated_share": 0.8},
            {"map_sigma": 0.0},
            lambda spread: np.hypot(0.2 * spread, 1e-6),
        ),
        ({"residual_sigma": 7e-5}, {"map_sigma": 3e-5}, lambda spread: 7e-5),
    ],
)
def test_what_is_believed_to_be_left(world, gravity, told, expected):
    scenario = changed(world, gravity=gravity, matcher=told)
    trajectory = build_trajectory(scenario)
    along = gravity_vector(scenario, trajectory).horizontal.value(
        trajectory.latitude, trajectory.longitude
    )
    spread = float(np.sqrt((along**2).mean()))
    known = known_gravity(scenario, trajectory)
    assert known.residual_sigma == pytest.approx(expected(spread), rel=1e-6)
    assert (known.compensation.share > 0.0) == (gravity.get("compensation") != "none")


def test_errors_are_drawn_where_places_are_passed_again(world):
    """What is left of their covariance has no Cholesky factor there, by rounding."""
    ends = (-36.6, 147.0, 22.0), (-36.420144, 147.0, 22.0)
    scenario = changed(
        world,
        map_error={"sigma": 3e-5, "correlation_length": 1e4},
        route={"waypoints": [*ends * 5, ends[0]], "duration": 9091.0},
    )
    trajectory = build_trajectory(scenario)
    drawn = TrueMapError(scenario.true, trajectory, scan_index(scenario, trajectory), range(40))
    _, errors = drawn.horizontal(drawn.at_scans())
    np.testing.assert_allclose((errors**2).mean(axis=(0, 1)) / 3e-5**2, 0.5, atol=0.12)


@pytest.mark.parametrize("most", [3000, 0], ids=["by a root", "by waves"])
def test_drawn_errors_have_these_covariances(world, monkeypatch, most):
    monkeypatch.setattr("isogal.fields.map_error._EXACT_PLACES", most)
    monkeypatch.setattr("isogal.fields.map_error._WAVES", 50)  # right in the mean with any number
    scenario = changed(world, map_error={"sigma": 3e-5})
    trajectory = build_trajectory(scenario)
    index, runs = scan_index(scenario, trajectory), range(400)
    drawn = TrueMapError(scenario.true, trajectory, index, runs)
    vertical = drawn.at_scans()
    stations, errors = drawn.horizontal(vertical)
    variance = (errors**2).mean(axis=(0, 1)) / 3e-5**2
    np.testing.assert_allclose(variance, 0.5, atol=0.06)
    # that of the disturbance six scans, 1.3 km, after the stations, by the model for all tensors
    later = vertical[:, np.searchsorted(index, stations[1:-3]) + 6]
    found = (later[..., None] * errors[:, 1:-3]).mean(axis=(0, 1)) / 3e-5**2
    rows = index[[6, 0]]
    apart = displacements(trajectory.latitude[rows], trajectory.longitude[rows])[:1, [1, 1]]
    channels = np.zeros(1, int), np.array([1, 2])
    expected = tensor_covariance(("dd", "nd", "ed"), channels[0], apart, 4e3, channels[1])
    np.testing.assert_allclose(found, expected[0], atol=0.03)
    assert np.abs(expected).max() > 0.15
    alone = replace(drawn, runs=[7]).horizontal(vertical[[7]])[1]
    np.testing.assert_array_equal(alone[0], errors[7])
    assert stations[-1] == index[-1]


def test_maps_of_the_deflection_come_before_the_transform(world, tmp_path):
    path = map_with_mass(tmp_path / "all.nc", 100e3, "dg", "xi", "eta")
    scenario = changed(world, map={"source": str(path), "continuation": "none"})
    trajectory = build_trajectory(scenario)
    transformed, measured = (
        sensed_gravity(it.true, trajectory, [0])[0, :, :2] for it in (world, scenario)
    )
    np.testing.assert_allclose(measured, 3.0 * transformed, atol=0.1 * np.abs(transformed).max())


def test_what_is_left_follows_the_true_map_error_or_the_one_that_readings_have_shown(world):
    trajectory = build_trajectory(world)
    wrong = changed(world, map_error={"sigma": 6e-5, "correlation_length": 9e3})
    really = true_residual_gravity(wrong.true, trajectory)
    expected = np.hypot(6e-5 / np.sqrt(2.0), 1e-6), 9e3
    assert (really.residual_sigma, really.residual_length) == pytest.approx(expected)
    assert known_gravity(world, trajectory).residual.given(6e-5, 9e3) == pytest.approx(expected)
    told = changed(world, gravity={"residual_sigma": 7e-5, "residual_correlation_length": 5e3})
    assert known_gravity(told, trajectory).residual.given(6e-5, 9e3) == (7e-5, 5e3)
