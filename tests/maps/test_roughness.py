"""How rough maps are, and by how much gridded ones may show anomalies beside their place."""

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.maps.displacement import SIZE, displacement, displacement_at
from isogal.maps.error_ellipses import ellipses_of
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
    for power in (1.2, 2.0):
        noise = np.fft.fft2(random.standard_normal((256, 256)))
        fine = np.fft.ifft2(noise * k**-power).real
        coarse = FieldMap(side[::2], side[::2], fine[::2, ::2], "m/s²", "disturbance")
        inner = slice(21, 235, 2)
        lat, lon = np.meshgrid(side[inner], side[inner], indexing="ij")
        left_out = fine[inner, inner] - coarse.value(lat, lon)
        shares.append(np.sqrt((left_out**2).mean()) / coarse.roughness)
    assert 0.25 < min(shares) < max(shares) < 1.0


ELLIPSE = ellipses_of(np.array(2000.0), np.array(2000.0), np.array(0.0))


def gridded(sigma: float, height: float = 1.0):
    """A map whose hills are so high and which says its error place by place."""
    plain = field_map_of(wavy)
    return field_map_of(
        lambda north, east: height * wavy(north, east),
        sigma=np.full(plain.shape, sigma),
        correlation_length=2000.0,
        error_ellipses=np.broadcast_to(ELLIPSE, (*plain.shape, 3)),
    )


def test_it_turns_what_a_map_shows_into_its_error():
    # of a map that tells nothing a share of the length, else sigma over the rms slope S / length
    assert displacement(2000.0, 4.0, 0.0) == pytest.approx(SIZE * 2000.0)
    assert displacement(2000.0, 1.0, 1e4) == pytest.approx(SIZE * 2000.0 / 100.0, rel=1e-3)


def test_an_exact_map_and_one_without_lengths_of_its_errors_are_not_displaced():
    place = np.full(3, ORIGIN[0]), np.full(3, ORIGIN[1])
    assert not displacement_at(gridded(0.0), *place).any()
    assert not displacement_at(field_map_of(wavy, sigma=1e-5), *place).any()


def test_where_the_map_varies_less_it_may_be_displaced_more():
    place = ORIGIN[0] + np.linspace(-1e-3, 1e-3, 5), np.full(5, ORIGIN[1])
    little, much = (displacement_at(gridded(2e-5, height), *place) for height in (1.0, 0.1))
    assert (much > 1.5 * little).all()
    assert (much < SIZE * 2000.0).all()
    assert (little > 0.0).all()
