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
