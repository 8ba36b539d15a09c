"""Association by hand-worked cases."""

import numpy as np
import pytest

from isogal.matching.paper.pda import association_weights, candidate_variance, combine


def test_weights_of_two_candidates_by_hand():
    # distances 0 and 2 at unit variance: p ratio is exp(-4/2) = exp(-2)
    weights = association_weights(np.array([[0.0, 0.0], [0.0, 2.0]]), np.zeros(2), np.ones(2))
    np.testing.assert_allclose(
        weights, np.array([1.0, np.exp(-2.0)]) / (1.0 + np.exp(-2.0)), rtol=1e-15
    )


def test_weights_contain_the_density_of_unequal_variances():
    # N((1,1); 0, 1 I) = exp(-1) / 2pi and N((2,0); 0, 4 I) = exp(-1/2) / (2pi 4)
    weights = association_weights(
        np.array([[1.0, 1.0], [2.0, 0.0]]), np.zeros(2), np.array([1.0, 4.0])
    )
    p = np.array([np.exp(-1.0), np.exp(-0.5) / 4.0])
    np.testing.assert_allclose(weights, p / p.sum(), rtol=1e-15)


def test_mean_and_variance_by_hand():
    mean, variance = combine(
        np.array([[0.0, 10.0], [4.0, 20.0]]), np.array([0.75, 0.25]), np.array([100.0, 300.0])
    )
    np.testing.assert_allclose(mean, [1.0, 12.5])
    assert variance == pytest.approx(150.0)  # eq. s3-021: no spread of the candidates in it


def test_variance_of_a_candidate_by_hand():
    # 1 mGal on 2 mGal/km: 500 m; a lattice of 120 m adds 1200 m²; a flat map gives the limit,
    # never a division by zero
    variance = candidate_variance(
        1.0e-5, np.array([[1.2e-8, 1.6e-8], [0.0, 0.0], [1.0e-15, 0.0]]), 120.0, 1.0e6
    )
    np.testing.assert_allclose(variance, [250_000.0 + 1200.0, 1.0e6, 1.0e6])
