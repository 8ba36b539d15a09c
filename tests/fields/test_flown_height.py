"""The map at the flown height: what simulation and matcher get, against point masses."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from helpers.map_files import together
from helpers.point_masses import MGAL, attraction, map_of, mountains, rms
from helpers.refusals import refusal
from isogal.earth.gravity import FREE_AIR, eotvos, normal_gravity
from isogal.fields import derived_maps, scenario_map
from isogal.fields.scenario_map import map_for_scenario
from isogal.fields.simulator import true_readings
from isogal.fields.source_map import MapSource
from isogal.maps.corridor import corridor_of
from isogal.maps.load import load_map
from isogal.maps.tiled_map import TiledMap
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory

HIGH = 1000.0


@pytest.fixture(scope="module")
def low(tmp_path_factory):
    """Disturbance of point masses on flat ground."""
    return together(tmp_path_factory.mktemp("low") / "low.nc", map_of(attraction(0.0)))


@pytest.fixture(scope="module")
def high():
    """The same at the height of the flight."""
    return map_of(attraction(HIGH))


def scenario(path, *more):
    return load_scenario(
        None,
        [f"map.source={path}", "gravimeter.quantity=disturbance", "route.start=[-36.58, 146.92]",
         "route.end=[-36.42, 147.08]", "route.duration=null", f"route.height={HIGH}", *more],
    )  # fmt: skip


def flown(it):
    """How the map at the height of the flight is read."""
    return partial(MapSource.of(it).flown, it.route.height)


def along(it, field_map):
    route = build_trajectory(it)
    return np.asarray(field_map.value(route.latitude, route.longitude))


def test_simulated_readings_are_what_the_masses_make_at_the_height(low, high):
    """Normal gravity and the masses' attraction, less free air and Eötvös, each once."""
    it = scenario(low)
    route = build_trajectory(it)
    field_map = map_for_scenario(it, route, 5000.0)
    felt = true_readings(it.true, route, field_map)
    i = np.arange(it.steps_per_scan, len(route) + 1, it.steps_per_scan)
    v = route.velocity[i]
    right = (
        normal_gravity(route.latitude[i])
        + high.value(route.latitude[i], route.longitude[i])
        - FREE_AIR * HIGH
        - eotvos(route.latitude[i], HIGH, v[:, 0], v[:, 1])
    )
    assert rms(felt - right) < 0.03 * MGAL
    assert rms(along(it, field_map) - along(it, map_of(attraction(0.0)))) > 0.5 * MGAL
    as_it_is = map_for_scenario(scenario(low, "map.continuation=none"), route, 5000.0)
    np.testing.assert_allclose(along(it, as_it_is), along(it, map_of(attraction(0.0))), atol=1e-9)


def test_from_the_level_that_is_told(low, high, tmp_path):
    """By the scenario, by the map, downwards."""
    told = map_for_scenario(scenario(low, "map.level=400", "route.height=1400"), margin=5000.0)
    says = together(tmp_path / "says.nc", map_of(attraction(HIGH), height=HIGH))
    for found in (told, map_for_scenario(scenario(says), margin=5000.0)):
        it = scenario(low)
        assert rms(along(it, found) - along(it, high)) < 0.03 * MGAL
    down = map_for_scenario(scenario(says, "route.height=700"), margin=5000.0)
    it = scenario(low)
    assert rms(along(it, down) - along(it, map_of(attraction(700.0)))) < 0.05 * MGAL
    assert down.sigma > 0.0


def test_what_continuing_adds_is_not_what_the_map_says_of_its_error(low, tmp_path):
    """A map that says nothing still says nothing, in a file and in tiles; the matcher then asks
    the readings."""
    it = scenario(low)
    found = map_for_scenario(it, margin=5000.0)
    assert found.sigma > 0.0
    assert not found.states_error
    again = load_map(together(tmp_path / "again.nc", found))
    assert again.sigma == found.sigma
    assert not again.states_error
    told = replace(map_of(attraction(0.0)), sigma=1.0 * MGAL)
    assert map_for_scenario(scenario(together(tmp_path / "told.nc", told))).states_error
    route = build_trajectory(it)
    corridor = corridor_of(route.latitude, route.longitude, 5000.0)
    assert not TiledMap(flown(it), corridor).states_error


def test_from_the_ground(tmp_path, monkeypatch):
    # what another process, which takes a second to start, computes is the same
    monkeypatch.setattr(scenario_map, "derived_maps", derived_maps.compute)
    ground = mountains()
    terrain = together(
        tmp_path / "terrain.nc", replace(map_of(ground), unit="m", quantity="height")
    )
    low = map_of(attraction(ground, ground))
    level = float(ground.max()) + 200.0
    right = map_of(attraction(level, ground))
    normal = normal_gravity(low.latitude[:, None], ground)
    gravity = replace(low, values=low.values + normal, quantity="gravity")
    more = [f"map.terrain={terrain}", f"route.height={level}"]
    for field_map, quantity in ((low, "disturbance"), (gravity, "gravity")):
        file = together(tmp_path / f"{quantity}.nc", field_map)
        it = scenario(file, *more, f"gravimeter.quantity={quantity}")
        found = map_for_scenario(it, margin=5000.0)
        assert np.shape(found.sigma) == found.values.shape
        normal = normal_gravity(build_trajectory(it).latitude) * (quantity == "gravity")
        assert rms(along(it, found) - normal - along(it, right)) < 0.05 * MGAL
    below = scenario(tmp_path / "disturbance.nc", more[0], f"route.height={np.median(ground)}")
    with refusal("from the ground to"):
        map_for_scenario(below, margin=5000.0)


def test_gravity_above_a_surface_changes_as_the_disturbance_beside_it(high, tmp_path):
    """A vehicle that follows the ground: what the ground's own height adds stays."""
    masses = map_of(attraction(0.0))
    rough = 3e-4 * np.sin(np.arange(len(masses.latitude)) / 3.0) + normal_gravity(masses.latitude)
    gravity = replace(masses, values=masses.values + rough[:, None], quantity="gravity")
    both = together(tmp_path / "both.nc", gravity, masses)
    alone = together(tmp_path / "ga.nc", gravity)
    found, as_it_is, of_gravity_only = (
        along(it, map_for_scenario(it, margin=5000.0))
        for it in (
            scenario(both, "gravimeter.quantity=gravity"),
            scenario(both, "gravimeter.quantity=gravity", "map.continuation=none"),
            scenario(alone, "gravimeter.quantity=gravity"),
        )
    )
    it = scenario(both)
    assert rms(found - as_it_is - along(it, high) + along(it, masses)) < 0.05 * MGAL
    assert of_gravity_only == pytest.approx(as_it_is, abs=1e-12)


def test_what_cannot_be_continued_names_the_way_out(low):
    with refusal("with map.continuation: none it is"):
        map_for_scenario(scenario(low, "route.height=45000"), margin=5000.0)
    with refusal("values hold on a level or on terrain: give one"):
        scenario(low, "map.level=0", "map.terrain=some.nc")
