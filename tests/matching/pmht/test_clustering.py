"""Samples split into separate modes, and one mode into pieces."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from helpers.navigators import random_covariance
from isogal.matching.pmht.clustering import fit, moments, pieces

SIGMA = np.array([300.0, 200.0, 0.3, 0.2])


FLOOR = 1e-6 * SIGMA


def clouds(centres, sizes, seed=3, sigma=SIGMA):
    random = np.random.default_rng(seed)
    x = [
        random.standard_normal((n, 4)) * sigma + np.append(c, [0.0, 0.0])
        for c, n in zip(centres, sizes, strict=True)
    ]
    return np.concatenate(x), np.repeat(np.arange(len(sizes)), sizes)


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


def test_moments_and_pieces_are_those_of_numpy():
    x, weight = ridge(200, 5)
    weight[::7] = 0.0
    mean, covariance = moments(x, weight / weight.sum())
    np.testing.assert_allclose(mean, np.average(x, axis=0, weights=weight), rtol=1e-9, atol=1e-9)
    expected = np.cov(x.T, aweights=weight, bias=True)
    np.testing.assert_allclose(covariance, expected, rtol=1e-9, atol=1e-9 * expected.max())
    halves = pieces(x, weight, SIGMA, 1)
    axis = np.linalg.eigh(np.cov((x / SIGMA).T, aweights=weight, bias=True))[1][:, -1]
    axis *= np.sign(axis[np.argmax(np.abs(axis))])
    order = np.argsort((x / SIGMA) @ axis, kind="stable")
    middle = int(np.searchsorted(np.cumsum(weight[order]), 0.5 * weight.sum())) + 1
    for k, part in enumerate((order[:middle], order[middle:])):
        assert halves.weight[k] == pytest.approx(weight[part].sum() / weight.sum())
        centre = np.average(x[part], axis=0, weights=weight[part])
        np.testing.assert_allclose(halves.mean[k], centre, rtol=1e-9)
