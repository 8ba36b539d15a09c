"""Small matrices."""

import numpy as np
import pytest

from helpers.navigators import random_covariance
from isogal.matching.matrices import inverse, inverse_of_lower, lower

SIGMA = np.array([300.0, 200.0, 0.3, 0.2, 5e-5, 5e-5, 5e-4])


@pytest.mark.parametrize("seed", range(5))
def test_inverse_is_that_of_numpy(seed):
    random = np.random.default_rng(seed)
    matrix = random.standard_normal((7, 7))
    matrix[0, 0] = 0.0  # the first pivot is not where it stands
    np.testing.assert_allclose(inverse(matrix), np.linalg.inv(matrix), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(inverse(matrix.T), inverse(matrix).T, rtol=1e-9, atol=1e-12)
    covariance = random_covariance(SIGMA, seed)
    scaled = inverse(covariance) @ covariance * SIGMA[:, None] / SIGMA
    np.testing.assert_allclose(scaled, np.eye(7), atol=1e-9)


@pytest.mark.parametrize("matrix", [np.zeros((2, 2)), np.ones((3, 3)), np.full((2, 2), np.nan)])
def test_what_has_no_inverse_is_refused(matrix):
    with pytest.raises(np.linalg.LinAlgError):
        inverse(matrix)


@pytest.mark.parametrize("seed", range(5))
def test_cholesky_factor_and_its_inverse_are_those_of_numpy(seed):
    covariance = random_covariance(SIGMA, seed)
    factor = lower(covariance)
    unit = SIGMA[:, None]
    np.testing.assert_allclose(factor / unit, np.linalg.cholesky(covariance) / unit, atol=1e-12)
    np.testing.assert_allclose(inverse_of_lower(factor) @ factor, np.eye(7), atol=1e-9)
    covariance[3, 3] *= -1.0
    assert np.isnan(lower(covariance)[-1, -1])
