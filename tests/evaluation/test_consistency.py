import math

import numpy as np
import pytest

from isogal.evaluation.consistency import (
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


@pytest.mark.parametrize(("factor", "consistent"), [(1.0, True), (1.5, False), (1 / 1.5, False)])
def test_overconfidence_and_modesty_are_seen(factor, consistent):
    """By the mean NEES, and by the spread of runs at each instant, one of which is enough."""
    error = draw(np.random.default_rng(6), 20, 30)
    assert within(error, factor * COVARIANCE) is consistent
    error, covariance = draw(np.random.default_rng(7), 100, 5), np.tile(COVARIANCE, (5, 1, 1))
    covariance[3] *= factor
    assert spread_test(error, covariance)[-1] is consistent


def test_no_value_gives_nan():
    mean, interval = mean_nees(np.full((2, 3), np.nan))
    assert math.isnan(mean) and math.isnan(interval[0])
    assert effective_samples(np.array([[1.0, np.nan]])) == 1.0
