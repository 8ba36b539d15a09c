"""The synthetic map: the same everywhere and always, like a real one along the default route."""

import os
import shutil
import subprocess

import numpy as np
import pytest

from helpers.refusals import refusal
from isogal.earth.gravity import normal_gravity
from isogal.maps.axes import Window
from isogal.maps.corridor import corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.load import load_map
from isogal.maps.synthetic import synthetic_map as module
from isogal.maps.synthetic import tiles as synthetic
from isogal.maps.synthetic.synthetic_map import quantity_of, synthetic_map, synthetic_map_along
from isogal.maps.synthetic.tiles import VERSION
from isogal.maps.tiled_map import TiledMap
from isogal.scenario import load_scenario
from isogal.sensors.trajectory import build_trajectory


def window(south, north, west, east):
    return Window(*np.radians([south, north, west, east]))


OF_ALL_TESTS = os.environ["ISOGAL_CACHE"]
SHARED = [(-38, 144), (-38, 145), (-37, 144), (-37, 145)]
"""Those that other tests need, too: of the default route."""
TILES = [*SHARED, (10, -180), (10, 179)]
"""Those of the tests."""


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory):
    """A cache folder with the tiles, how they came, and corners of those made in this process."""
    real, here, seen = synthetic.make_tile, [], []
    for _ in synthetic.read_tiles("gravity", SHARED):
        pass
    there = [synthetic._path(tile) for tile in SHARED]
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("cache")
        patch.setenv("ISOGAL_CACHE", str(folder))
        for path, tile in zip(there, SHARED, strict=True):
            synthetic._path(tile).parent.mkdir(exist_ok=True)
            shutil.copy(path, synthetic._path(tile))
        patch.setattr(synthetic, "make_tile", lambda *corner: here.append(corner) or real(*corner))
        with pytest.MonkeyPatch.context() as real_one:  # all other tests have none
            real_one.setattr(synthetic, "subprocess", subprocess)
            for _ in synthetic.read_tiles("gravity", TILES, lambda *done: seen.append(done)):
                pass
        yield folder / f"synthetic-{VERSION}", seen, here


def test_values_do_not_change_between_versions():
    """The numbers of this version. If they change, raise VERSION, or old cache files are mixed
    with new ones."""
    field_map = synthetic_map("disturbance", window(-37.01, -36.99, 144.99, 145.01))
    assert VERSION == 1
    centre = np.rint(field_map.values[::4, ::4] / 1e-6).astype(int)
    assert centre[:3, :3].tolist() == [[-397, -396, -396], [-389, -389, -393], [-381, -385, -392]]


def test_it_goes_across_the_date_line():
    across = synthetic_map("disturbance", window(10.4, 10.42, 179.98, -179.98))
    lat, lon = np.radians(10.41), np.radians(np.linspace(179.981, 180.019, 50))
    found = across.value(lat, lon)
    steps = np.abs(np.diff(found))
    assert np.isfinite(found).all() and steps[24] < 2.0 * max(steps[20], steps[28])
    np.testing.assert_allclose(across.value(lat, lon - 2 * np.pi), found, rtol=0, atol=1e-12)


def test_like_ggmplus():
    gravity, disturbance, height = (
        synthetic_map(q, window(-37.1, -37.0, 145.0, 145.1))
        for q in ("gravity", "disturbance", "height")
    )
    expected = normal_gravity(gravity.latitude[:, None], height.values) + disturbance.values
    np.testing.assert_allclose(gravity.values, expected, rtol=0, atol=0.6e-6)
    steps = disturbance.values / 1e-6
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert disturbance.quantisation == gravity.quantisation == 1e-6
    cells = np.degrees(disturbance.latitude) / 0.002
    np.testing.assert_allclose(cells - np.floor(cells), 0.5, atol=1e-6)


def test_tiles_are_made_in_another_process_or_else_here(own_cache, tmp_path, monkeypatch):
    """A node must not keep the memory of the generator; without a second process the map comes all
    the same."""
    _, seen, here = own_cache
    part = window(10.5, 10.51, 179.5, 179.51)
    child = synthetic_map("gravity", part)
    assert not here and seen[-1] == (len(TILES), len(TILES))
    assert seen == sorted(seen)
    monkeypatch.setenv("ISOGAL_CACHE", str(tmp_path))
    np.testing.assert_array_equal(synthetic_map("gravity", part).values, child.values)
    assert here == [(10, 179)]


def test_along_a_long_route_it_is_tiled_and_the_same(own_cache, monkeypatch):
    latitude, longitude = np.radians([-37.1, -36.9]), np.radians([144.7, 145.3])
    route = [np.linspace(*ends, 500) for ends in (latitude, longitude)]
    corridor, before = corridor_of(*route, 3000.0), len(own_cache[2])
    whole = synthetic_map_along("gravity", corridor)
    assert isinstance(whole, FieldMap)
    monkeypatch.setattr(module, "WHOLE_CELLS", 10_000)
    tiled = synthetic_map_along("gravity", corridor)
    assert isinstance(tiled, TiledMap)
    np.testing.assert_allclose(tiled.value(*route), whole.value(*route), rtol=0, atol=1e-13)
    # none was made in this process, and those off the route not at all
    assert len(own_cache[2]) == before


def test_the_default_route_is_like_the_real_terrain(shared_data, monkeypatch):
    """RMS of the disturbance and of its gradient along the default route; tolerances 10 %."""
    monkeypatch.setenv("ISOGAL_CACHE", OF_ALL_TESTS)  # other tests need its tiles, too
    trajectory = build_trajectory(load_scenario())
    at = trajectory.latitude[::5], trajectory.longitude[::5]
    real = load_map(shared_data / "se_australia_gravity.nc", "dg", window=corridor_of(*at).window)
    made = synthetic_map("disturbance", corridor_of(*at, 3000.0).window)

    def gradient_rms(field_map):
        _, north, east = field_map.value_and_gradient(*at)
        return np.sqrt(np.mean(north**2 + east**2))

    assert np.sqrt(np.mean(made.value(*at) ** 2)) == pytest.approx(36e-5, rel=0.1)
    assert gradient_rms(made) == pytest.approx(gradient_rms(real), rel=0.1)


def test_limits():
    for quantity, where, words in (
        ("gravity", (88.99, 89.5, 0.0, 0.1), "89 deg"),
        ("gravity", (-60.0, 60.0, 0.0, 120.0), "too many"),
        ("geoid", (0.0, 0.1, 0.0, 0.1), "not geoid"),
    ):
        with refusal(words):
            synthetic_map(quantity, window(*where))
    assert quantity_of("dg", "map.variable") == "disturbance"
    with refusal("map.variable: the synthetic map has height, ga and dg, not 'xi'"):
        quantity_of("xi", "map.variable")
