"""Bicubic kernel: exactness, gradients, missing nodes, wrapping."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isogal.maps.interpolation import (
    Grid,
    bilinear_at,
    look_up,
    value_and_gradient,
    values_and_gradients,
    values_at,
)

LAT0, DLAT, LON0, DLON = -0.65, 3.5e-5, 2.5, 4.0e-5


def grid_of(values, *axes):
    return Grid(values, len(values), *axes)


def noise_grid(n=30, m=40, seed=1):
    return np.random.default_rng(seed).normal(size=(n, m))


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_passes_through_the_nodes(dtype):
    values = noise_grid().astype(dtype)
    for i, j in [(2, 2), (5, 7), (26, 30), (27, 37)]:
        v, _, _ = value_and_gradient(
            grid_of(values, LAT0, DLAT, LON0, DLON), LAT0 + i * DLAT, LON0 + j * DLON
        )
        assert v == pytest.approx(float(values[i, j]), abs=1e-7)


def test_exact_for_quadratics():
    """Cubic convolution with a = -1/2 reproduces polynomials up to second degree (Keys 1981)."""
    i, j = np.mgrid[0:20, 0:25].astype(float)
    values = 3.0 + 2.0 * i - j + 0.5 * i * j + 0.25 * i**2 - 0.125 * j**2
    y, x = 7.3, 11.8
    v, by_lat, by_lon = value_and_gradient(
        grid_of(values, 0.1, DLAT, LON0, DLON), 0.1 + y * DLAT, LON0 + x * DLON
    )
    assert v == pytest.approx(
        3.0 + 2.0 * y - x + 0.5 * y * x + 0.25 * y**2 - 0.125 * x**2, abs=1e-9
    )
    assert by_lat * DLAT == pytest.approx(2.0 + 0.5 * x + 0.5 * y, abs=1e-8)
    assert by_lon * DLON == pytest.approx(-1.0 + 0.5 * y - 0.25 * x, abs=1e-8)


@settings(max_examples=200, deadline=None)
@given(st.floats(1.001, 27.999), st.floats(1.001, 37.999))
def test_gradient_is_the_derivative_of_the_value(y, x):
    grid = grid_of(noise_grid(), 0.0, 1.0, 0.0, 0.01)
    step = 1e-5
    if any(abs(q - round(q)) < 2 * step for q in (y, x)):
        return  # the second derivative jumps at nodes: central differences are less accurate
    _, by_lat, by_lon = value_and_gradient(grid, y, 0.01 * x)
    up, down = (value_and_gradient(grid, y + s, 0.01 * x)[0] for s in (step, -step))
    right, left = (value_and_gradient(grid, y, 0.01 * (x + s))[0] for s in (step, -step))
    assert by_lat == pytest.approx((up - down) / (2 * step), abs=1e-6)
    assert by_lon * 0.01 == pytest.approx((right - left) / (2 * step), abs=1e-6)


@pytest.mark.parametrize("di,dj", [(a, b) for a in (-1, 0, 1, 2) for b in (-1, 0, 1, 2)])
def test_any_of_the_sixteen_nodes_missing_gives_nan(di, dj):
    values = noise_grid()
    values[10 + di, 12 + dj] = np.nan
    out = value_and_gradient(grid_of(values, 0.0, 1.0, 0.0, 0.01), 10.4, 0.126)
    assert all(math.isnan(x) for x in out)
    assert np.isfinite(value_and_gradient(grid_of(values, 0.0, 1.0, 0.0, 0.01), 20.4, 0.226)).all()


@pytest.mark.parametrize(
    "y,x",
    [
        (0.99, 5.0),
        (28.01, 5.0),
        (5.0, 0.99),
        (5.0, 38.01),
        (-3.0, 5.0),
        (5.0, 500.0),
        (math.nan, 5.0),
        (5.0, math.nan),
        (math.inf, 5.0),
        (5.0, -math.inf),
    ],
)
def test_outside_is_nan_never_an_edge_value(y, x):
    assert all(
        math.isnan(v)
        for v in value_and_gradient(
            grid_of(noise_grid(), 0.0, 0.01, 0.0, 0.01), 0.01 * y, 0.01 * x
        )
    )


@pytest.mark.parametrize("turns", [-2, -1, 1])
def test_longitudes_differ_by_whole_circles(turns):
    values = noise_grid()
    here = value_and_gradient(
        grid_of(values, LAT0, DLAT, LON0, DLON), LAT0 + 7.2 * DLAT, LON0 + 9.1 * DLON
    )
    there = value_and_gradient(
        grid_of(values, LAT0, DLAT, LON0, DLON),
        LAT0 + 7.2 * DLAT,
        LON0 + 9.1 * DLON + turns * 2 * math.pi,
    )
    np.testing.assert_allclose(here, there, rtol=1e-7)


def test_a_grid_round_the_earth_wraps():
    m = 360
    lon = np.radians(np.arange(m))
    values = np.repeat(np.sin(3 * lon)[None, :], 8, axis=0)
    for degrees in (-0.3, 0.2, 359.7, 180.5, 719.9):
        v, _, by_lon = value_and_gradient(
            grid_of(values, 0.0, 0.01, 0.0, math.radians(1.0)), 0.035, math.radians(degrees)
        )
        assert v == pytest.approx(math.sin(3 * math.radians(degrees)), abs=1e-4)
        assert by_lon == pytest.approx(3 * math.cos(3 * math.radians(degrees)), abs=1e-2)


def test_array_versions_equal_the_single_point():
    values = noise_grid()
    rng = np.random.default_rng(3)
    lat, lon = rng.uniform(-1.0, 31.0, 500), 0.01 * rng.uniform(-1.0, 41.0, 500)
    single = np.array(
        [
            value_and_gradient(grid_of(values, 0.0, 1.0, 0.0, 0.01), a, b)
            for a, b in zip(lat, lon, strict=True)
        ]
    )
    many = np.stack(values_and_gradients(grid_of(values, 0.0, 1.0, 0.0, 0.01), lat, lon), axis=1)
    np.testing.assert_array_equal(single, many)
    np.testing.assert_array_equal(
        single[:, 0], values_at(grid_of(values, 0.0, 1.0, 0.0, 0.01), lat, lon)
    )


@pytest.mark.parametrize("around", [False, True], ids=["part", "round the Earth"])
def test_look_up_equals_the_single_point_to_the_last_digit(around):
    """Outside, at missing nodes, a whole circle away and in the second map as well."""
    values = noise_grid(60, 40)
    values[12, 17] = np.nan
    step = 2.0 * math.pi / 40 if around else 0.01
    grid = Grid(values, 30, 0.0, 1.0, 0.0, step)
    rng = np.random.default_rng(5)
    lat, lon = rng.uniform(-1.0, 31.0, 500), step * rng.uniform(-1.0, 41.0, 500)
    lat[0], lon[0] = np.nan, np.nan
    lon[250:] += 2.0 * math.pi
    row, column, out = np.empty(500, int), np.empty(500, int), np.empty(500)
    for channel in (0, 1):
        single = [value_and_gradient(grid, *p, channel)[0] for p in zip(lat, lon, strict=True)]
        look_up(grid, lat.copy(), lon.copy(), channel, row, column, out)
        np.testing.assert_array_equal(out, single)
        assert 200 < np.isfinite(out).sum() < 500


def test_bilinear_stays_between_its_nodes_and_is_nan_outside():
    values = np.abs(noise_grid())
    rng = np.random.default_rng(4)
    lat, lon = rng.uniform(0.0, 29.0, 300), 0.01 * rng.uniform(0.0, 39.0, 300)
    out = bilinear_at(grid_of(values, 0.0, 1.0, 0.0, 0.01), lat, lon)
    i, j = lat.astype(int), np.minimum((lon / 0.01).astype(int), 38)
    corners = np.stack([values[i, j], values[i + 1, j], values[i, j + 1], values[i + 1, j + 1]])
    assert (out >= corners.min(axis=0) - 1e-12).all() and (
        out <= corners.max(axis=0) + 1e-12
    ).all()
    assert np.isnan(
        bilinear_at(
            grid_of(values, 0.0, 1.0, 0.0, 0.01), np.array([-0.1, 29.1]), np.array([0.1, 0.1])
        )
    ).all()
