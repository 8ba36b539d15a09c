"""Soundings of several beams: where they meet the ground, and what is made of them."""

import numpy as np
import pytest

from helpers.refusals import refusal
from helpers.sea_floor import DVL, FAN, SOUNDING, sea_floor
from isogal.fields.beams import Footprints
from isogal.fields.measured import measured_field
from isogal.fields.simulator import ReadingSimulator
from isogal.inertial.rotations import matrix
from isogal.maps.field_map import FieldMap
from isogal.scenario import load_scenario
from isogal.sensors.altimeter import beam_directions, thinned
from isogal.sensors.reduction import State
from isogal.sensors.trajectory import build_trajectory


@pytest.fixture(scope="module")
def floor():
    return sea_floor()


def scenario_of(*items):
    return load_scenario(None, [*SOUNDING, *items])


def readings_of(field_map, *items, runs=(0, 1)):
    scenario = scenario_of(*items)
    return ReadingSimulator(scenario.true, build_trajectory(scenario), field_map, list(runs))


def test_directions():
    fan = beam_directions(scenario_of("altimeter.beams=3", "altimeter.opening=60").altimeter)
    half = np.array([0.0, 0.5, np.sqrt(0.75)])
    np.testing.assert_allclose(fan, [[0, 0, 1], half * (1, -1, 1), half], atol=1e-12)
    four = beam_directions(scenario_of(DVL).altimeter)
    np.testing.assert_allclose(four[:, 2], np.cos(np.radians(30.0)))
    np.testing.assert_allclose(four.sum(axis=0)[:2], 0.0, atol=1e-12)


def test_a_beam_of_a_slope_by_hand():
    # a plane that rises by 0.2 per metre to the east; the vehicle heads north, its beams aside
    latitude = np.radians(np.arange(-0.1, 0.1, 0.001))
    longitude = np.radians(np.arange(0, 0.2, 0.001))
    east = 6378137.0 * (longitude - longitude[100])
    plane = FieldMap(latitude, longitude, 0.2 * east + 0.0 * latitude[:, None], "m", "height")
    scenario = scenario_of(
        "route.start=[0.0, 0.1]", "route.end=[0.05, 0.1]", "route.height=100",
        "altimeter.directions=[[90, 45], [-90, 45]]",
    )  # fmt: skip
    trajectory = build_trajectory(scenario)
    foot = Footprints(scenario.altimeter, trajectory, plane, np.array([20]))
    # r cos 45 = 100 - 0.2 r sin 45 to the east, + to the west
    expected = 100.0 * np.sqrt(2.0) / np.array([1.2, 0.8])
    np.testing.assert_allclose(foot.range[0], expected, rtol=1e-3)


def test_a_sounding_without_noise_is_the_map_at_its_footprint(floor):
    for pattern in (FAN, (DVL,)):
        items = (*pattern, "gravimeter.sigma=1e-4")
        scenario = scenario_of(*items)
        trajectory, found = build_trajectory(scenario), readings_of(floor, *items)
        i = found.index
        at = State(
            trajectory.latitude[i], trajectory.longitude[i], trajectory.height[i],
            *trajectory.velocity[i, :2].T, matrix(trajectory.attitude[i]),
        )  # fmt: skip
        reduced = measured_field(scenario).reduction(scenario).reduce(found.raw[0], at)
        foot = Footprints(scenario.altimeter, trajectory, floor, i)
        ground = floor.value(*foot.places(foot.range))
        np.testing.assert_allclose(reduced[..., 0], ground, atol=2e-3)
        assert np.ptp(reduced[..., 1:3]) > 100.0


def test_out_of_range_and_missing(floor):
    far = readings_of(floor, *FAN, "altimeter.max_range=120", "gravimeter.missing_fraction=0.3")
    none = np.isnan(far.raw).any(axis=-1)
    assert none.all(axis=-1).any()  # missing scans
    assert none[..., -1].mean() > none[..., 0].mean()  # the slanting beams are longer


def test_what_cannot_be_simulated_is_refused(floor):
    for items, words in (
        (("altimeter.directions=[[0, 80]]",), "directions.0.1: must be at most 75"),
        (("altimeter.beams=3", DVL), "says nothing where directions"),
        ((DVL, "altimeter.message=scan"), "directions needs points"),
        (("altimeter.beams=3", "truth.altimeter.beams=4"), "truth.altimeter.beams"),
    ):
        with refusal(words):
            scenario_of(*items).true  # noqa: B018
    for field_map, item, words in (
        (floor, "route.height=-320", "below the terrain"),
        (floor, "gravimeter.delay=5", "cannot be late"),
        (sea_floor(half=1200.0), "altimeter.opening=150", "does not cover all beams"),
    ):
        with refusal(words):
            readings_of(field_map, *FAN, item)


def test_soundings_of_a_real_instrument_are_thinned():
    vectors = np.array([[0.0, y, 50.0] for y in np.linspace(-80, 80, 41)])
    vectors[3] = np.nan
    found = thinned(vectors, 5)
    assert np.isfinite(found).all()
    assert (np.diff(np.abs(found[:, 1])) >= 0.0).all()
    assert np.isnan(thinned(vectors[:2], 5)[2:]).all()
    np.testing.assert_array_equal(thinned(vectors[:5], 5), vectors[:5])
