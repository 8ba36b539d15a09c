"""Small matrices."""

import numpy as np
import pytest

from helpers.navigators import random_covariance
from isogal.matrices import inverse_of_lower, lower, square_root

SIGMA = np.array([300.0, 200.0, 0.3, 0.2, 5e-5, 5e-5, 5e-4])


@pytest.mark.parametrize("seed", range(5))
def test_cholesky_factor_and_its_inverse_are_those_of_numpy(seed):
    covariance = random_covariance(SIGMA, seed)
    factor = lower(covariance)
    unit = SIGMA[:, None]
    np.testing.assert_allclose(factor / unit, np.linalg.cholesky(covariance) / unit, atol=1e-12)
    np.testing.assert_allclose(inverse_of_lower(factor) @ factor, np.eye(7), atol=1e-9)
    covariance[3, 3] *= -1.0
    assert np.isnan(lower(covariance)[-1, -1])


def symmetric_ones():
    """Matrices that are full, singular, indefinite, diagonal, of equal eigenvalues or graded."""
    random = np.random.default_rng(3)
    for n in (1, 2, 3, 4, 7):
        full = random.standard_normal((n, n))
        column, scale = random.standard_normal((n, 1)), 10.0 ** random.uniform(-6, 3, n)
        yield from (full + full.T, column @ column.T, np.diag(column[:, 0]), np.eye(n))
        yield from (np.zeros((n, n)), np.ones((n, n)), full @ full.T * scale * scale[:, None])


@pytest.mark.parametrize("matrix", list(symmetric_ones()))
def test_a_square_root_is_that_of_the_positive_part(matrix):
    values, vectors = np.linalg.eigh(matrix)
    size = max(np.abs(values).max(), 1e-300)
    positive = vectors * np.maximum(values, 0.0) @ vectors.T
    half = square_root(matrix)
    np.testing.assert_allclose(half @ half.T / size, positive / size, atol=1e-14)
