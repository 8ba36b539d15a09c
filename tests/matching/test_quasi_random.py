"""How even quasi-random points are, and that they are always the same."""

import numpy as np

from isogal.matching.quasi_random import standard_normal


def test_moments_are_those_of_a_standard_normal() -> None:
    """Of 1,000 random points a mean is off by 0.03, a variance by 0.045."""
    x = standard_normal(1000, 4)
    assert x.shape == (1000, 4)
    np.testing.assert_allclose(x.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose(np.cov(x.T), np.eye(4), atol=0.03)


def test_points_are_fixed() -> None:
    x = standard_normal(300, 2).copy()
    standard_normal.cache_clear()
    np.testing.assert_array_equal(standard_normal(300, 2), x)
    np.testing.assert_array_equal(standard_normal(100, 2), x[:100])
