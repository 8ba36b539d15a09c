"""A map read in parts: the same values as of the map in memory, whatever was read before."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.earth.ellipsoid import metres_per_radian
from isogal.errors import InputError
from isogal.maps import tiled_map
from isogal.maps.axes import TWO_PI, EmptyWindowError, TooManyCellsError
from isogal.maps.corridor import corridor_of
from isogal.maps.field_map import FieldMap
from isogal.maps.tiled_map import TiledMap, map_along
from isogal.montecarlo.engine import simulate
from isogal.scenario import load_scenario

MARGIN = 5_000.0
CORNERS = [[-36.75, 146.7], [-36.25, 147.3]]


def part_of(whole, window):
    """Read a map that is in memory as a reader does."""
    part = whole.window(*window[:4])
    if part.values.size > window.most_cells:
        raise TooManyCellsError("too many cells")
    return part


@pytest.fixture(scope="module")
def whole():
    """Nodes of 500 m, 160 x 160, with a hole, and an error that differs from place to place."""
    made = field_map_of(wavy, step=500.0)
    made.values[100:120, 60:90] = np.nan
    sigma = 1e-5 + 1e-6 * np.arange(made.values.size).reshape(made.values.shape) % 7e-6
    return replace(made, sigma=sigma, correlation_length=3000.0, quantisation=1e-7)


def along_the_diagonal(read):
    """A map in tiles of 16 x 16 nodes, along the diagonal."""
    (south, west), (north, east) = np.radians(CORNERS)
    line = np.linspace(south, north, 400), np.linspace(west, east, 400)
    return TiledMap(read, corridor_of(*line, MARGIN))


@pytest.fixture(autouse=True)
def small_tiles(monkeypatch):
    monkeypatch.setattr(tiled_map, "TILE_CELLS", 16)


@pytest.fixture
def tiled(whole):
    return along_the_diagonal(partial(part_of, whole))


@pytest.fixture(scope="module")
def places():
    """Places all over the map, beyond its edge, a whole circle away, and some that are none."""
    north, east = np.random.default_rng(1).uniform(-45e3, 45e3, (2, 500))
    metres = metres_per_radian(ORIGIN[0])
    latitude, longitude = ORIGIN[0] + north / metres[0], ORIGIN[1] + east / metres[1]
    longitude[400:] -= TWO_PI
    latitude[7], longitude[11] = np.nan, np.nan
    return latitude, longitude


def test_values_are_those_of_the_map_in_memory(whole, tiled, places):
    np.testing.assert_allclose(tiled.value(*places), whole.value(*places), atol=1e-15)
    both = (each.value_and_gradient(*places) for each in (tiled, whole))
    for one, other in zip(*both, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-14)
    np.testing.assert_allclose(tiled.sigma_at(*places), whole.sigma_at(*places), atol=1e-15)
    np.testing.assert_array_equal(tiled.covers(*places), whole.covers(*places))
    assert 50 < np.isnan(tiled.value(*places)).sum() < 250
    there = tiled.value(ORIGIN[0] + 1e-4 * np.arange(3)[:, None], ORIGIN[1] + 1e-4 * np.arange(2))
    assert there.shape == (3, 2) and np.ndim(tiled.value(*ORIGIN)) == 0
    for name in ("unit", "quantity", "correlation_length", "quantisation", "provenance", "step"):
        assert getattr(tiled, name) == pytest.approx(getattr(whole, name))


def test_around_a_batch_there_is_map_as_far_as_the_margin(whole, tiled):
    latitude, longitude = ORIGIN[0] - 2e-4 * np.arange(4), ORIGIN[1] - 3e-4 * np.arange(4)
    near = tiled.near(latitude, longitude)
    assert isinstance(near, FieldMap) and near.values.size < 0.3 * whole.values.size
    angle = np.linspace(0.0, TWO_PI, 9)[:, None]
    north, east = metres_per_radian(latitude)
    around = latitude + MARGIN * np.cos(angle) / north, longitude + MARGIN * np.sin(angle) / east
    np.testing.assert_allclose(near.value(*around), whole.value(*around), atol=1e-15)
    assert np.isfinite(near.value(*around)).all()
    assert near is tiled.near(latitude, longitude - TWO_PI)
    away = latitude + 0.1, longitude
    assert not tiled.near(*away).covers(*away).any()


def test_what_a_batch_gets_does_not_depend_on_what_was_read_before(tiled, whole, places):
    here = ORIGIN[0] + 1e-4 * np.arange(5), ORIGIN[1] + 1e-4 * np.arange(5)
    fresh = TiledMap(partial(part_of, whole), tiled.corridor)
    tiled.value(*places)
    for shift in (-3e-3, 2e-3, 4e-3):
        tiled.near(here[0] + shift, here[1])
    near, other = tiled.near(*here), fresh.near(*here)
    assert near is tiled.near(*here)  # kept
    np.testing.assert_array_equal(near.values, other.values)
    assert near.grid[1:] == other.grid[1:]


def test_what_cannot_be_read_is_no_empty_map(whole, tiled):
    def endless(window):
        raise TooManyCellsError("too many")

    def damaged(window):
        raise InputError("map.nc: damaged")

    start = tiled.near(*ORIGIN)
    with pytest.raises(InputError, match=r"^matcher.batch_length: make it shorter; too many$"):
        TiledMap(endless, tiled.corridor, start).near(*ORIGIN)
    with pytest.raises(InputError, match="damaged"):
        TiledMap(damaged, tiled.corridor)
    with pytest.raises(InputError, match="damaged"):
        TiledMap(damaged, tiled.corridor, start).value(*ORIGIN)
    away = corridor_of(np.radians([10.0, 11.0]), np.radians([20.0, 21.0]))
    with pytest.raises(EmptyWindowError, match="has nothing at"):
        TiledMap(partial(part_of, whole), away)


def test_sent_to_another_process_without_what_was_read(whole, tiled, places):
    tiled.value(*places)
    sent = pickle.dumps(TiledMap(partial(part_of, None), tiled.corridor, tiled.near(*ORIGIN)))
    assert len(sent) < 0.5 * whole.values.nbytes
    got = pickle.loads(pickle.dumps(tiled))
    assert not got._read
    np.testing.assert_array_equal(got.value(*places), tiled.value(*places))


def test_a_small_map_is_read_as_a_whole(whole, tiled, monkeypatch):
    asked = []

    def load(window):
        asked.append(window[:4])
        return part_of(whole, window)

    assert isinstance(map_along(load, tiled.corridor), FieldMap)
    assert asked == [tiled.corridor.window[:4]]
    monkeypatch.setattr(tiled_map, "WHOLE_CELLS", 5_000)
    assert isinstance(map_along(load, tiled.corridor), TiledMap)


def test_a_run_over_a_tiled_map_is_that_over_the_map_in_memory():
    """Oblique, 35 km, five batches; the tiles change in between."""
    whole = field_map_of(wavy, step=500.0)
    keys = (
        f"route.start={CORNERS[0]}", f"route.end={CORNERS[1]}", "route.duration=1500",
        "gravimeter.quantity=disturbance",
        "gravity.field=normal",  # the map is made up
        "matcher.map_sigma=0",
        "matcher.options.trust=1",  # else models depend on the tile's standard deviation
        "matcher.stride=30",
    )  # fmt: skip
    tiled = along_the_diagonal(partial(part_of, whole))
    scenario = load_scenario(None, keys)
    one, other = (simulate(scenario, [0], field_map) for field_map in (whole, tiled))
    assert np.isfinite(one.fix_error).all()
    np.testing.assert_allclose(other.error, one.error, atol=1e-5)
    np.testing.assert_allclose(other.fix_error, one.fix_error, atol=1e-5)
    np.testing.assert_allclose(other.detail.map_value, one.detail.map_value, atol=1e-12)
