"""The compiled loops of the batch likelihood give what the same formulas give in NumPy."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import make_batch
from isogal.earth.frames import horizontal_difference
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.likelihood_kernels import mode, whitened
from isogal.matching.pmht.noise_model import NoiseModel, distances

XI = np.array([[0.0, 0.0, 0.0, 0.0], [150.0, -80.0, 0.1, 0.2], [-2000.0, 1500.0, -1.0, 0.5]])
CORRELATED = NoiseModel(map_sigma=3e-5, correlation_length=1500.0, bias_sigma=2e-5)


@pytest.mark.parametrize("new", [5, None], ids=["five new", "all new"])
def test_whitened_residuals_are_those_of_the_cholesky_factor(rough_map, new):
    batch, _ = make_batch(rough_map)
    batch = batch if new is None else replace(batch, new=new)
    likelihood = BatchLikelihood.of(batch, rough_map, CORRELATED)
    of_rows = np.stack([likelihood.linearise(xi)[0] for xi in XI], axis=1)
    factor = np.linalg.cholesky(likelihood.covariance)
    expected = np.linalg.solve(factor, of_rows)[likelihood.first_new :]
    np.testing.assert_allclose(likelihood.whitened(of_rows), expected, rtol=1e-9, atol=1e-9)
    D = likelihood.whitened(likelihood.nuisance_at(np.zeros(4)))
    explained = np.linalg.solve(np.linalg.cholesky(np.eye(D.shape[1]) + D.T @ D), D.T @ expected)
    log = -0.5 * ((expected**2).sum(axis=0) - (explained**2).sum(axis=0))
    np.testing.assert_allclose(likelihood.log(XI), log, rtol=1e-9)
    reduced = whitened(likelihood.grid, likelihood.readings, likelihood.reduction, XI)
    np.testing.assert_allclose((reduced**2).sum(axis=0), -2.0 * log, 1e-8)


def test_nuisance_parameters_against_numpy(rough_map):
    batch, _ = make_batch(rough_map)
    batch = replace(batch, new=7)
    likelihood = BatchLikelihood.of(batch, rough_map, CORRELATED).with_nuisance_at(XI[1])
    moved = batch.transition @ XI[1] * likelihood.readings.radian
    at = batch.latitude - moved[:, 0], batch.longitude - moved[:, 1]
    slope = np.stack(rough_map.value_and_gradient(*at)[1:], axis=-1)
    G = np.einsum("ti,tij->tj", slope, batch.nuisance_position) - batch.nuisance_reading
    # the slope is per metre of the place it is taken at, the move of where it is believed to be
    np.testing.assert_allclose(likelihood.nuisance_at(XI[1]), G, rtol=1e-3, atol=1e-12)
    D = likelihood.whitened(likelihood.nuisance_at(XI[1]))
    C = np.linalg.cholesky(np.eye(7) + D @ D.T)
    expected = np.linalg.solve(C, likelihood.whitening.T).T
    np.testing.assert_allclose(
        likelihood.reduction, expected, rtol=1e-9, atol=1e-9 * expected.max()
    )


def test_distances_are_means_of_both_ways_and_across_180_degrees():
    rng = np.random.default_rng(7)
    latitude, longitude = rng.uniform(-0.7, -0.69, 9), np.pi + rng.uniform(-0.01, 0.01, 9)
    longitude = np.where(longitude > np.pi, longitude - 2.0 * np.pi, longitude)
    apart = horizontal_difference(latitude[:, None], longitude[:, None], latitude, longitude)
    one_way = np.hypot(apart[..., 0], apart[..., 1])
    expected = 0.5 * (one_way + one_way.T)
    np.testing.assert_allclose(distances(latitude, longitude), expected, rtol=1e-10)


def test_mode_is_that_of_gauss_newton_steps_in_numpy(rough_map):
    batch, _ = make_batch(rough_map)
    likelihood = BatchLikelihood.of(replace(batch, new=7), rough_map, CORRELATED)
    root = np.linalg.cholesky(np.diag([150.0, 120.0, 0.1, 0.1]) ** 2 + 1e-3)
    mean, z = XI[1], np.zeros(4)
    for _ in range(20):
        there = likelihood.with_nuisance_at(mean + root @ z)
        residual, slope = there.reduced(mean + root @ z)
        slope = slope @ root
        precision = np.eye(4) + slope.T @ slope
        z = np.linalg.solve(precision, slope.T @ (slope @ z - residual))
    arrays = likelihood.nuisance_position, likelihood.nuisance_reading, likelihood.whitening
    batch = (likelihood.grid, likelihood.readings, *arrays)
    found = mode(*batch, mean, root, 20, 1e-9)
    assert found[0]
    np.testing.assert_allclose(found[1], z, atol=1e-6)
    np.testing.assert_allclose(found[2], slope, atol=1e-5)
    np.testing.assert_allclose(found[3], precision, rtol=1e-5)
    np.testing.assert_allclose(found[4], there.reduction, rtol=1e-4, atol=1e-2)
    assert not mode(*batch, mean, root, 1, 1e-9)[0]
    assert not mode(*batch, mean + 1e7, root, 20, 1e-9)[0]  # off the map
