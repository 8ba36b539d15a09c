import math

import numpy as np
import pytest
from scipy.stats import chi2

from isogal.evaluation.consistency import (
    chi_square_interval,
    effective_samples,
    mean_nees,
    nees_per_axis,
    spread_test,
)

COVARIANCE = np.array([[400.0, 150.0], [150.0, 900.0]])


def draw(random, *shape):
    return random.standard_normal((*shape, 2)) @ np.linalg.cholesky(COVARIANCE).T


def test_nees_by_hand_and_in_turned_axes():
    error, covariance = np.array([3.0, 4.0]), np.diag([9.0, 4.0])
    assert nees_per_axis(error, covariance) == pytest.approx((1.0 + 4.0) / 2.0)
    turn = 7.0 * np.array([[0.6, -0.8], [0.8, 0.6]])
    assert nees_per_axis(turn @ error, turn @ covariance @ turn.T) == pytest.approx(2.5)


def test_nees_of_missing_values_and_of_indefinite_covariances():
    error = np.array([[1.0, 2.0], [np.nan, 1.0], [1.0, 2.0], [1.0, 2.0], [1.0, 0.0]])
    covariance = np.array(
        [np.eye(2), np.eye(2), np.full((2, 2), np.nan), np.diag([1.0, -1.0]), np.zeros((2, 2))]
    )
    np.testing.assert_array_equal(
        nees_per_axis(error, covariance), [2.5, np.nan, np.nan, np.inf, np.inf]
    )


def test_the_interval_is_the_chi_square_one():
    for samples, axes, confidence in [(43, 2, 0.99), (2.5, 1, 0.95)]:
        found = chi_square_interval(samples, axes, confidence)
        expected = chi2.interval(confidence, samples * axes) / np.float64(samples * axes)
        np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_independent_values_count_in_full_and_correlated_ones_by_their_autocorrelation():
    random = np.random.default_rng(4)
    white = random.standard_normal((200, 40))
    assert effective_samples(white) == pytest.approx(8000, rel=0.1)
    correlated = np.empty_like(white)
    correlated[:, 0] = white[:, 0]
    for k in range(1, 40):
        correlated[:, k] = 0.8 * correlated[:, k - 1] + 0.6 * white[:, k]
    # first-order autoregression with coefficient a: tau = (1 + a) / (1 - a) = 9 for long runs, a
    # little less for 40 values
    assert 8000 / 9 < effective_samples(correlated) < 8000 / 6
    assert effective_samples(np.repeat(white[:, :1], 40, axis=1)) == pytest.approx(200)


def within(error, covariance):
    """Whether the mean NEES lies in its interval."""
    mean, (low, high) = mean_nees(nees_per_axis(error, covariance))
    return low <= mean <= high


def test_the_mean_of_a_consistent_correlated_filter_lies_in_its_interval():
    random = np.random.default_rng(5)
    hits = 0
    for _ in range(200):
        noise = random.standard_normal((30, 40, 2))
        error = noise.copy()
        for k in range(1, 40):
            error[:, k] = 0.9 * error[:, k - 1] + math.sqrt(1 - 0.81) * noise[:, k]
        hits += within(error, np.eye(2))
    # 95 % less 4 sigma of 200 trials and the error of an estimated autocorrelation
    assert hits / 200 > 0.87


@pytest.mark.parametrize(("factor", "consistent"), [(1.0, True), (1.5, False), (1 / 1.5, False)])
def test_overconfidence_and_modesty_are_seen(factor, consistent):
    """By the mean NEES, and by the spread of runs at each instant, one of which is enough."""
    error = draw(np.random.default_rng(6), 20, 30)
    assert within(error, factor * COVARIANCE) is consistent
    error, covariance = draw(np.random.default_rng(7), 100, 5), np.tile(COVARIANCE, (5, 1, 1))
    covariance[3] *= factor
    assert spread_test(error, covariance).consistent is consistent


def test_no_value_gives_nan():
    mean, interval = mean_nees(np.full((2, 3), np.nan))
    assert math.isnan(mean) and math.isnan(interval[0])
    assert effective_samples(np.array([[1.0, np.nan]])) == 1.0
