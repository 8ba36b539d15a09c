"""From posterior and prior back to the measurements: Bayes' rule must lead to the posterior
again."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from helpers.navigators import random_covariance
from isogal.matching.information import likelihood_information, measurement_only

SIGMA = np.array([300.0, 200.0, 0.3, 0.2])
seeds = st.integers(0, 2**32 - 1)


def cases(seed, rows=4, strength=1.0):
    """Prior, and the posterior after a linear measurement of some rows of full rank."""
    random = np.random.default_rng(seed)
    prior = random_covariance(SIGMA, seed)
    H = random.standard_normal((rows, 4)) / SIGMA * strength
    M = H.T @ H
    covariance = np.linalg.inv(np.linalg.inv(prior) + M)
    vector = H.T @ random.standard_normal(rows)
    return prior, covariance @ vector, covariance, vector, M


def bayes(prior, vector, matrix):
    covariance = np.linalg.inv(np.linalg.inv(prior) + matrix)
    return covariance @ vector, covariance


@given(seeds)
def test_information_of_a_full_measurement_is_recovered(seed):
    prior, mean, covariance, _, M = cases(seed)
    assume(np.linalg.eigvals(np.linalg.solve(prior, covariance)).real.max() < 0.999)
    information = likelihood_information(mean, covariance, prior)
    scale = SIGMA * SIGMA[:, None]
    assert (
        np.abs((information.matrix - M) * scale).max() < 1e-4 * np.abs(M * scale).max()
    )  # eigenvalues near 1 lose digits
    back, P = bayes(prior, information.vector, information.matrix)
    np.testing.assert_allclose(back / SIGMA, mean / SIGMA, atol=1e-6)
    np.testing.assert_allclose(P / scale, covariance / scale, atol=1e-9)


@given(seeds, st.integers(1, 3))
def test_directions_without_information_get_none(seed, rows):
    prior, mean, covariance, _, _ = cases(seed, rows)
    information = likelihood_information(mean, covariance, prior)
    whitened = np.linalg.eigvalsh(information.matrix * SIGMA * SIGMA[:, None])
    assert (np.abs(whitened) > 1e-6 * whitened[-1]).sum() <= rows


@given(seeds)
def test_a_posterior_wider_than_the_prior_is_negative_information(seed):
    """Of two places that fit, a prior between them knew neither: the navigator gets the
    posterior's mean and covariance all the same."""
    random = np.random.default_rng(seed)
    prior = random_covariance(SIGMA, seed)
    factor = np.linalg.cholesky(prior)
    axes = np.linalg.qr(random.standard_normal((4, 4)))[0]
    ratio = np.array([0.05, 0.5, 1.3, 9.0])
    covariance = factor @ (axes * ratio) @ axes.T @ factor.T
    mean = factor @ random.standard_normal(4)
    information = likelihood_information(mean, covariance, prior)
    back, P = bayes(prior, information.vector, information.matrix)
    whitened = axes.T @ np.linalg.solve(factor, np.linalg.solve(factor, P).T) @ axes
    np.testing.assert_allclose(
        np.diag(whitened), [0.05, 0.5, 1.3, 4.0], atol=1e-6
    )  # at most twice as wide
    np.testing.assert_allclose(back / SIGMA, mean / SIGMA, atol=1e-6)


@pytest.mark.parametrize("ratio", [1.0, 1.005, 0.995])
def test_posterior_equal_to_prior_up_to_sampling_says_nothing(ratio):
    prior = random_covariance(SIGMA)
    information = likelihood_information(1e-3 * SIGMA, ratio * prior, prior)
    assert not information.matrix.any()
    assert not information.vector.any()


@given(seeds, st.floats(0.3, 30.0))
def test_position_fix_turns_the_priors_position_into_the_posteriors(seed, strength):
    prior, mean, covariance, _, _ = cases(seed, 4, strength)
    fix, R = measurement_only(mean, covariance, prior)
    np.testing.assert_allclose(R, R.T, rtol=1e-12)
    assert np.linalg.eigvalsh(R)[0] > 0.0
    gain = prior[:2, :2] @ np.linalg.inv(prior[:2, :2] + R)
    position = np.ix_([0, 1], [0, 1])
    np.testing.assert_allclose(
        ((np.eye(2) - gain) @ prior[position]) / SIGMA[:2] ** 2,
        covariance[position] / SIGMA[:2] ** 2,
        atol=2e-4,
    )
    np.testing.assert_allclose(gain @ fix / SIGMA[:2], mean[:2] / SIGMA[:2], atol=0.03)
    if np.linalg.eigvals(np.linalg.solve(prior[position], covariance[position])).real.max() < 0.99:
        np.testing.assert_allclose(gain @ fix / SIGMA[:2], mean[:2] / SIGMA[:2], atol=1e-6)
