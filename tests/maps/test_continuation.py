"""Continuation from level to level, in blocks and from mountains, against point masses, whose
fields are known at all heights."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.point_masses import HALF, MGAL, SIDE, attraction, drawn_errors, map_of, mountains, rms
from helpers.refusals import refusal
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps.axes import Window
from isogal.maps.continuation import blocks, source_layer
from isogal.maps.continuation.level import to_level
from isogal.maps.continuation.terrain import from_terrain
from isogal.maps.error_spectrum import ErrorSpectrum
from isogal.maps.potential import INDEPENDENT, VECTOR, derivatives


def test_the_rim(rough_map):
    """Part of a map against the same part of the whole map: within 21 % of the field at the rim
    (mirrored without the slope: 23 %), and within 2 % five heights from it."""
    inner = slice(60, -60)
    right = to_level(rough_map, 1000.0, 0.0).values[inner, inner]
    part = rough_map.part(inner, inner)
    error = to_level(part, 1000.0, 0.0, edge=0.0).values - right
    assert rms(error[:4]) < 0.21 * rms(right)
    assert rms(error[20:-20, 20:-20]) < 0.02 * rms(right)


def test_gradients_and_horizontal_components_upwards():
    low = map_of(attraction(0.0))
    for names in (INDEPENDENT, VECTOR):
        at_ground, above = (derivatives(low, names, height=h).channels for h in (0.0, 800.0))
        for one, right in zip(at_ground, above, strict=True):
            high = to_level(one, 800.0, 0.0)
            rim = (right.values.shape[0] - high.values.shape[0]) // 2
            expected = right.values[rim:-rim, rim:-rim]
            assert rms(high.values - expected) < 0.03 * rms(right.values), one.quantity


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


def test_gain_and_length_of_errors_upwards_are_those_of_the_closed_form():
    """Variance 1 - a π/2 (H0(a) - Y0(a)), a = 2h / L; length from L to 1.95 h."""
    from scipy.special import struve, y0

    spectrum = ErrorSpectrum.of_grid((20.0, 20.0), 4000.0)
    for height in (100.0, 10e3):
        a = 2.0 * height / 4000.0
        variance = 1.0 - a * np.pi / 2.0 * (struve(0, a) - y0(a))
        gain = spectrum.gain(lambda k, h=height: np.exp(-h * k))
        assert gain**2 == pytest.approx(variance, rel=3e-3)
    heights = 0.0, 100.0, 1000.0, 1e5
    lengths = [spectrum.length(lambda k, h=height: np.exp(-h * k)) for height in heights]
    assert lengths[0] == pytest.approx(4000.0, rel=3e-3)
    assert lengths == sorted(lengths)
    assert lengths[3] == pytest.approx(1.947e5, rel=0.02)


@pytest.mark.parametrize(
    ("changes", "keys", "message"),
    [
        ({"quantity": "gravity"}, {}, r"a map of gravity cannot be continued \(take the dist"),
        ({"height": None}, {}, r"give from_height \(--from-height\), or the terrain"),
        ({}, {"height": np.nan}, "height to continue to must be finite"),
        ({}, {"from_height": np.inf}, "height to continue from must be finite"),
        ({}, {"edge": -1.0}, "edge of the continuation must be >= 0 m"),
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


def test_blocks_away_from_where_the_result_is_needed_are_not_computed(monkeypatch):
    low = map_of(attraction(0.0))
    whole = blocks.continued(low, 100.0, 0.0)
    monkeypatch.setattr(blocks, "_SIDE_CELLS", 60)
    corner = Window(low.latitude[5], low.latitude[40], low.longitude[5], low.longitude[40])
    part = blocks.continued(low, 100.0, 0.0, window=corner)
    assert not np.isfinite(part.values[60:]).any()
    assert not np.isfinite(part.values[:, 60:]).any()
    np.testing.assert_allclose(
        part.window(*corner[:4]).values, whole.window(*corner[:4]).values, atol=0.03 * MGAL
    )


def test_blocks_are_not_smaller_than_their_rim(monkeypatch):
    """Else each place of a map is computed a hundred times: for minutes, at a height of 50 km."""
    low = map_of(attraction(0.0))
    monkeypatch.setattr(blocks, "_SIDE_CELLS", 10)
    outer = [low.part(*block.outer).values.size for block in blocks._blocks(low, 30e3)]
    assert sum(outer) < 10 * low.values.size


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


def test_errors_are_those_of_a_whole_map():
    low = map_of(attraction(0.0), sigma=MGAL, correlation_length=3000.0, quantisation=0.1 * MGAL)
    whole, high = to_level(low, 500.0, 0.0), blocks.continued(low, 500.0, 0.0)
    beyond = 0.07 * 500.0 / 10e3 * low.values.std()
    assert high.sigma == pytest.approx(np.hypot(whole.sigma, beyond), rel=1e-3)
    assert high.correlation_length == pytest.approx(whole.correlation_length, rel=0.02)
    assert high.quantisation == 0.0
    assert blocks.continued(low, 70.0, 70.0) is low


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
