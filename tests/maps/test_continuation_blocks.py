"""Continuation in blocks against point masses and against that of a whole map."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.point_masses import HALF, MGAL, attraction, map_of, rms
from isogal.earth.gravity import normal_gravity
from isogal.errors import InputError
from isogal.maps.continuation import blocks
from isogal.maps.continuation.level import to_level


@pytest.mark.parametrize("height", [100.0, 1000.0])
def test_upwards(height, monkeypatch):
    """Within 0.03 mGal RMS of 2.5 mGal, in four blocks as in one, and sigma says so."""
    low = map_of(attraction(0.0))
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


def test_errors_are_those_of_a_whole_map():
    low = map_of(attraction(0.0), sigma=MGAL, correlation_length=3000.0, quantisation=0.1 * MGAL)
    whole, high = to_level(low, 500.0, 0.0), blocks.continued(low, 500.0, 0.0)
    beyond = 0.07 * 500.0 / 10e3 * low.values.std()
    assert high.sigma == pytest.approx(np.hypot(whole.sigma, beyond), rel=1e-3)
    assert high.correlation_length == pytest.approx(whole.correlation_length, rel=0.02)
    assert high.quantisation == 0.0
    assert blocks.continued(low, 70.0, 70.0) is low


def test_near_a_pole_blocks_are_small():
    low = map_of(attraction(0.0))
    north = replace(low, latitude=low.latitude - low.latitude.mean() + np.radians(80.0))
    assert np.isfinite(blocks.continued(north, 100.0, 0.0).values).mean() > 0.9


def test_nothing_left_is_said():
    with pytest.raises(InputError, match="nothing is left of the map 60000 m from its edges"):
        blocks.continued(map_of(attraction(0.0)), 12000.0, 0.0)
