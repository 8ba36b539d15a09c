"""Models of the map's error, each with a filter of that error and of the readings' bias."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import ORIGIN, make_batch
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.matching.channels import channel_batch
from isogal.matching.interfaces import FilterPath
from isogal.matching.pmht.error_chain import ErrorChain, NewReadings, _steps, is_chain
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.map_error import MapErrorEstimate
from isogal.matching.pmht.noise_model import NoiseModel

SIGMA, LENGTH = np.array([1e-5, 5e-5]), np.array([2000.0, 8000.0, 20000.0])
BIAS = np.array([3e-5, 2e-8])
STEP, SPEED = 10.0, 22.0


def readings(first, count, seed=0, scale=1e-4, walk=0.0, states=4):
    """Readings along a straight line eastward, of random size, with what a navigator's error
    does to them."""
    random = np.random.default_rng([seed, first])
    time = STEP * np.arange(first, first + count)
    _, east = metres_per_radian(ORIGIN[0])
    longitude = ORIGIN[1] + SPEED * time / east
    return NewReadings(
        time,
        np.full(count, ORIGIN[0]),
        longitude,
        scale * random.standard_normal(count),
        0.5 * scale * random.standard_normal((count, states)),
        np.full(count, 2e-5**2),
        walk,
    )


def joint(parts, sigma, length, walk):
    """Covariance of all residuals by one model: noise, map error, bias, drift and walk of all,
    and a navigator's error that is another one in each part."""
    time = np.concatenate([one.time for one in parts])
    apart = SPEED * np.abs(time[:, None] - time)
    covariance = np.diag(np.concatenate([one.variance for one in parts]))
    covariance += sigma**2 * np.exp(-apart / length) + BIAS[0] ** 2
    covariance += BIAS[1] ** 2 * np.outer(time, time) + walk**2 * np.minimum(time[:, None], time)
    first = 0
    for one in parts:
        which = slice(first, first + len(one.time))
        covariance[which, which] += one.unknown @ one.unknown.T
        first += len(one.time)
    return covariance


@pytest.mark.parametrize("walk", [0.0, 1e-6])
def test_its_evidence_is_the_density_of_all_readings_together(walk):
    parts = [readings(first, count, walk=walk) for first, count in [(0, 30), (30, 5), (35, 5)]]
    parts.append(readings(47, 6, walk=walk))  # after a gap
    chain = ErrorChain.before(SIGMA, LENGTH, parts[0]).with_bias(BIAS)
    total = np.zeros((len(SIGMA), len(LENGTH)))
    for one in parts:
        chain, evidence = chain.after(SIGMA, LENGTH, one)
        total += evidence
    every = np.concatenate([one.residual for one in parts])
    constant = 0.5 * len(every) * np.log(2.0 * np.pi)
    for i, sigma in enumerate(SIGMA):
        for j, length in enumerate(LENGTH):
            density = multivariate_normal(cov=joint(parts, sigma, length, walk)).logpdf(every)
            assert total[i, j] - constant == pytest.approx(density, abs=0.05)


def test_without_a_bias_there_is_none():
    new = readings(0, 20)
    chain, _ = ErrorChain.before(SIGMA, LENGTH, new).after(SIGMA, LENGTH, new)
    assert not chain.mean[..., 1:].any()
    assert not chain.biased
    assert chain.with_bias(BIAS).biased


def test_poor_readings_of_an_exact_map_are_not_taken_for_a_wrong_one(rough_map):
    """A bias that a model with a large map error has not learnt is no excuse for the others. By
    the readings of one batch alone 10 mGal over 16 km and a bias look the same."""
    start, _ = make_batch(rough_map, sigma=2e-4)
    found = MapErrorEstimate.unknown(start, rough_map)
    random = np.random.default_rng(5)
    for k in range(150):
        new = readings(5 * k, 5, seed=k)
        noise = 2e-4 * random.standard_normal(5) + 3e-5
        unknown = np.full((5, 1), 3e-6)
        new = replace(new, residual=noise, unknown=unknown, variance=np.full(5, 2e-4**2))
        found = found.follow(new, np.array([5e-4, 5e-8]))
    above = found.probability[found.sigma > 5e-5].sum()
    assert found.batches == 150
    assert above < 0.05


def test_new_readings_are_what_the_likelihood_has(rough_map):
    truth = np.array([30.0, -20.0, 0.1, 0.0])
    batch, _ = make_batch(rough_map, tuple(truth))
    likelihood = BatchLikelihood.of(batch, rough_map, NoiseModel())
    new = NewReadings.of(batch, likelihood.rows, rough_map, truth)
    residual, slope = likelihood.linearise(truth)
    np.testing.assert_allclose(new.residual, residual - slope @ truth, rtol=1e-12)
    own = slope @ np.linalg.cholesky(batch.prior)
    np.testing.assert_allclose(new.unknown[:, :4], own, rtol=1e-12)
    np.testing.assert_allclose(new.unknown[:, 4:], likelihood.nuisance_at(truth), rtol=1e-12)


def test_what_is_no_chain_is_not_taken_for_one(rough_map):
    batch, _ = make_batch(rough_map)
    scans = len(batch)
    one = channel_batch(batch, batch.reading[:, None], [[1e-10]])
    two = channel_batch(batch, np.tile(batch.reading[:, None], 2), 1e-10 * np.eye(2))
    together = np.full((scans, scans), 1e-12) + 1e-10 * np.eye(scans)
    path = FilterPath(100.0, np.ones(1), np.zeros((scans, 1, 2)))
    assert is_chain(batch)
    assert is_chain(one)
    assert not is_chain(two)
    assert not is_chain(replace(batch, reading_covariance=together))
    assert not is_chain(replace(batch, delay_sigma=1.0))
    assert not is_chain(replace(batch, filter_path=path))


def test_steps_along_a_track_across_180_degrees():
    random = np.random.default_rng(2)
    latitude = ORIGIN[0] + random.uniform(-1e-4, 1e-4, 7)
    longitude = np.pi + random.uniform(-1e-4, 1e-4, 7)
    longitude = np.where(longitude > np.pi, longitude - 2.0 * np.pi, longitude)
    time = np.cumsum(random.uniform(5.0, 15.0, 7))
    elapsed, travelled = _steps(
        time[0], latitude[0], longitude[0], time[1:], latitude[1:], longitude[1:]
    )
    apart = horizontal_difference(latitude[1:], longitude[1:], latitude[:-1], longitude[:-1])
    np.testing.assert_allclose(elapsed, np.diff(time))
    np.testing.assert_allclose(travelled, np.hypot(*apart.T), rtol=1e-8)
