"""Continuation against point masses and dipoles, whose fields are known at all heights."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of
from isogal.errors import InputError
from isogal.maps.continuation import source_layer
from isogal.maps.continuation.level import to_level
from isogal.maps.continuation.terrain import from_terrain
from isogal.maps.error_spectrum import ErrorSpectrum
from isogal.maps.gradients import tensor_maps
from isogal.maps.gravity_vector import horizontal_gravity

MGAL = 1e-5
HALF, STEP = 50e3, 500.0
SIDE = np.arange(-HALF, HALF + STEP / 2, STEP)


def sources(seed=5, count=100, shallowest=1500.0):
    """North, east, depth and GM of point masses below the ground."""
    draw = np.random.default_rng(seed)
    north, east = draw.uniform(-0.7 * HALF, 0.7 * HALF, (2, count))
    depth = draw.uniform(shallowest, 5e3, count)
    return north, east, depth, draw.standard_normal(count) * depth**2 * 5 * MGAL


def attraction(height, ground=None, **keys):
    """Downward attraction (n, m) of the masses at heights (n, m) or a height; their depths count
    from the ground above them."""
    total = np.zeros((SIDE.size, SIDE.size))
    for north, east, depth, gm in zip(*sources(**keys), strict=True):
        node = tuple(np.rint((np.array([north, east]) + HALF) / STEP).astype(int))
        above = height + depth - (0.0 if ground is None else ground[node])
        horizontal = (SIDE[:, None] - north) ** 2 + (SIDE[None, :] - east) ** 2
        total += gm * above / (horizontal + above**2) ** 1.5
    return total


def map_of(values, **keys):
    return replace(
        field_map_of(lambda n, e: 0.0 * n * e, half=HALF, step=STEP, **keys), values=values
    )


def mountains(rms=300.0, seed=3):
    """Fractal terrain (n, m), m, from zero to 2 km."""
    size = 2 * SIDE.size
    k = (
        2.0
        * np.pi
        * np.hypot(np.fft.fftfreq(size, STEP)[:, None], np.fft.rfftfreq(size, STEP)[None, :])
    )
    white = np.random.default_rng(seed).standard_normal((size, size))
    spectrum = np.fft.rfft2(white) * np.maximum(k, 2.0 * np.pi / 25e3) ** -2.0
    terrain = np.fft.irfft2(spectrum)[: SIDE.size, : SIDE.size]
    terrain *= rms / terrain.std()
    return terrain - terrain.min()


def rms(values):
    return float(np.sqrt(np.nanmean(np.square(values))))


@pytest.mark.parametrize("height", [100.0, 1000.0, 4000.0])
def test_upwards_from_level_to_level(height):
    """Within 0.03 mGal RMS of 2.5 mGal."""
    low = map_of(attraction(0.0), height=50.0)
    high = to_level(low, height + 50.0)
    kept = np.isfinite(high.values)
    assert kept.mean() == pytest.approx((1.0 - 5.0 * height / HALF) ** 2, abs=0.03)
    assert rms(high.values - attraction(height)) < 0.03 * MGAL
    assert rms(high.values) < rms(low.values[kept])
    assert (high.height, high.sigma, high.quantity) == (height + 50.0, 0.0, "disturbance")


def test_upwards_in_two_steps_is_upwards_in_one():
    low = map_of(attraction(0.0))
    once = to_level(low, 1500.0, 0.0, edge=20e3)
    twice = to_level(to_level(low, 500.0, 0.0), 1500.0, edge=17.5e3)
    assert twice.values.shape == (191, 191)  # the rim that the first step leaves out is cut off
    assert rms(twice.values - once.values[5:-5, 5:-5]) < 2e-3 * rms(once.values)


def test_gradients_and_horizontal_components_upwards():
    low = map_of(attraction(0.0))
    for at_ground, above in (
        (tensor_maps(low), tensor_maps(low, height=800.0)),
        (horizontal_gravity(low), horizontal_gravity(low, 800.0)),
    ):
        for one, right in zip(at_ground.channels, above.channels, strict=True):
            high = to_level(one, 800.0, 0.0)
            rim = (right.values.shape[0] - high.values.shape[0]) // 2
            expected = right.values[rim:-rim, rim:-rim]
            assert rms(high.values - expected) < 0.03 * rms(right.values), one.quantity


def test_magnetic_anomaly_upwards():
    """The total-field anomaly of a vertical dipole in a vertical field, nT."""

    def anomaly(height, depth=3000.0, moment=1e9):
        z = height + depth
        r2 = SIDE[:, None] ** 2 + SIDE[None, :] ** 2 + z**2
        return 1e2 * moment * (3.0 * z**2 / r2 - 1.0) / r2**1.5

    low = map_of(anomaly(0.0))
    high = to_level(replace(low, unit="nT", quantity="magnetic_anomaly", height=0.0), 1200.0)
    assert high.unit == "nT"
    assert rms(high.values - anomaly(1200.0)) < 2e-3 * rms(anomaly(1200.0))


@pytest.mark.parametrize("cutoff", [2000.0, 3000.0, 4000.0])
@pytest.mark.parametrize("height", [500.0, 1000.0])
def test_downwards_comes_back_within_the_error_stated(height, cutoff):
    """Values on the upper level are wrong by white noise of 0.01 mGal."""
    noise = np.random.default_rng(0).standard_normal((SIDE.size, SIDE.size)) * 0.01 * MGAL
    high = map_of(
        attraction(height) + noise, height=height, quantisation=0.01 * MGAL * np.sqrt(12.0)
    )
    low = to_level(high, 0.0, cutoff=cutoff)
    error = rms(low.values - attraction(0.0))
    assert 0.8 < low.sigma / error < 8.0
    assert error < 0.25 * MGAL
    assert low.quantisation == 0.0


@pytest.mark.parametrize("length", [None, 3000.0])
@pytest.mark.parametrize(("height", "cutoff"), [(800.0, None), (-400.0, 2500.0)])
def test_errors_of_the_map_go_through_the_continuation(length, height, cutoff):
    """Draws of white noise or of a field with covariance exp(-d / L), against sigma."""
    size = 2 * SIDE.size
    away = STEP * np.minimum(np.arange(size), size - np.arange(size))
    covariance = (
        np.exp(-np.hypot(away[:, None], away) / length)
        if length
        else (np.hypot(away[:, None], away) == 0.0)
    )
    power = np.maximum(np.fft.fft2(covariance).real, 0.0)
    squares = []
    for seed in range(4):
        white = np.random.default_rng(seed).standard_normal((size, size))
        values = np.fft.ifft2(np.sqrt(power) * np.fft.fft2(white)).real
        draw = map_of(MGAL * values[: SIDE.size, : SIDE.size])
        squares.append(rms(to_level(draw, height, 0.0, cutoff=cutoff, edge=8e3).values) ** 2)
    told = (
        {"sigma": MGAL, "correlation_length": length}
        if length
        else {"quantisation": MGAL * np.sqrt(12.0)}
    )
    flat = replace(map_of(0.0 * SIDE[:, None] * SIDE), **told)
    continued = to_level(flat, height, 0.0, cutoff=cutoff, edge=8e3)
    assert continued.sigma == pytest.approx(np.sqrt(np.mean(squares)), rel=0.08)


def test_gain_and_length_of_errors_upwards_are_those_of_the_closed_form():
    """Variance 1 - a π/2 (H0(a) - Y0(a)), a = 2h / L; length from L to 1.95 h."""
    from scipy.special import struve, y0

    spectrum = ErrorSpectrum.of_grid((20.0, 20.0), 4000.0)
    for height in (100.0, 1000.0, 10e3):
        a = 2.0 * height / 4000.0
        variance = 1.0 - a * np.pi / 2.0 * (struve(0, a) - y0(a))
        assert spectrum.gain(lambda k, h=height: np.exp(-h * k)) ** 2 == pytest.approx(
            variance, rel=3e-3
        )
    lengths = [
        spectrum.length(lambda k, h=height: np.exp(-h * k), 1.0, 0.0)
        for height in (0.0, 100.0, 1000.0, 1e5)
    ]
    assert lengths[0] == pytest.approx(4000.0, rel=3e-3)
    assert lengths == sorted(lengths)
    assert lengths[3] == pytest.approx(1.947e5, rel=0.02)


def test_sigma_of_each_node_is_continued():
    sigma = MGAL * np.linspace(1.0, 2.0, SIDE.size)[:, None] * np.ones(SIDE.size)
    low = map_of(attraction(0.0), sigma=sigma, correlation_length=3000.0)
    high = to_level(low, 1000.0, 0.0)
    gain = ErrorSpectrum.of_grid((STEP, STEP), 3000.0).gain(lambda k: np.exp(-1000.0 * k))
    np.testing.assert_allclose(high.sigma, gain * sigma, rtol=1e-3)


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
    told = replace(low, sigma=MGAL, correlation_length=2000.0)
    sigma = np.asarray(from_terrain(told, terrain, float(terrain.values.max()) + 100.0).sigma)
    summit = np.unravel_index(np.argmax(terrain.values), sigma.shape)
    valley = np.unravel_index(np.argmin(terrain.values), sigma.shape)
    assert sigma[valley] < 0.8 * sigma[summit] < 0.8 * MGAL


def test_terrain_on_another_grid(mountain_map):
    low, terrain = mountain_map
    height = float(terrain.values.max()) + 500.0
    wide = replace(
        terrain,
        latitude=terrain.latitude[::2],
        longitude=terrain.longitude[::2],
        values=terrain.values[::2, ::2],
    )
    inner = slice(4, -4)
    cut = replace(
        low,
        latitude=low.latitude[inner],
        longitude=low.longitude[inner],
        values=low.values[inner, inner],
    )
    high = from_terrain(cut, wide, height)
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


def test_compiled_interpolation_is_that_of_numpy():
    draw = np.random.default_rng(0)
    density, plane = draw.standard_normal((2, 6, 7)).astype(np.float32)
    place = draw.uniform(2.0, 7.0, (6, 7)).astype(np.float32)
    nodes = np.arange(10)
    first = np.clip(np.floor(place).astype(int) - 1, 0, 6)
    weights = np.zeros((10, 6, 7))
    for i in range(4):
        others = [k for k in range(4) if k != i]
        weight = np.prod([(place - first - k) / (i - k) for k in others], axis=0)
        np.put_along_axis(weights, (first + i)[None], weight[None], axis=0)
    np.testing.assert_allclose(
        (weights * nodes[:, None, None] ** 3).sum(axis=0), place**3, rtol=1e-5
    )
    rows = draw.uniform(0.0, 1.0, 6).astype(np.float32)
    for level in nodes:
        spread, field = np.empty((2, 6, 7), dtype=np.float32)
        source_layer.spread(density, place, int(level), spread)
        np.testing.assert_allclose(spread, density * weights[level], atol=1e-5)
        field[:] = 1.0
        source_layer.gather(plane, place, int(level), rows, field)
        np.testing.assert_allclose(field, 1.0 + rows[:, None] * plane * weights[level], atol=1e-5)


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


def test_what_cannot_be_continued_from_the_ground_is_refused(mountain_map):
    low, terrain = mountain_map
    with pytest.raises(InputError, match="must be a map of height, is one of disturbance"):
        from_terrain(low, low, 3000.0)
    with pytest.raises(InputError, match="-10 m is below the ground everywhere"):
        from_terrain(low, terrain, -10.0)
    bare = terrain.values.copy()
    bare[:60] = np.nan
    with pytest.raises(InputError, match="on 30 % of the map either its value or the height"):
        from_terrain(low, replace(terrain, values=bare), 3000.0)


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
