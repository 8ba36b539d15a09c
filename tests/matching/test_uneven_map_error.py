"""A map that is more wrong in some places than in others: the likelihood at a candidate goes by the error there."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import field_map_of, make_batch
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.interfaces import Batch
from isogal.matching.likelihood import BatchLikelihood, NoiseModel, residual_covariance

T, SIGMA, LENGTH = 12, 1e-9, 1500.0
NOISE = NoiseModel(map_sigma=2e-6, correlation_length=LENGTH)
XI = np.array([[0.0, 0.0, 0.0, 0.0], [1500.0, -800.0, 0.1, 0.2], [-2000.0, 1500.0, -1.0, 0.5]])
PLANE = field_map_of(lambda north, east: 2e-8 * north - 3e-8 * east, step=2000.0)
UNEVEN = replace(PLANE, sigma=np.linspace(1e-6, 6e-5, PLANE.values.shape[0])[:, None] * np.ones(PLANE.values.shape[1]))
"""Six times more wrong in the north than in the middle."""


def batch_on_the_plane(**changes) -> Batch:
    return make_batch(PLANE, (100.0, 50.0, 0.1, -0.1), scans=T, sigma=SIGMA, **changes)[0]


def places(batch, xi):
    moved = batch.transition @ xi
    north, east = metres_per_radian(batch.latitude)
    return batch.latitude - moved[:, 0] / north, batch.longitude - moved[:, 1] / east


@pytest.mark.parametrize("xi", XI)
def test_log_is_that_of_the_map_error_at_the_candidate(xi):
    batch = batch_on_the_plane()
    likelihood = BatchLikelihood.of(batch, UNEVEN, NOISE)
    latitude, longitude = places(batch, xi)
    # correlations go by the distances between the scans, which a shift leaves as they are
    expected = residual_covariance(
        batch.latitude,
        batch.longitude,
        batch.sigma**2,
        np.maximum(UNEVEN.sigma_at(latitude, longitude), 2e-6),
        LENGTH,
        0.0,
    )
    np.testing.assert_allclose(likelihood.covariance_at(xi), expected, rtol=1e-6)
    residual = batch.reading - UNEVEN.value(latitude, longitude)
    log = multivariate_normal(cov=expected, allow_singular=True).logpdf(residual)
    assert likelihood.log(xi[None])[0] + likelihood.log_normaliser == pytest.approx(log, rel=1e-7)
    assert likelihood.misfit(xi) == pytest.approx(residual @ np.linalg.solve(expected, residual), rel=1e-6)


def test_sigma_on_nodes_that_is_even_counts_as_one_number():
    batch = batch_on_the_plane()
    everywhere = replace(PLANE, sigma=np.full(PLANE.values.shape, 3e-5))
    one = replace(PLANE, sigma=3e-5)
    for noise in (NOISE, NoiseModel(bias_sigma=1e-5), NoiseModel(map_sigma=1e-4)):
        expected = BatchLikelihood.of(batch, one, noise)
        found = BatchLikelihood.of(batch, everywhere, noise)
        np.testing.assert_allclose(found.log(XI), expected.log(XI), rtol=1e-9)
        np.testing.assert_allclose(found.covariance_at(XI[1]), expected.covariance_at(XI[1]), rtol=1e-9)


def test_new_rows_given_the_old_are_the_whole_less_the_old():
    whole = BatchLikelihood.of(batch_on_the_plane(new=T), UNEVEN, NOISE)
    later = BatchLikelihood.of(batch_on_the_plane(new=5), UNEVEN, NOISE)
    bad = np.arange(T) >= T - 5
    old = BatchLikelihood.of(batch_on_the_plane(new=T), UNEVEN, NOISE).without(bad)
    np.testing.assert_allclose(later.log(XI), whole.log(XI) - old.log(XI), rtol=1e-8)


def test_where_the_map_does_not_know_its_error_the_least_counts():
    sigma = np.full(PLANE.values.shape, np.nan)
    likelihood = BatchLikelihood.of(batch_on_the_plane(), replace(PLANE, sigma=sigma), NOISE)
    expected = BatchLikelihood.of(batch_on_the_plane(), PLANE, NOISE)
    np.testing.assert_allclose(likelihood.log(XI), expected.log(XI), rtol=1e-9)
