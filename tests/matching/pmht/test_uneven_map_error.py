"""A map that is more wrong in some places than in others: the likelihood goes by where the
readings may be from."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import ORIGIN, field_map_of, make_batch, wavy
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.error_ellipses import ellipses_of
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.noise_model import NoiseModel, residual_covariance
from isogal.matching.registry import build_matcher
from isogal.scenario import Matcher

T, SIGMA, LENGTH = 12, 1e-9, 1500.0
NOISE = NoiseModel(map_sigma=2e-6, correlation_length=LENGTH)
XI = np.array([[0.0, 0.0, 0.0, 0.0], [1500.0, -800.0, 0.1, 0.2], [-2000.0, 1500.0, -1.0, 0.5]])
PLANE = field_map_of(lambda north, east: 2e-8 * north - 3e-8 * east, step=2000.0)
UNEVEN = replace(
    PLANE,
    sigma=np.linspace(1e-6, 6e-5, PLANE.values.shape[0])[:, None] * np.ones(PLANE.values.shape[1]),
)
"""Six times more wrong in the north than in the middle."""


def batch_on_the_plane(**changes) -> Batch:
    return make_batch(PLANE, (100.0, 50.0, 0.1, -0.1), scans=T, sigma=SIGMA, **changes)[0]


def expected_covariance(batch, map_sigma):
    return residual_covariance(
        batch.latitude,
        batch.longitude,
        batch.sigma**2,
        np.maximum(map_sigma, NOISE.map_sigma),
        LENGTH,
        0.0,
    )


@pytest.mark.parametrize("xi", XI)
def test_of_a_place_that_is_known_the_error_there_counts(xi):
    batch = batch_on_the_plane()
    moved = batch.transition @ xi
    north, east = metres_per_radian(batch.latitude)
    there = UNEVEN.sigma_at(
        batch.latitude - moved[:, 0] / north, batch.longitude - moved[:, 1] / east
    )
    likelihood = BatchLikelihood.of(batch, UNEVEN, NOISE, place=(xi, 1e-12 * np.eye(4)))
    np.testing.assert_allclose(likelihood.covariance, expected_covariance(batch, there), rtol=1e-6)


def test_of_a_place_that_is_not_known_the_mean_variance_counts():
    # sigma = a + b north: its mean square over N(0, p²) is (a + b north)² + b² p²
    batch = batch_on_the_plane(prior_sigma=(3000.0, 1e-6))
    metres = metres_per_radian(ORIGIN[0])[0]
    by_north = (UNEVEN.sigma[-1, 0] - UNEVEN.sigma[0, 0]) / (
        (UNEVEN.latitude[-1] - UNEVEN.latitude[0]) * metres
    )
    square = UNEVEN.sigma_at(batch.latitude, batch.longitude) ** 2 + (by_north * 3000.0) ** 2
    likelihood = BatchLikelihood.of(batch, UNEVEN, NOISE)
    np.testing.assert_allclose(np.diag(likelihood.covariance), square + batch.sigma**2, rtol=0.01)


def test_log_is_that_of_the_multivariate_normal():
    batch = batch_on_the_plane()
    likelihood = BatchLikelihood.of(batch, UNEVEN, NOISE, place=(XI[1], 1e-12 * np.eye(4)))
    residual = batch.reading - UNEVEN.value(batch.latitude, batch.longitude)
    log = multivariate_normal(cov=likelihood.covariance).logpdf(residual)
    assert likelihood.log(XI[:1])[0] + likelihood.log_normaliser == pytest.approx(log, rel=1e-7)


def test_sigma_on_nodes_that_is_even_counts_as_one_number():
    batch = batch_on_the_plane()
    everywhere = replace(PLANE, sigma=np.full(PLANE.values.shape, 3e-5))
    one = replace(PLANE, sigma=3e-5)
    for noise in (NOISE, NoiseModel(bias_sigma=1e-5), NoiseModel(map_sigma=1e-4)):
        expected = BatchLikelihood.of(batch, one, noise)
        np.testing.assert_allclose(
            BatchLikelihood.of(batch, everywhere, noise).log(XI), expected.log(XI), rtol=1e-9
        )


def test_where_the_map_does_not_know_its_error_the_least_counts():
    sigma = np.full(PLANE.values.shape, np.nan)
    likelihood = BatchLikelihood.of(batch_on_the_plane(), replace(PLANE, sigma=sigma), NOISE)
    expected = BatchLikelihood.of(batch_on_the_plane(), PLANE, NOISE)
    np.testing.assert_allclose(likelihood.log(XI), expected.log(XI), rtol=1e-9)


def test_pmht_weighs_by_the_error_where_the_track_turns_out_to_be():
    """North of the middle the map is wrong by 30 mGal, and says so; the track is in the south, its
    navigator 6 km north."""
    truth = field_map_of(wavy)
    random = np.random.default_rng(4)
    north = truth.latitude > ORIGIN[0]
    sigma = np.where(north, 3e-4, 2e-5)[:, None] * np.ones(truth.values.shape[1])
    field_map = replace(truth, values=truth.values + sigma * random.standard_normal(), sigma=sigma)
    matcher = build_matcher(Matcher(map_correlation_length=1e6))
    batch, true = make_batch(
        truth, (6000.0, 0.0, 0.0, 0.0), start=(-6500.0, 0.0), prior_sigma=(3000.0, 1e-3)
    )
    fix, _ = matcher.match(batch, field_map, None)
    assert fix.published, fix.reason
    error = true.error_of(fix)
    assert error @ np.linalg.solve(fix.covariance, error) < 13.8  # 99.9 %
    assert (
        np.sqrt(np.trace(fix.covariance)) < 700.0
    )  # with the error of the north it would be 3 km


def test_pmht_does_not_choose_a_place_by_the_map_error_of_another():
    """The two halves of a track contradict each other by 4 km. Where the one half would be right,
    the map is good for the other half: each place speaks for the other one, and whichever is tried
    last would win by many of its 1-sigmas."""
    slope, apart, error = 5e-8, 2000.0, np.array([1000.0, 0.0, 0.0, 0.0])
    plane = field_map_of(lambda north, east: slope * north + 0.0 * east, step=500.0)
    batch, _ = make_batch(
        plane,
        error,
        start=(0.0, -3000.0),
        velocity=(0.0, 20.0),
        prior_sigma=(1000.0, 1e-3),
        sigma=1e-7,
    )
    west = np.arange(len(batch)) < len(batch) // 2
    batch = replace(batch, reading=batch.reading + slope * apart * np.where(west, 1.0, -1.0))
    bad_for_the_west = (plane.latitude > ORIGIN[0])[:, None]
    sigma = slope * np.where(bad_for_the_west == (plane.longitude < ORIGIN[1]), 3000.0, 200.0)
    fix, _ = build_matcher(Matcher(map_correlation_length=1.0)).match(
        batch, replace(plane, sigma=sigma), None
    )
    assert fix.published, fix.reason
    posterior = np.linalg.inv(np.linalg.inv(batch.prior) + fix.information.matrix)
    deviation = np.sqrt(posterior[0, 0])
    assert abs((posterior @ fix.information.vector - error)[0]) < 2.0 * deviation
    assert 200.0 < deviation < 600.0


def test_lengths_that_the_map_says_at_each_node_count():
    batch = batch_on_the_plane()
    lengths = np.linspace(300.0, 5000.0, PLANE.values.shape[0])[:, None] * np.ones(
        PLANE.values.shape[1]
    )
    told = replace(UNEVEN, correlation_lengths=lengths, correlation_length=2000.0)
    likelihood = BatchLikelihood.of(batch, told, NOISE)
    there = told.correlation_length_at(batch.latitude, batch.longitude)
    sigma = np.sqrt(np.diag(likelihood.covariance) - batch.sigma**2)
    square = 0.5 * (there[0] ** 2 + there[-1] ** 2)
    north, east = metres_per_radian(batch.latitude[0])
    distance = np.hypot(
        (batch.latitude[-1] - batch.latitude[0]) * north,
        (batch.longitude[-1] - batch.longitude[0]) * east,
    )
    expected = there[0] * there[-1] / square * np.exp(-distance / np.sqrt(square))
    found = likelihood.covariance[0, -1] / sigma[0] / sigma[-1]
    assert found == pytest.approx(expected, rel=0.01)
    assert np.linalg.eigvalsh(likelihood.covariance)[0] > 0.0
    # an error smaller than what is assumed has the length that is assumed
    even = NoiseModel(map_sigma=1e-4, correlation_length=LENGTH)
    np.testing.assert_allclose(
        BatchLikelihood.of(batch, told, even).covariance,
        BatchLikelihood.of(batch, UNEVEN, even).covariance,
    )


def test_lengths_that_the_map_says_in_each_direction_count():
    batch = batch_on_the_plane()
    shape = PLANE.values.shape
    north, east = metres_per_radian(batch.latitude[0])
    way = np.array(
        [
            (batch.latitude[-1] - batch.latitude[0]) * north,
            (batch.longitude[-1] - batch.longitude[0]) * east,
        ]
    )
    azimuth = np.arctan2(way[1], way[0])
    for turned, length in ((0.0, 6e3), (0.5 * np.pi, 1500.0)):
        ellipse = ellipses_of(np.array(6e3), np.array(1500.0), np.array(azimuth + turned))
        told = replace(
            UNEVEN,
            correlation_length=2000.0,
            correlation_lengths=np.full(shape, 2000.0),
            error_ellipses=np.tile(ellipse, (*shape, 1)),
        )
        likelihood = BatchLikelihood.of(batch, told, NOISE)
        sigma = np.sqrt(np.diag(likelihood.covariance) - batch.sigma**2)
        found = likelihood.covariance[0, -1] / sigma[0] / sigma[-1]
        assert found == pytest.approx(np.exp(-np.hypot(*way) / length), rel=0.01)
        assert np.linalg.eigvalsh(likelihood.covariance)[0] > 0.0
