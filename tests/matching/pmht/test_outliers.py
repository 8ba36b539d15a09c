"""Spikes are found, clean data are left alone, wrong places are not taken for spikes."""

import numpy as np
import pytest
from scipy.stats import norm

from isogal.matching.pmht.outliers import leave_one_out, outliers, smooth_covariance

T = 40
LATITUDE, LONGITUDE = (
    -0.63 + 2e-5 * np.arange(T),
    2.56 + 3e-5 * np.arange(T),
)  # about 210 m from scan to scan
WHITE = 1e-10 * np.eye(T)
SMOOTH = smooth_covariance(LATITUDE, LONGITUDE, 5e-5, 1500.0)
SMOOTH = WHITE + 0.5 * (SMOOTH + SMOOTH.T)  # metres east are counted at one of the two latitudes


def draw(covariance, seed):
    return np.linalg.cholesky(covariance) @ np.random.default_rng(seed).standard_normal(
        len(covariance)
    )


@pytest.mark.parametrize("covariance", [WHITE, SMOOTH], ids=["white", "smooth"])
def test_leave_one_out_is_the_conditional_normal(covariance):
    residual = draw(covariance, 0)
    got = leave_one_out(residual, covariance)
    for i in (0, 17, T - 1):
        rest = np.delete(np.arange(T), i)
        weight = np.linalg.solve(covariance[np.ix_(rest, rest)], covariance[rest, i])
        variance = covariance[i, i] - weight @ covariance[rest, i]
        assert got[i] == pytest.approx(
            (residual[i] - weight @ residual[rest]) / np.sqrt(variance), rel=1e-6
        )


@pytest.mark.parametrize("covariance", [WHITE, SMOOTH], ids=["white", "smooth"])
def test_clean_residuals_are_left_alone(covariance):
    """At 4.5 sigma a reading in 147 000 is lost; 300 batches of 40 lose none, nearly always."""
    lost = sum(int(outliers(draw(covariance, seed), covariance, 4.5).sum()) for seed in range(300))
    assert lost <= 2
    assert 300 * T * 2 * norm.sf(4.5) < 0.1


@pytest.mark.parametrize("covariance", [WHITE, SMOOTH], ids=["white", "smooth"])
@pytest.mark.parametrize(
    "places", [[20], [0], [T - 1], [5, 6], [3, 12, 13, 30, 38], list(range(0, 24, 2))]
)
def test_spikes_are_found_where_they_are(covariance, places):
    residual = draw(covariance, 1)
    signs = np.where(np.arange(len(places)) % 3 == 0, -1.0, 1.0)
    residual[places] += signs * 1e-5 * np.linspace(60.0, 15.0, len(places))
    found = np.flatnonzero(outliers(residual, covariance, 4.5))
    np.testing.assert_array_equal(found, places)


def test_a_smooth_covariance_is_not_a_spike():
    """What a place 2 km away does to the residuals: tens of sigma, but smooth along the track."""
    wave = 4e-5 * np.sin(2.0 * np.pi * np.arange(T) / 30.0)
    residual = wave + draw(WHITE, 2)
    assert not outliers(residual, SMOOTH, 6.5).any()
    residual[11] += 3e-4
    np.testing.assert_array_equal(np.flatnonzero(outliers(residual, SMOOTH, 6.5)), [11])


def test_where_nearly_all_stick_out_the_model_is_wrong_and_nothing_is_removed():
    residual = draw(WHITE, 3)
    residual[:25] += 1e-3 * np.random.default_rng(4).choice([-1.0, 1.0], 25)
    assert not outliers(residual, WHITE, 4.5).any()
    assert outliers(residual, WHITE, 4.5, largest_share=0.7).sum() == 25


@pytest.mark.parametrize("count", [0, 1, 2])
def test_too_few_to_judge(count):
    assert outliers(np.full(count, 1.0), np.eye(count), 4.5).shape == (count,)
    assert not outliers(np.full(count, 100.0), np.eye(count), 4.5).any()


def test_smooth_covariance_falls_off_with_distance():
    covariance = smooth_covariance(LATITUDE, LONGITUDE, 3e-5, 1500.0)
    np.testing.assert_allclose(np.diag(covariance), 9e-10)
    distance = np.hypot(6.36e6 * 2e-5, 6.387e6 * np.cos(0.63) * 3e-5) * np.arange(T)
    np.testing.assert_allclose(
        covariance[0], 9e-10 * np.exp(-0.5 * (distance / 1500.0) ** 2), rtol=0.05
    )
    assert np.linalg.eigvalsh(covariance + 1e-14 * np.eye(T))[0] > 0.0
