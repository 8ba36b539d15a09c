"""Quasi-random points against scipy's, and how well they integrate."""

import numpy as np
import pytest
from scipy.stats import norm, qmc

from isogal.matching.quasi_random import DIGITS, MOST_DIMENSIONS, _directions, normal, sobol


def test_direction_numbers_are_scipys() -> None:
    count = 4096
    expected = qmc.Sobol(MOST_DIMENSIONS, scramble=False, bits=DIGITS).random(count)
    index = np.arange(count)
    gray = (index ^ index >> 1)[:, None] >> np.arange(12) & 1
    for dimension in range(MOST_DIMENSIONS):
        digits = gray @ _directions(dimension, 12).T & 1
        np.testing.assert_array_equal(
            digits @ 0.5 ** np.arange(1, DIGITS + 1), expected[:, dimension]
        )


@pytest.mark.parametrize("seed", range(5))
def test_every_interval_has_its_point(seed: int) -> None:
    """A (0, m, 1) net in each coordinate, which scrambling keeps; a (0, m, 2) net in the first
    two."""
    points = sobol(256, MOST_DIMENSIONS, seed)
    assert points.min() > 0.0
    assert points.max() < 1.0
    for column in points.T:
        np.testing.assert_array_equal(np.sort((column * 256).astype(int)), np.arange(256))
    for bits in range(9):
        cells = (points[:, 0] * 2**bits).astype(int) * 2 ** (8 - bits) + (
            points[:, 1] * 2 ** (8 - bits)
        ).astype(int)
        np.testing.assert_array_equal(np.sort(cells), np.arange(256))


@pytest.mark.parametrize("count", [256, 512])
def test_as_even_as_scipys(count: int) -> None:
    ours = [qmc.discrepancy(sobol(count, 5, seed)) for seed in range(20)]
    theirs = [qmc.discrepancy(qmc.Sobol(5, seed=seed).random(count)) for seed in range(20)]
    assert np.mean(ours) < 1.1 * np.mean(theirs)


def test_seeds_differ_and_repeat() -> None:
    assert (sobol(64, 4, 1) == sobol(64, 4, 1)).all()
    assert (sobol(64, 4, 1) != sobol(64, 4, 2)).all()
    np.testing.assert_array_equal(sobol(64, 4, 1)[:10], sobol(10, 4, 1)[:10])


def test_normal_points() -> None:
    points = sobol(1024, 4, 3)
    x = normal(points)
    np.testing.assert_allclose(x, norm.ppf(points), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(x.mean(axis=0), 0.0, atol=0.01)
    np.testing.assert_allclose(np.cov(x.T), np.eye(4), atol=0.03)


def test_refuses_what_it_cannot_do() -> None:
    for count, dimensions in ((8, 7), (8, 0), (0, 2)):
        with pytest.raises(ValueError, match="at most 6"):
            sobol(count, dimensions, 0)
