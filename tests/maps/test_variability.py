"""Map feature variability (paper eq. CV)."""

import numpy as np
import pytest

from helpers.batches import ORIGIN, field_map_of
from isogal.errors import InputError
from isogal.maps.variability import feature_variability, normalised_variability, template

LAT, LON = ORIGIN


def plane(slope_north, slope_east, missing=np.s_[:0]):
    """Map whose value changes by so much per metre (nearly: metres are taken at one latitude)."""
    field_map = field_map_of(lambda n, e: slope_north * n + slope_east * e, step=1000.0)
    field_map.values[missing] = np.nan
    return field_map


def test_by_hand_on_a_plane():
    """Slope a to the north: the mean of (a·north)² over the template."""
    a = 1e-2
    north, east = template(1000.0, 5)
    expected = np.mean((a * north) ** 2)
    assert north.size == east.size == 24
    assert expected == pytest.approx(a**2 * 1000.0**2 * (2 * 5 * (1.0 + 0.25)) / 24)
    # of a fixed size in metres: in both directions the same
    for slopes in ((a, 0.0), (0.0, a)):
        found = feature_variability(plane(*slopes), LAT, LON, 1000.0, 5)
        assert found == pytest.approx(expected, rel=1e-6)
    assert feature_variability(plane(0.0, 0.0), LAT, LON) == 0.0


def test_missing_values():
    hole = np.s_[38:, :]  # rows north of 2 km south of the place
    assert np.isnan(feature_variability(plane(1e-2, 0.0, hole), LAT, LON))
    far = np.s_[43:, :]  # only the north edge of a wide template
    assert np.isfinite(feature_variability(plane(1e-2, 0.0, far), LAT, LON, 1500.0))
    assert np.isnan(feature_variability(plane(1e-2, 0.0), LAT + 0.5, LON))


def test_normalisation_over_a_fixed_number_of_samples():
    c = np.array([1.0, 3.0, 2.0, np.nan, 4.0, 0.0])
    expected = [1.0, 1.5, 0.8, np.nan, 1.0, 0.0]
    np.testing.assert_allclose(normalised_variability(np.stack([c, 2 * c]), 2), [expected] * 2)
    np.testing.assert_allclose(normalised_variability(np.zeros(3)), np.zeros(3))
    np.testing.assert_allclose(normalised_variability(c, 100)[:3], [1.0, 1.5, 1.0])


def test_bad_settings():
    for size in (1000.0, 4), (-1.0, 3):
        with pytest.raises(InputError):
            template(*size)
    with pytest.raises(InputError):
        normalised_variability([1.0], 0)
