"""A narrow prior's posterior without sampling noise, against the same formulas in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import make_batch
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.importance_sampling import Sampling, sample
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.likelihood_kernels import mode
from isogal.matching.pmht.nearly_linear import _linear_over_prior, nearly_linear
from isogal.matching.pmht.noise_model import NoiseModel

NOISE = NoiseModel(map_sigma=3e-5, correlation_length=1500.0)
MEAN = np.array([3.0, -2.0, 0.001, 0.002])


def problem(rough_map, sigma):
    batch, _ = make_batch(rough_map)
    likelihood = BatchLikelihood.of(replace(batch, new=7), rough_map, NOISE)
    covariance = np.diag([sigma, 0.8 * sigma, 0.01, 0.01]) ** 2
    covariance[0, 1] = covariance[1, 0] = 0.3 * sigma**2
    return likelihood, covariance


def test_it_is_what_the_sampler_finds(rough_map):
    likelihood, covariance = problem(rough_map, 20.0)
    found = nearly_linear(likelihood, MEAN, covariance)
    assert found is not None
    exact = sample(likelihood, Mixture.gaussian(MEAN, covariance), Sampling(samples=16384))[0]
    assert exact is not None
    scale = np.sqrt(np.diag(exact.mixture.covariance[0]))
    got, expected = found[0].mixture, exact.mixture
    np.testing.assert_allclose(got.mean[0] / scale, expected.mean[0] / scale, atol=0.02)
    unit = scale[:, None] * scale
    np.testing.assert_allclose(got.covariance[0] / unit, expected.covariance[0] / unit, atol=0.05)
    assert found[0].log_evidence == pytest.approx(exact.log_evidence, abs=0.02)


@pytest.mark.parametrize("sigma", [20.0, 60.0, 150.0, 400.0])
@pytest.mark.parametrize("tolerance", [0.003, 0.03, 0.3])
def test_linear_over_the_prior_as_numpy_has_it(rough_map, sigma, tolerance):
    likelihood, covariance = problem(rough_map, sigma)
    root = np.linalg.cholesky(covariance)
    drift = likelihood.nuisance_position, likelihood.nuisance_reading, likelihood.whitening
    batch = likelihood.grid, likelihood.readings
    found, z, slope, _, reduction = mode(*batch, *drift, MEAN, root, 20, 1e-6)
    assert found
    reach = CONSTANTS.linear_reach_sigma
    axes = np.linalg.svd(root[:2])[2]
    places = np.concatenate([reach * axes, -reach * axes])

    def reduced(at):
        return reduction.T @ likelihood.linearise(MEAN + root @ at)[0]

    expected = (places - z) @ slope.T
    residual = np.array([reduced(place) for place in places])
    off = ((residual - reduced(z) - expected) ** 2).sum(axis=1)
    allowed = tolerance**2 * (1.0 + (expected**2).sum(axis=1))
    got = _linear_over_prior(*batch, reduction, MEAN, root, z, slope, reach, tolerance)
    assert got == bool((off < allowed).all())
