"""Bicubic kernel: exactness, gradients, missing nodes, wrapping."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from isogal.maps.interpolation import (
    Grid,
    look_up,
    value_and_gradient,
    values_and_gradients,
    values_at,
)

STEP = 0.01


def grid_of(values, step=STEP, rows=None):
    """Rows 1 rad apart, columns a step."""
    return Grid(values, rows or len(values), 0.0, 1.0, 0.0, step)


def noise(n=30, m=40, seed=1):
    return np.random.default_rng(seed).normal(size=(n, m))


def test_exact_for_quadratics():
    """Cubic convolution with a = -1/2 reproduces polynomials up to second degree (Keys 1981)."""
    i, j = np.mgrid[0:20, 0:25].astype(float)
    y, x = 7.3, 11.8

    def field(y, x):
        return 3.0 + 2.0 * y - x + 0.5 * y * x + 0.25 * y**2 - 0.125 * x**2

    value, by_lat, by_lon = value_and_gradient(grid_of(field(i, j)), y, x * STEP)
    assert value == pytest.approx(field(y, x), abs=1e-9)
    assert by_lat == pytest.approx(2.0 + 0.5 * x + 0.5 * y, abs=1e-8)
    assert by_lon * STEP == pytest.approx(-1.0 + 0.5 * y - 0.25 * x, abs=1e-8)


@settings(max_examples=100, deadline=None)
@given(st.floats(1.001, 27.999), st.floats(1.001, 37.999))
def test_gradient_is_the_derivative_of_the_value(y, x):
    grid, step = grid_of(noise()), 1e-5
    if any(abs(q - round(q)) < 2 * step for q in (y, x)):
        return  # the second derivative jumps at nodes: central differences are less accurate
    _, by_lat, by_lon = value_and_gradient(grid, y, STEP * x)
    up, down = (value_and_gradient(grid, y + s, STEP * x)[0] for s in (step, -step))
    right, left = (value_and_gradient(grid, y, STEP * (x + s))[0] for s in (step, -step))
    assert by_lat == pytest.approx((up - down) / (2 * step), abs=1e-6)
    assert by_lon * STEP == pytest.approx((right - left) / (2 * step), abs=1e-6)


def test_any_of_the_sixteen_nodes_missing_gives_nan():
    for i in range(-1, 3):
        for j in range(-1, 3):
            values = noise()
            values[10 + i, 12 + j] = np.nan
            assert np.isnan(value_and_gradient(grid_of(values), 10.4, 0.126)).all(), (i, j)
            assert np.isfinite(value_and_gradient(grid_of(values), 20.4, 0.226)).all()


def test_outside_is_nan_never_an_edge_value():
    for y in (0.99, 28.01, -3.0, math.nan, math.inf, 5.0):
        for x in (0.99, 38.01, 500.0, math.nan, -math.inf, 5.0):
            found = np.isnan(value_and_gradient(grid_of(noise()), y, STEP * x))
            assert found.all() if (y, x) != (5.0, 5.0) else not found.any(), (y, x)


def test_longitudes_differ_by_whole_circles():
    here = value_and_gradient(grid_of(noise()), 7.2, 9.1 * STEP)
    for turns in (-2, 1):
        there = value_and_gradient(grid_of(noise()), 7.2, 9.1 * STEP + turns * 2 * math.pi)
        np.testing.assert_allclose(here, there, rtol=1e-7)


def test_a_grid_round_the_earth_wraps():
    values = np.sin(3 * np.radians(np.arange(360))) * np.ones((8, 1))
    for degrees in (-0.3, 0.2, 359.7, 180.5, 719.9):
        at = math.radians(degrees)
        value, _, by_lon = value_and_gradient(grid_of(values, math.radians(1.0)), 3.5, at)
        assert value == pytest.approx(math.sin(3 * at), abs=1e-4)
        assert by_lon == pytest.approx(3 * math.cos(3 * at), abs=1e-2)


@pytest.mark.parametrize("around", [False, True], ids=["part", "round the Earth"])
def test_array_versions_equal_the_single_point_to_the_last_digit(around):
    """Outside, at missing nodes, a whole circle away and in the second map as well."""
    values = noise(60, 40)
    values[12, 17] = np.nan
    step = 2.0 * math.pi / 40 if around else STEP
    grid = grid_of(values, step, rows=30)
    rng = np.random.default_rng(5)
    lat, lon = rng.uniform(-1.0, 31.0, 500), step * rng.uniform(-1.0, 41.0, 500)
    lat[0], lon[0] = np.nan, np.nan
    lon[250:] += 2.0 * math.pi
    row, column, out = np.empty(500, int), np.empty(500, int), np.empty(500)
    for channel in (0, 1):
        single = np.array(
            [value_and_gradient(grid, *p, channel) for p in zip(lat, lon, strict=True)]
        )
        look_up(grid, lat.copy(), lon.copy(), channel, row, column, out)
        np.testing.assert_array_equal(out, single[:, 0])
        assert 200 < np.isfinite(out).sum() < 500
        if channel == 0:
            many = np.stack(values_and_gradients(grid, lat, lon), axis=1)
            np.testing.assert_array_equal(many, single)
            np.testing.assert_array_equal(values_at(grid, lat, lon), single[:, 0])
