"""Continuation from mountains to a level against point masses, and against another
implementation."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.point_masses import MGAL, SIDE, attraction, map_of, mountains, rms
from helpers.refusals import refusal
from isogal.maps.continuation import source_layer
from isogal.maps.continuation.level import to_level
from isogal.maps.continuation.terrain import from_terrain


@pytest.fixture(scope="module")
def mountain_map():
    """Values on mountains, and the heights of these."""
    ground = mountains()
    terrain = replace(map_of(ground), unit="m", quantity="height")
    return map_of(attraction(ground, ground), quantisation=0.01 * MGAL), terrain


@pytest.mark.parametrize("above", [100.0, 1000.0, 3000.0])
def test_from_mountains_to_a_level_above(mountain_map, above):
    """Within 0.03 mGal RMS of 2 mGal; values taken to lie on a level err ten times as much."""
    low, terrain = mountain_map
    height = float(terrain.values.max()) + above
    high = from_terrain(low, terrain, height)
    right = attraction(height, terrain.values)
    error = rms(high.values - right)
    assert error < 0.03 * MGAL
    flat = to_level(low, height, float(np.median(terrain.values)))
    assert rms(flat.values - right) > 5.0 * error
    assert high.height == height
    assert np.isfinite(high.sigma).all()
    assert rms(high.values) < rms(low.values)


def test_a_level_between_the_mountains(mountain_map):
    """Valleys get values, also beside mountains; what is below the ground gets none."""
    low, terrain = mountain_map
    height = float(np.median(terrain.values))
    high = from_terrain(low, terrain, height, edge=5e3)
    kept = np.isfinite(high.values)
    assert not kept[terrain.values > height].any()
    assert 0.35 < kept.mean() < 0.5
    assert rms(high.values - attraction(height, terrain.values)) < 0.05 * MGAL


def test_what_sources_cannot_explain_is_in_sigma(mountain_map):
    """White noise of 1 mGal in a quarter of the map, which no field at that height can have."""
    low, terrain = mountain_map
    noisy = low.values.copy()
    noisy[:100, :100] += MGAL * np.random.default_rng(1).standard_normal((100, 100))
    height = float(np.median(terrain.values))
    sigma = np.asarray(from_terrain(replace(low, values=noisy), terrain, height, edge=3e3).sigma)
    plain = np.asarray(from_terrain(low, terrain, height, edge=3e3).sigma)
    near = np.abs(height - terrain.values) < 100.0
    noise = np.median(sigma[:80, :80][near[:80, :80]])
    assert 0.2 * MGAL < noise < MGAL
    assert noise > 10.0 * np.median(plain[:80, :80][near[:80, :80]])
    assert noise > 10.0 * np.median(sigma[130:, 130:][near[130:, 130:]])


def test_sigma_falls_with_the_height_above_the_ground(mountain_map):
    low, terrain = mountain_map
    stated = replace(low, sigma=MGAL, correlation_length=2000.0)
    sigma = np.ravel(from_terrain(stated, terrain, float(terrain.values.max()) + 100.0).sigma)
    summit, valley = np.argmax(terrain.values), np.argmin(terrain.values)
    assert sigma[valley] < 0.8 * sigma[summit] < 0.8 * MGAL


def test_terrain_on_another_grid(mountain_map):
    low, terrain = mountain_map
    height = float(terrain.values.max()) + 500.0
    inner = slice(4, -4)
    high = from_terrain(low.part(inner, inner), terrain.thinned(2, 2), height)
    right = from_terrain(low, terrain, height).values[inner, inner]
    assert rms(high.values - right) < 0.1 * MGAL


def test_holes_are_left_out(mountain_map):
    low, terrain = mountain_map
    height = float(terrain.values.max()) + 300.0
    ground, values = terrain.values.copy(), low.values.copy()
    ground[60, 60], values[120, 120] = np.nan, np.nan
    high = from_terrain(
        replace(low, values=values), replace(terrain, values=ground), height, edge=3e3
    )
    for row, column in ((60, 60), (120, 120)):
        assert np.isnan(high.values[row - 5 : row + 6, column]).all()
        assert np.isfinite(high.values[row - 7, column])


def test_a_source_in_a_mountain_pulls_upwards_in_the_valley():
    """The field of one source anywhere on the ground: z / (2 pi r³) times the area of a cell."""
    nodes, step = 256, 200.0
    side = step * (np.arange(nodes) - nodes // 2)
    away2 = side[:, None] ** 2 + side[None, :] ** 2
    terrain = 1500.0 * np.exp(-away2 / 2500.0**2)
    weight = np.ones(nodes, dtype=np.float32)
    layer = source_layer.SourceLayer(
        terrain.astype(np.float32), step, [source_layer.Scale(step, weight)]
    )
    density = np.zeros((nodes, nodes), dtype=np.float32)
    density[nodes // 2, nodes // 2] = 1.0
    density[0, 0] = -1.0  # far away: on a torus only the sum zero has a field
    above = terrain - (1500.0 - source_layer.DEPTH * layer.spacing)
    right = step**2 * above / (2.0 * np.pi * (away2 + above**2) ** 1.5)
    summit, valley = away2 < 500.0**2, (away2 > 2400.0**2) & (away2 < 6000.0**2)
    assert right[valley].max() < 0.0 < right[summit].min()
    field = layer.field(density)
    for place in (summit, valley):
        assert np.abs(field - right)[place].max() < 0.03 * np.abs(right[place]).max()
    for height in (700.0, 2500.0):
        above = height - (1500.0 - source_layer.DEPTH * layer.spacing)
        right = step**2 * above / (2.0 * np.pi * (away2 + above**2) ** 1.5)
        place = (terrain < height) & (away2 < 6000.0**2)
        error = np.abs(layer.field_at(density, height) - right)[place].max()
        assert error < 0.03 * np.abs(right[place]).max()


def test_what_cannot_be_continued_from_the_ground_is_refused(mountain_map):
    low, terrain = mountain_map
    bare = terrain.values.copy()
    bare[:60] = np.nan
    for ground, height, words in (
        (low, 3000.0, "must be a map of height, is one of disturbance"),
        (terrain, -10.0, "-10 m is below the ground everywhere"),
        (replace(terrain, values=bare), 3000.0, "on 30 % of the map either its value or the"),
    ):
        with refusal(words):
            from_terrain(low, ground, height)


def test_harmonica_finds_the_same_field(mountain_map):
    """Equivalent sources of another implementation, in part of the map: they agree within 1 % of
    the field, away from the rim of that part."""
    harmonica = pytest.importorskip("harmonica", reason="harmonica is not installed (optional)")
    low, terrain = mountain_map
    part, inner = slice(72, 129), slice(18, -18)
    ground = terrain.values[part, part]
    height = float(ground.max()) + 200.0
    own = from_terrain(low, terrain, height, edge=5e3).values[part, part]
    north, east = np.meshgrid(SIDE[part], SIDE[part], indexing="ij")
    equivalent = harmonica.EquivalentSources(depth=1500.0, damping=1e-6)
    equivalent.fit((east, north, ground), low.values[part, part] / MGAL)
    other = MGAL * equivalent.predict((east, north, np.full_like(east, height)))
    assert rms((own - other)[inner, inner]) < 0.01 * rms(other[inner, inner])
