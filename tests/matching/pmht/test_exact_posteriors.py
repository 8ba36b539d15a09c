"""Point-mass and particle filter against plain importance sampling of the exact likelihood."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import make_batch
from isogal.matching.baselines.particle import Particle, ParticleOptions
from isogal.matching.baselines.point_mass import PointMass, PointMassOptions, _nodes
from isogal.matching.baselines.readings import AssumedNoise, UsableReadings
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.noise_model import NoiseModel

GRAVIMETER = (-8e-9, 0.0, 6e-6, 1.2e-4)


def by_sampling(batch: Batch, field_map, bias_sigma=0.0, samples=400_000):
    """Mean and covariance of xi by weighing samples of the prior."""
    likelihood = BatchLikelihood.of(batch, field_map, NoiseModel(bias_sigma=bias_sigma))
    xi = np.random.default_rng(0).multivariate_normal(
        np.zeros(4), batch.prior, samples, method="cholesky"
    )
    log = likelihood.log(xi)
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    assert 1.0 / (weight**2).sum() > 2000.0
    mean = weight @ xi
    return mean, (xi - mean).T @ (weight[:, None] * (xi - mean))


def posterior_of(batch, fix):
    covariance = np.linalg.inv(np.linalg.inv(batch.prior) + fix.information.matrix)
    return covariance @ fix.information.vector, covariance


# a prior with the velocity error that drifting for an hour leaves: correlated with the position
# error
PRIOR = np.array(
    [[250.0**2, 0, 8.0, 0], [0, 200.0**2, 0, 6.0], [8.0, 0, 0.06**2, 0], [0, 6.0, 0, 0.06**2]]
)


@pytest.mark.parametrize("sigma", [1.5e-5, 8e-5])
@pytest.mark.parametrize("bias_sigma", [0.0, 4e-5])
@pytest.mark.parametrize("name", ["point-mass", "particle"])
def test_moments_of_the_posterior(rough_map, sigma, bias_sigma, name):
    noise = AssumedNoise(bias_sigma=bias_sigma)
    matcher = (
        PointMass(noise)
        if name == "point-mass"
        else Particle(noise, ParticleOptions(particles=20_000, noise=0.1))
    )
    batch, _ = make_batch(
        rough_map,
        (200.0, 150.0, 0.05, -0.04),
        sigma=sigma,
        prior=PRIOR,
        start=(5e3, -8e3),
        jacobian=GRAVIMETER,
    )
    fix, _ = matcher.match(batch, rough_map, None)
    mean, covariance = by_sampling(batch, rough_map, bias_sigma)
    told, told_covariance = posterior_of(batch, fix)
    spread = np.sqrt(np.diag(covariance))
    # sampling errors of a few per cent; the particle filter resamples and so has more
    slack = 0.05 if name == "point-mass" else 0.15
    np.testing.assert_allclose(told[:2] / spread[:2], mean[:2] / spread[:2], atol=2.0 * slack)
    np.testing.assert_allclose(np.sqrt(np.diag(told_covariance)[:2]), spread[:2], rtol=slack)
    correlation = covariance[0, 1] / (spread[0] * spread[1])
    assert told_covariance[0, 1] / np.sqrt(
        told_covariance[0, 0] * told_covariance[1, 1]
    ) == pytest.approx(correlation, abs=2.0 * slack)
    if name == "point-mass":  # velocity as well
        np.testing.assert_allclose(told / spread, mean / spread, atol=0.1)
        np.testing.assert_allclose(np.sqrt(np.diag(told_covariance)), spread, rtol=0.06)


def test_velocity_and_bias_are_integrated_out(rough_map):
    batch, _ = make_batch(rough_map, (200.0, 150.0, 0.05, -0.04), sigma=1e-5, jacobian=GRAVIMETER)
    readings = UsableReadings.of(batch, rough_map, AssumedNoise(), whole=True)
    sigma = readings.arrays.sigma
    gain = np.array([[1e-4, 0.0], [2e-5, 3e-4]])
    # so large that the determinant counts
    linear = np.diag([0.3**2, 0.2**2, 2e-5**2])
    position = np.array([[0.0, 0.0], [400.0, -300.0], [-700.0, 900.0]])
    log, velocity, spread = _nodes(readings.arrays, sigma**-2.0, position, gain, linear)
    dense = np.empty(3)
    for k, p in enumerate(position):
        residual, slope = readings.linearise(rough_map, np.concatenate([p, gain @ p]))
        D = np.column_stack([-slope[:, 2:], np.ones(30)])
        S = np.diag(sigma**2) + D @ linear @ D.T
        dense[k] = multivariate_normal.logpdf(residual, np.zeros(30), S)
        K = linear @ D.T @ np.linalg.inv(S)
        np.testing.assert_allclose(velocity[k], (gain @ p) + (K @ residual)[:2], rtol=1e-3)
        np.testing.assert_allclose(
            spread[k], (linear - K @ D @ linear)[:2, :2], rtol=1e-3, atol=1e-6
        )
    np.testing.assert_allclose(np.diff(log), np.diff(dense), rtol=1e-4, atol=0.02)


def test_a_posterior_between_the_nodes_is_found(rough_map):
    # first grid: 188 m between nodes; posterior: a few metres
    batch, truth = make_batch(
        rough_map, (333.0, -287.0, 0.002, 0.001), sigma=5e-7, prior_sigma=(500.0, 0.005)
    )
    fix, _ = PointMass().match(batch, rough_map, None)
    assert np.hypot(*truth.error_of(fix)) < 15.0
    assert fix.diagnostics["levels"] > 2.0
    finer, _ = PointMass(options=PointMassOptions(nodes=61)).match(batch, rough_map, None)
    np.testing.assert_allclose(np.diag(fix.covariance), np.diag(finer.covariance), rtol=0.1)


def test_too_few_levels_say_so(rough_map):
    batch, _ = make_batch(rough_map, (333.0, -287.0, 0.0, 0.0), sigma=5e-7)
    fix, _ = PointMass(options=PointMassOptions(levels=1)).match(batch, rough_map, None)
    assert fix.reason == "the posterior is narrower than the finest grid"


def test_particles_that_do_not_agree_say_so(rough_map):
    batch, _ = make_batch(
        rough_map, (800.0, -700.0, 0.0, 0.0), sigma=5e-7, prior_sigma=(100.0, 0.01)
    )
    fix, _ = Particle().match(batch, rough_map, None)
    assert fix.reason == "too few particles agree with the readings"
