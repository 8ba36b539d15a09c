"""Continuation from level to level, in blocks and from mountains, against point masses, whose
fields are known at all heights."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.point_masses import HALF, MGAL, SIDE, attraction, drawn_errors, map_of, mountains, rms
from helpers.refusals import refusal
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps.continuation import blocks
from isogal.maps.continuation.level import to_level
from isogal.maps.continuation.terrain import from_terrain


@pytest.mark.parametrize(("height", "cutoff"), [(500.0, 2000.0), (1000.0, 4000.0)])
def test_downwards_comes_back_within_the_error_stated(height, cutoff):
    """Values on the upper level are wrong by white noise of 0.01 mGal."""
    noise = 0.01 * MGAL * drawn_errors(0)
    steps = 0.01 * MGAL * np.sqrt(12.0)
    high = map_of(attraction(height) + noise, height=height, quantisation=steps)
    low = to_level(high, 0.0, cutoff=cutoff)
    error = rms(low.values - attraction(0.0))
    assert 0.8 < low.sigma / error < 8.0
    assert error < 0.25 * MGAL
    assert low.quantisation == 0.0


@pytest.mark.parametrize("length", [None, 3000.0])
@pytest.mark.parametrize(("height", "cutoff"), [(800.0, None), (-400.0, 2500.0)])
def test_errors_of_the_map_go_through_the_continuation(length, height, cutoff):
    """Draws of white noise or of a field with covariance exp(-d / L), against sigma."""
    squares = []
    for seed in range(4):
        draw = map_of(MGAL * drawn_errors(seed, length))
        squares.append(rms(to_level(draw, height, 0.0, cutoff=cutoff, edge=8e3).values) ** 2)
    white = {"quantisation": MGAL * np.sqrt(12.0)}
    stated = {"sigma": MGAL, "correlation_length": length} if length else white
    flat = map_of(0.0 * SIDE[:, None] * SIDE, **stated)
    continued = to_level(flat, height, 0.0, cutoff=cutoff, edge=8e3)
    assert continued.sigma == pytest.approx(np.sqrt(np.mean(squares)), rel=0.08)


@pytest.mark.parametrize(
    ("changes", "keys", "message"),
    [
        ({"quantity": "gravity"}, {}, r"a map of gravity cannot be continued \(take the dist"),
        ({"height": None}, {}, r"give from_height \(--from-height\), or the terrain"),
        ({}, {"height": np.nan}, "nothing is left of the map"),
        ({}, {"height": -300.0}, r"300 m down .* grow 6.5\d times, .*--downward-cutoff"),
        ({}, {"cutoff": 3e3}, "a cut-off wavelength is for downward continuation"),
        ({}, {"height": -300.0, "cutoff": 900.0}, r"must be 1 \(two cells\) to 100 km .* 0.9"),
        ({}, {"height": 20e3}, "nothing is left of the map within 100 km"),
    ],
)
def test_what_cannot_be_continued_is_refused(changes, keys, message):
    low = replace(map_of(attraction(0.0, count=3)), **({"height": 0.0} | changes))
    with pytest.raises(InputError, match=message):
        to_level(low, **({"height": 500.0} | keys))


def test_upwards(monkeypatch):
    """Within 0.03 mGal RMS of 2.5 mGal, in four blocks as in one, and sigma says so."""
    low, height = map_of(attraction(0.0)), 1000.0
    right = attraction(height)
    inner = slice(24, -24)
    for side in (500, 101):
        monkeypatch.setattr(blocks, "_SIDE_CELLS", side)
        high = blocks.continued(low, height, 0.0)
        error = rms((high.values - right)[inner, inner])
        assert error < 0.03 * MGAL
        assert high.sigma == pytest.approx(
            0.07 * height / blocks.rim_of(height) * low.values.std(), rel=1e-6
        )
        assert error < 3.0 * high.sigma
    kept = np.isfinite(high.values)
    assert kept.mean() == pytest.approx((1.0 - 5.0 * height / HALF) ** 2, abs=0.03)
    assert (high.height, high.quantity) == (height, "disturbance")


def test_downwards_with_the_cut_off_that_follows_from_the_way():
    """No wave of the map grows more than e times; sigma covers what is left out."""
    high = map_of(attraction(600.0), height=600.0)
    low, inner = blocks.continued(high, 100.0, 600.0), np.s_[24:-24, 24:-24]
    error, before = (rms((one.values - attraction(100.0))[inner]) for one in (low, high))
    assert error < before / 3.0
    assert error < 2.0 * float(low.sigma)
    assert blocks.continued(high, 100.0, 600.0, cutoff=12e3).sigma > low.sigma


def test_gravity_goes_by_way_of_its_disturbance():
    low = map_of(attraction(0.0))
    normal = normal_gravity(low.latitude)[:, None]
    gravity = replace(low, values=low.values + normal, quantity="gravity")
    high = blocks.continued(gravity, 500.0, 0.0)
    assert high.quantity == "gravity"
    np.testing.assert_allclose(
        high.values - normal, blocks.continued(low, 500.0, 0.0).values, atol=1e-12
    )


def test_holes_are_filled_and_what_is_near_them_is_left_out():
    """Half of the map is sea without values: the rest is as good as at a rim."""
    low = map_of(attraction(0.0), sigma=MGAL)
    bare = low.values.copy()
    bare[:, :100] = np.nan
    bare[150, 150] = np.nan
    uneven = np.where(np.isfinite(bare), MGAL, np.nan)
    high = blocks.continued(replace(low, values=bare, sigma=uneven), 400.0, 0.0)
    kept = np.isfinite(high.values)
    assert not kept[:, :104].any()
    assert not kept[147:154, 150].any()
    assert kept[60:140, 106:145].all()
    error = (high.values - attraction(400.0))[24:-24, 110:-24]
    assert rms(error) < 0.1 * MGAL
    sigma = np.asarray(high.sigma)
    assert 0.6 * MGAL < sigma[100, 130] < MGAL


def test_near_a_pole_blocks_are_small_and_where_nothing_is_left_it_is_said():
    low = map_of(attraction(0.0))
    north = replace(low, latitude=low.latitude - low.latitude.mean() + np.radians(80.0))
    assert np.isfinite(blocks.continued(north, 100.0, 0.0).values).mean() > 0.9
    with pytest.raises(InputError, match="nothing is left of the map 60000 m from its edges"):
        blocks.continued(low, 12000.0, 0.0)


@pytest.fixture(scope="module")
def mountain_map():
    """Values on mountains, and the heights of these."""
    ground = mountains()
    terrain = replace(map_of(ground), unit="m", quantity="height")
    return map_of(attraction(ground, ground), quantisation=0.01 * MGAL), terrain


@pytest.mark.parametrize("above", [100.0, 3000.0])
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
