"""How rough maps are: by formula, and what that says of a grid that is half as dense."""

import numpy as np
import pytest

from isogal.maps.field_map import FieldMap
from isogal.maps.roughness import roughness_at

SIDE = np.radians(np.linspace(-0.3, 0.3, 61))


def map_of(values):
    return FieldMap(SIDE, SIDE, values, "m/s²", "disturbance")


def test_a_plane_is_not_rough_and_a_wave_is_as_by_formula():
    row, column = np.meshgrid(np.arange(61.0), np.arange(61.0), indexing="ij")
    plane = map_of(1e-6 * row - 2e-6 * column)
    assert plane.roughness == pytest.approx(0.0, abs=1e-18)
    assert roughness_at(plane, SIDE[30:32], SIDE[30:32]) == pytest.approx(0.0, abs=1e-18)
    # a node less the mean of its neighbours: (1 - cos k) of a wave, and 0 along its crests
    wave = map_of(np.sin(0.8 * row))
    expected = (1.0 - np.cos(0.8)) * np.sqrt(0.5) * np.sqrt(0.5)
    assert wave.roughness == pytest.approx(expected, rel=0.02)
    here = roughness_at(wave, SIDE[20:40], SIDE[20:40])
    assert np.sqrt((here**2).mean()) == pytest.approx(expected, rel=0.1)


def test_it_is_local_and_knows_nothing_where_the_map_does_not():
    random = np.random.default_rng(3)
    values = 1e-6 * random.standard_normal((61, 61))
    values[:, 30:] *= 100.0
    values[:15] = np.nan
    one = map_of(values)
    west, east = roughness_at(one, SIDE[[40, 40]], SIDE[[10, 50]])
    assert 20.0 < east / west < 500.0
    assert np.isnan(roughness_at(one, SIDE[[5]], SIDE[[10]])).all()
    assert np.isnan(roughness_at(one, SIDE[[40]], SIDE[[10]] + 1.0)).all()


def test_a_grid_that_is_half_as_dense_leaves_out_a_share_of_it():
    """Fractal fields of some slopes: the models of `pmht` cover the share."""
    random = np.random.default_rng(5)
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(256), np.fft.fftfreq(256), indexing="ij"))
    k[0, 0] = np.inf
    side = np.radians(np.arange(256) * 0.01)
    shares = []
    for power in (1.2, 1.6, 2.0):
        noise = np.fft.fft2(random.standard_normal((256, 256)))
        fine = np.fft.ifft2(noise * k**-power).real
        coarse = FieldMap(side[::2], side[::2], fine[::2, ::2], "m/s²", "disturbance")
        inner = slice(21, 235, 2)
        lat, lon = np.meshgrid(side[inner], side[inner], indexing="ij")
        left_out = fine[inner, inner] - coarse.value(lat, lon)
        shares.append(np.sqrt((left_out**2).mean()) / coarse.roughness)
    assert 0.25 < min(shares) < max(shares) < 1.0
