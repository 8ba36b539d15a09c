"""Gaussian mixtures: density, drawing, moments, transition, joining, and fitting separate groups
of samples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from helpers.navigators import random_covariance
from isogal.matching.pmht.gaussian_mixture import Mixture, fit, pieces

SIGMA = np.array([300.0, 200.0, 0.3, 0.2])
FLOOR = 1e-6 * SIGMA


def mixture(count=3, seed=0):
    random = np.random.default_rng(seed)
    weight = random.uniform(0.2, 1.0, count)
    return Mixture(
        weight / weight.sum(),
        2000.0 * random.standard_normal((count, 4)) * [1.0, 1.0, 1e-4, 1e-4],
        np.stack([random_covariance(SIGMA, seed + k) for k in range(count)]),
    )


@pytest.mark.parametrize("count", [1, 3])
def test_density_equals_scipy(count):
    it = mixture(count)
    x = np.random.default_rng(1).normal(0.0, 1500.0, (50, 4)) * [1.0, 1.0, 1e-3, 1e-3]
    parts = [
        w * multivariate_normal.pdf(x, m, P)
        for w, m, P in zip(it.weight, it.mean, it.covariance, strict=True)
    ]
    expected = np.log(np.sum(parts, axis=0))
    good = np.isfinite(expected)
    assert good.sum() > 20
    np.testing.assert_allclose(it.log_density(x)[good], expected[good], rtol=1e-9)


def test_density_far_away_does_not_underflow():
    assert np.isfinite(mixture().log_density(np.full((1, 4), 1e7))).all()


def test_draws_have_the_moments_of_the_mixture():
    it = mixture()
    random = np.random.default_rng(2)
    points = np.column_stack([random.random(40000), random.standard_normal((40000, 4))])
    x = it.draw(points)
    mean, covariance = it.moments()
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((x.mean(axis=0) - mean) / deviation, 0.0, atol=4.5 / 200.0)
    np.testing.assert_allclose(
        (np.cov(x.T) - covariance) / deviation / deviation[:, None], 0.0, atol=0.05
    )
    assert it.draw(np.array([[1.0, 0, 0, 0, 0], [0.0, 0, 0, 0, 0]])).shape == (
        2,
        4,
    )  # both ends of the unit interval


def test_moments_of_one():
    one = Mixture.gaussian(np.arange(4.0), np.diag(SIGMA**2))
    mean, covariance = one.moments()
    np.testing.assert_array_equal(mean, np.arange(4.0))
    np.testing.assert_allclose(covariance, np.diag(SIGMA**2))
    assert len(one) == 1


def test_moved_and_widened_go_through_the_moments():
    it = mixture()
    transition = np.eye(4)
    transition[:2, 2:] = 300.0 * np.eye(2)
    noise = np.diag([1.0, 4.0, 1e-4, 1e-4])
    mean, covariance = it.moments()
    moved = it.moved(transition, noise).moments()
    np.testing.assert_allclose(moved[0], transition @ mean, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(moved[1], transition @ covariance @ transition.T + noise, rtol=1e-9)
    np.testing.assert_allclose(it.widened(1.5).covariance, 1.5 * it.covariance)


def test_join_and_component():
    a, b = mixture(2, 1), mixture(1, 5)
    joined = Mixture.join([a, b], np.array([0.25, 0.75]))
    np.testing.assert_allclose(joined.weight, [*(0.25 * a.weight), 0.75])
    np.testing.assert_array_equal(joined.mean[2], b.mean[0])
    np.testing.assert_array_equal(joined.component(1).covariance[0], a.covariance[1])


def test_pruning_joins_near_drops_negligible_and_sorts():
    near, far = np.zeros(4), np.array([5000.0, 0.0, 0.0, 0.0])
    it = Mixture(
        np.array([0.2, 0.5, 0.3 - 1e-9, 1e-9]),
        np.array([near, far, [50.0, 0, 0, 0], far * 2]),
        np.stack([np.diag(SIGMA**2)] * 4),
    )
    pruned = it.pruned(1e-6, 10)
    assert len(pruned) == 2
    np.testing.assert_allclose(pruned.weight, [0.5, 0.5], atol=1e-8)
    mean, covariance = it.moments()
    after, spread = pruned.moments()
    np.testing.assert_allclose(after, mean, atol=1e-4)
    np.testing.assert_allclose(spread, covariance, rtol=1e-4, atol=1e-3)
    assert len(it.pruned(1e-6, 1)) == 1
    assert it.pruned(1e-6, 1).weight[0] == 1.0


@given(st.integers(0, 2**32 - 1))
def test_pruning_keeps_weights_a_distribution(seed):
    pruned = mixture(6, seed % 10**6).pruned(1e-3, 4)
    assert pruned.weight.sum() == pytest.approx(1.0)
    assert (np.diff(pruned.weight) <= 0.0).all()


@given(st.integers(0, 2**32 - 1))
def test_one_cloud_is_one_group(seed):
    random = np.random.default_rng(seed)
    x = (
        random.standard_normal((800, 4))
        @ np.linalg.cholesky(random_covariance(SIGMA, seed % 1000)).T
    )
    fitted, labels = fit(x, np.full(800, 1.0 / 800), 6, FLOOR)
    assert len(fitted) == 1
    assert not labels.any()
    mean, covariance = fitted.mean[0], fitted.covariance[0]
    np.testing.assert_allclose(mean, x.mean(axis=0), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(covariance, np.cov(x.T) * (1 + 100 / 800**2), rtol=1e-5)


def clouds(centres, sizes, seed=3, sigma=SIGMA):
    random = np.random.default_rng(seed)
    x = [
        random.standard_normal((n, 4)) * sigma + np.append(c, [0.0, 0.0])
        for c, n in zip(centres, sizes, strict=True)
    ]
    return np.concatenate(x), np.repeat(np.arange(len(sizes)), sizes)


@pytest.mark.parametrize(
    "centres",
    [[(0.0, 0.0), (4000.0, 0.0)], [(0.0, 0.0), (0.0, 4000.0), (4000.0, 0.0), (4000.0, 4000.0)]],
)
def test_separate_clouds_are_separate_groups(centres):
    sizes = [400, 300, 200, 100][: len(centres)]
    x, truth = clouds(centres, sizes)
    weight = np.full(len(x), 1.0 / len(x))
    fitted, labels = fit(x, weight, 6, FLOOR)
    np.testing.assert_array_equal(labels, truth)  # groups come heaviest first
    np.testing.assert_allclose(fitted.weight, np.array(sizes) / sum(sizes), rtol=1e-12)
    np.testing.assert_allclose(fitted.mean[:, :2], centres, atol=60.0)
    np.testing.assert_allclose(np.sqrt(fitted.covariance[:, 0, 0]), 300.0, rtol=0.25)
    limited, _ = fit(x, weight, 1, FLOOR)
    assert len(limited) == 1


def test_samples_without_weight_do_not_count():
    x, truth = clouds([(0.0, 0.0), (4000.0, 0.0)], [400, 300])
    weight = np.where(truth == 0, 1.0 / 400, 0.0)
    fitted, _ = fit(x, weight, 6, FLOOR)
    assert len(fitted) == 1
    np.testing.assert_allclose(fitted.mean[0, :2], 0.0, atol=60.0)


def test_overlapping_clouds_stay_together():
    x, _ = clouds([(0.0, 0.0), (500.0, 0.0)], [400, 400])
    assert len(fit(x, np.full(800, 1.0 / 800), 6, FLOOR)[0]) == 1


def test_equal_samples_get_the_floor():
    fitted, _ = fit(np.ones((100, 4)), np.full(100, 0.01), 6, SIGMA)
    np.testing.assert_allclose(fitted.covariance[0], np.diag(SIGMA**2), atol=1e-20)


def ridge(count, seed):
    """Samples of a curved ridge, with weights."""
    random = np.random.default_rng(seed)
    along = random.standard_normal(count)
    x = SIGMA * np.stack(
        [
            along,
            along**2 + 0.1 * random.standard_normal(count),
            *random.standard_normal((2, count)),
        ],
        -1,
    )
    return x, random.uniform(0.1, 1.0, count)


@pytest.mark.parametrize("cuts", [0, 1, 3])
def test_pieces_keep_the_moments(cuts):
    x, weight = ridge(2000, 0)
    it = pieces(x, weight, SIGMA, cuts)
    assert len(it) == 2**cuts
    np.testing.assert_allclose(it.weight, 2.0**-cuts, atol=0.01)
    mean, covariance = it.moments()
    np.testing.assert_allclose(mean, np.average(x, axis=0, weights=weight), rtol=1e-9)
    np.testing.assert_allclose(
        covariance, np.cov(x.T, aweights=weight, ddof=0) + np.diag((1e-3 * SIGMA) ** 2), rtol=1e-6
    )


def test_pieces_follow_a_ridge_that_one_gaussian_does_not():
    x, weight = ridge(2000, 1)
    others, _ = ridge(2000, 2)
    one, eight = (pieces(x, weight, SIGMA, cuts).log_density(others).mean() for cuts in (0, 3))
    assert eight > one + 0.7


def test_few_samples_are_one_piece():
    x, _ = ridge(200, 3)
    weight = np.zeros(200)
    weight[:30] = 1.0
    assert len(pieces(x, weight, SIGMA, 3)) == 1
