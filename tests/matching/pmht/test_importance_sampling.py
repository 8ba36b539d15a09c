"""The annealed sampler against Bayes' rule in closed form: one Gaussian, two modes, evidence,
trouble."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from helpers.navigators import random_covariance
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.importance_sampling import Sampling, sample

SIGMA = np.array([500.0, 400.0, 0.3, 0.2])
PRIOR = Mixture.gaussian(np.array([20.0, -30.0, 0.0, 0.05]), random_covariance(SIGMA))


@dataclass(frozen=True)
class Gaussians:
    """Likelihood that is a sum of Gaussians in x, each with a height."""

    mean: np.ndarray
    covariance: np.ndarray
    log_height: np.ndarray

    def log(self, xi):
        parts = [
            h + multivariate_normal.logpdf(xi, m, P)
            for m, P, h in zip(self.mean, self.covariance, self.log_height, strict=True)
        ]
        return logsumexp(parts, axis=0)

    def with_nuisance_at(self, xi):
        return self


def posterior(prior, likelihood):
    """Weights, means, covariances and log evidence in closed form for one Gaussian prior."""
    m0, P0 = prior.mean[0], prior.covariance[0]
    logs, means, covariances = [], [], []
    for m, P, h in zip(likelihood.mean, likelihood.covariance, likelihood.log_height, strict=True):
        logs.append(h + multivariate_normal.logpdf(m, m0, P0 + P))
        gain = P0 @ np.linalg.inv(P0 + P)
        means.append(m0 + gain @ (m - m0))
        covariances.append((np.eye(4) - gain) @ P0)
    total = logsumexp(logs)
    return np.exp(np.array(logs) - total), np.array(means), np.array(covariances), total


def close(mixture_mean, mixture_covariance, mean, covariance, within):
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((mixture_mean - mean) / deviation, 0.0, atol=within)
    np.testing.assert_allclose(
        (mixture_covariance - covariance) / deviation / deviation[:, None], 0.0, atol=2.0 * within
    )


@pytest.mark.parametrize("narrow", [3.0, 0.3, 0.03, 0.01])
def test_moments_and_evidence_of_a_gaussian_case(narrow):
    likelihood = Gaussians(
        np.array([[300.0, 250.0, -0.2, 0.1]]),
        random_covariance(narrow * SIGMA, 3)[None],
        np.array([-1234.0]),
    )
    result, _ = sample(likelihood, PRIOR, Sampling())
    _, mean, covariance, evidence = posterior(PRIOR, likelihood)
    assert result.beta == 1.0
    assert result.effective > 0.3
    assert len(result.mixture) == 1
    close(*result.mixture.moments(), mean[0], covariance[0], 0.05)
    assert result.log_evidence == pytest.approx(evidence, abs=0.05)
    assert result.weight.sum() == pytest.approx(1.0)
    close(*_moments(result), mean[0], covariance[0], 0.05)


def _moments(result):
    mean = result.weight @ result.samples
    apart = result.samples - mean
    return mean, (apart * result.weight[:, None]).T @ apart


def two_modes(height=0.0):
    return Gaussians(
        np.array([[-700.0, 300.0, 0.1, 0.0], [800.0, -100.0, -0.1, 0.1]]),
        np.stack([random_covariance(0.1 * SIGMA, 1), random_covariance(0.15 * SIGMA, 2)]),
        np.array([0.0, height]),
    )


@pytest.mark.parametrize("height", [0.0, 2.0, -3.0])
def test_two_modes_are_two_hypotheses_with_their_weights(height):
    likelihood = two_modes(height)
    result, _ = sample(likelihood, PRIOR, Sampling(samples=2048))
    weight, means, covariances, evidence = posterior(PRIOR, likelihood)
    order = np.argsort(-weight)
    assert len(result.mixture) == 2
    np.testing.assert_allclose(result.mixture.weight, weight[order], atol=0.03)
    for k, mode in enumerate(order):
        within = 0.1 if weight[mode] > 0.1 else 0.3
        close(
            result.mixture.mean[k],
            result.mixture.covariance[k],
            means[mode],
            covariances[mode],
            within,
        )
    assert result.log_evidence == pytest.approx(evidence, abs=0.1)


def test_a_mixture_as_prior():
    prior = Mixture(
        np.array([0.7, 0.3]),
        np.array([[0.0, 0, 0, 0], [3000.0, 0, 0, 0]]),
        np.stack([random_covariance(SIGMA)] * 2),
    )
    likelihood = Gaussians(
        np.array([[3000.0, 100.0, 0.0, 0.0]]), np.diag((0.1 * SIGMA) ** 2)[None], np.zeros(1)
    )
    result, _ = sample(likelihood, prior, Sampling())
    log = [
        np.log(w) + multivariate_normal.logpdf(likelihood.mean[0], m, P + likelihood.covariance[0])
        for w, m, P in zip(prior.weight, prior.mean, prior.covariance, strict=True)
    ]
    assert result.log_evidence == pytest.approx(logsumexp(log), abs=0.1)
    np.testing.assert_allclose(result.mixture.mean[0, :2], [3000.0, 100.0], atol=10.0)


@pytest.mark.parametrize("light", [1e-2, 1e-4])
def test_a_light_part_of_the_prior_is_not_overlooked(light):
    """All of the likelihood is where the prior has little weight: moments and evidence are those
    of that part."""
    small = random_covariance(0.1 * SIGMA)
    prior = Mixture(
        np.array([1.0 - light, light]),
        np.array([[0.0, 0, 0, 0], [900.0, -600.0, 0, 0]]),
        np.stack([small] * 2),
    )
    likelihood = Gaussians(np.array([[940.0, -580.0, 0.0, 0.0]]), 0.5 * small[None], np.zeros(1))
    result, _ = sample(likelihood, prior, Sampling(samples=512))
    _, mean, covariance, evidence = posterior(prior.component(1), likelihood)
    assert len(result.mixture) == 1
    close(*result.mixture.moments(), mean[0], covariance[0], 0.1)
    assert result.log_evidence == pytest.approx(evidence + np.log(light), abs=0.1)


def test_a_proposal_looks_at_its_place_only():
    likelihood = two_modes()
    _, means, covariances, _ = posterior(PRIOR, likelihood)
    proposal = Mixture.gaussian(means[1], 4.0 * covariances[1])
    result, _ = sample(likelihood, PRIOR, Sampling(), proposal)
    alone = Gaussians(likelihood.mean[1:], likelihood.covariance[1:], likelihood.log_height[1:])
    _, mean, covariance, evidence = posterior(PRIOR, alone)
    close(*result.mixture.moments(), mean[0], covariance[0], 0.05)
    assert result.log_evidence == pytest.approx(evidence, abs=0.05)


def test_the_same_call_gives_the_same_numbers():
    first, _ = sample(two_modes(), PRIOR, Sampling(samples=256))
    second, _ = sample(two_modes(), PRIOR, Sampling(samples=256))
    assert (first.samples == second.samples).all()
    assert (first.weight == second.weight).all()
    assert first.log_evidence == second.log_evidence


class _Cut(Gaussians):
    """Impossible for north > 0 (off the map)."""

    def log(self, xi):
        return np.where(xi[:, 0] > 0.0, -np.inf, super().log(xi))


def test_where_nothing_is_possible_there_is_no_sample():
    flat = Gaussians(np.zeros((1, 4)), random_covariance(3.0 * SIGMA)[None], np.zeros(1))
    result, _ = sample(_Cut(flat.mean, flat.covariance, flat.log_height), PRIOR, Sampling())
    assert (result.samples[result.weight > 0.0, 0] <= 0.0).all()
    nowhere = Gaussians(np.zeros((1, 4)), np.eye(4)[None] * 1e6, np.array([-np.inf]))
    assert sample(nowhere, PRIOR, Sampling())[0] is None


def test_likelihood_is_linearised_where_it_ends():
    seen = []

    class Noting(Gaussians):
        def with_nuisance_at(self, xi):
            seen.append(xi)
            return self

    likelihood = Noting(
        np.array([[300.0, 250.0, -0.2, 0.1]]), random_covariance(0.05 * SIGMA)[None], np.zeros(1)
    )
    result, _ = sample(likelihood, PRIOR, Sampling())
    assert len(seen) == result.rounds - 1
    deviation = np.sqrt(np.diag(result.mixture.covariance[0]))
    assert (np.abs(seen[-1] - result.mixture.mean[0]) < 2.0 * deviation).all()
