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


COLUMN = np.array([[1.0], [-2.0], [3e3]])
FULL = np.array([[4.0, 1.0, -2e3], [1.0, 3.0, 0.0], [-2e3, 0.0, 5e6]])


@pytest.mark.parametrize(
    "matrix",
    [FULL, FULL - 5.0 * np.eye(3), COLUMN @ COLUMN.T, np.eye(7), np.zeros((2, 2))],
    ids=["definite", "indefinite", "singular", "equal eigenvalues", "nothing"],
)
def test_a_square_root_is_that_of_the_positive_part(matrix):
    values, vectors = np.linalg.eigh(matrix)
    size = max(np.abs(values).max(), 1e-300)
    positive = vectors * np.maximum(values, 0.0) @ vectors.T
    half = square_root(matrix)
    np.testing.assert_allclose(half @ half.T / size, positive / size, atol=1e-14)
