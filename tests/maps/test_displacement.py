"""By how much gridded maps may show anomalies beside their place."""

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of, wavy
from isogal.maps.displacement import SIZE, displacement, displacement_at
from isogal.maps.error_ellipses import ellipses_of

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
