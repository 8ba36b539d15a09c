"""The batch likelihood against scipy's multivariate normal on a plane map, where everything is
linear; what is left out; trouble."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from helpers.batches import field_map_of, make_batch
from isogal.earth.frames import horizontal_difference
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.noise_model import NoiseModel, residual_covariance
from isogal.matching.reading_noise import reading_covariance
from isogal.scenario import Gravimeter

T, SIGMA = 12, 1e-5
SLOPE = np.array([2e-8, -3e-8])
PLANE = field_map_of(
    lambda north, east: SLOPE[0] * north + SLOPE[1] * east, half=40e3, step=2000.0
)
CORRELATED = NoiseModel(map_sigma=3e-5, correlation_length=1500.0, bias_sigma=2e-5)
XI = np.array([[0.0, 0.0, 0.0, 0.0], [150.0, -80.0, 0.1, 0.2], [-2000.0, 1500.0, -1.0, 0.5]])


def plane_batch(new=T, drift=True, field_map=PLANE, **changes):
    """A batch on the plane with everything that may be in a batch."""
    random = np.random.default_rng(5)
    keys = {
        "new": new,
        "offset": random.normal(0.0, 1e-4, T),
        "sigma": SIGMA * random.uniform(0.5, 3.0, T),
    }
    if drift:
        age = np.linspace(1.0, 0.0, T)[:, None, None]
        keys |= {
            "nuisance_position": 400.0 * age**2 * random.standard_normal((1, 2, 3)),
            "nuisance_reading": 5e-6 * age[:, 0] * random.standard_normal(3),
        }
    batch, _ = make_batch(
        field_map,
        (100.0, 50.0, 0.1, -0.1),
        scans=T,
        jacobian=(1e-9, 0.0, 3e-6, 1e-4),
        seed=1,
        **keys | changes,
    )
    return batch


def linear_model(batch, noise, field_map=PLANE):
    """Mean of the readings by xi: m + H xi; covariance R of what is not drift, drift G."""
    at = field_map.value(batch.latitude, batch.longitude) + batch.offset
    _, north, east = field_map.value_and_gradient(batch.latitude, batch.longitude)
    gradient = np.stack([north, east], axis=-1)
    H = -np.einsum("ti,tij->tj", gradient, batch.transition) + batch.reading_jacobian
    apart = horizontal_difference(
        batch.latitude[:, None], batch.longitude[:, None], batch.latitude, batch.longitude
    )
    distance = np.hypot(apart[..., 0], apart[..., 1])
    distance = 0.5 * (distance + distance.T)  # metres east are counted at one of the two latitudes
    R = (
        np.diag(batch.sigma**2)
        + noise.map_sigma**2 * np.exp(-distance / noise.correlation_length)
        + noise.bias_sigma**2
    )
    G = np.einsum("ti,tij->tj", gradient, batch.nuisance_position) - batch.nuisance_reading
    return at, H, R, G


@pytest.mark.parametrize("drift", [False, True])
@pytest.mark.parametrize(
    "noise", [NoiseModel(), CORRELATED, NoiseModel(bias_sigma=1e-4)], ids=["white", "map", "bias"]
)
def test_log_is_that_of_the_multivariate_normal(noise, drift):
    batch = plane_batch(drift=drift)
    likelihood = BatchLikelihood.of(batch, PLANE, noise)
    at, H, R, G = linear_model(batch, noise)
    expected = [multivariate_normal.logpdf(batch.reading, at + H @ xi, R + G @ G.T) for xi in XI]
    np.testing.assert_allclose(likelihood.log(XI) + likelihood.log_normaliser, expected, rtol=1e-8)
    assert likelihood.misfit(XI[1]) == pytest.approx(-2.0 * likelihood.log(XI[1:2])[0])
    assert likelihood.new_count == T


@pytest.mark.parametrize("noise", [NoiseModel(), CORRELATED], ids=["white", "map"])
def test_new_readings_count_given_the_old(noise):
    """Conditional = joint / marginal."""
    batch = plane_batch(new=5, drift=False)
    likelihood = BatchLikelihood.of(batch, PLANE, noise)
    at, H, R, _ = linear_model(batch, noise)
    old = slice(0, T - 5)
    for xi, log in zip(XI, likelihood.log(XI), strict=True):
        mean = at + H @ xi
        joint = multivariate_normal.logpdf(batch.reading, mean, R)
        marginal = multivariate_normal.logpdf(batch.reading[old], mean[old], R[old, old])
        assert log + likelihood.log_normaliser == pytest.approx(joint - marginal, rel=1e-8)
    assert likelihood.new_count == 5


def test_noise_correlated_in_time_is_beside_the_map_s():
    """Against a dense normal, new readings given the old."""
    times = 1000.0 + np.array([0, 10, 20, 30, 60, 70, 80, 90, 100, 110, 180, 190.0])
    turning = np.stack([20.0 * np.cos(times / 90.0), 20.0 * np.sin(times / 90.0)], axis=1)
    instrument = Gravimeter(
        correlated_sigma=2e-5, correlation_time=45.0, cross_coupling=5e-5, interval=10.0
    )
    batch = plane_batch(new=5, drift=False, time=times)
    batch = replace(
        batch, reading_covariance=reading_covariance(instrument, times, batch.sigma, turning)
    )
    batch = replace(batch, reading=np.where(np.arange(T) == 8, np.nan, batch.reading))
    likelihood = BatchLikelihood.of(batch, PLANE, CORRELATED)
    there = np.isfinite(batch.reading)
    at, H, R, _ = linear_model(batch, CORRELATED)
    coupling = np.zeros((T, 2))
    for i in range(T):
        a, b = (i - 1, i) if i else (0, 1)
        mean = (turning[b] - turning[a]) / (times[b] - times[a])
        course = np.arctan2(*(turning[a] + turning[b])[::-1])
        forward = mean @ [np.cos(course), np.sin(course)]
        coupling[i] = forward, mean @ [-np.sin(course), np.cos(course)]
    for i in range(T):
        for j in range(T):
            R[i, j] += 4e-10 * np.exp(-abs(times[i] - times[j]) / 45.0)
            R[i, j] += 25e-10 * (coupling[i] @ coupling[j])
    old = there & (np.arange(T) < T - 5)
    for xi, log in zip(XI, likelihood.log(XI), strict=True):
        mean = at + H @ xi
        joint, marginal = (
            multivariate_normal.logpdf(batch.reading[some], mean[some], R[np.ix_(some, some)])
            for some in (there, old)
        )
        assert log + likelihood.log_normaliser == pytest.approx(joint - marginal, rel=1e-8)
    assert likelihood.new_count == 4


def test_drift_of_new_readings_given_the_old():
    """The navigator's prior of the drift has seen the old readings: their residuals predict the
    map error only."""
    batch = plane_batch(new=5)
    likelihood = BatchLikelihood.of(batch, PLANE, CORRELATED)
    at, H, R, G = linear_model(batch, CORRELATED)
    old, new = slice(0, T - 5), slice(T - 5, T)
    predict = R[new, old] @ np.linalg.inv(R[old, old])
    S = R[new, new] - predict @ R[old, new]
    moved = G[new] - predict @ G[old]
    for xi, log in zip(XI, likelihood.log(XI), strict=True):
        residual = batch.reading - at - H @ xi
        expected = multivariate_normal.logpdf(
            residual[new] - predict @ residual[old], np.zeros(5), S + moved @ moved.T
        )
        assert log + likelihood.log_normaliser == pytest.approx(expected, rel=1e-8)


def test_likelihoods_of_successive_batches_make_up_that_of_all_readings():
    whole = BatchLikelihood.of(plane_batch(drift=False), PLANE, CORRELATED)
    first = BatchLikelihood.of(
        plane_batch(drift=False, reading=_blank(plane_batch(drift=False).reading, 7)),
        PLANE,
        CORRELATED,
    )
    second = BatchLikelihood.of(plane_batch(new=5, drift=False), PLANE, CORRELATED)
    total = first.log(XI) + first.log_normaliser + second.log(XI) + second.log_normaliser
    np.testing.assert_allclose(total, whole.log(XI) + whole.log_normaliser, rtol=1e-9)


def _blank(reading, start):
    return np.where(np.arange(len(reading)) < start, reading, np.nan)


@pytest.mark.parametrize("how", ["nan", "without"])
def test_readings_left_out_are_as_if_never_taken(how):
    batch = plane_batch(new=6)
    bad = np.isin(np.arange(T), [2, 7, 11])
    if how == "nan":
        likelihood = BatchLikelihood.of(
            replace(batch, reading=np.where(bad, np.nan, batch.reading)), PLANE, CORRELATED
        )
    else:
        likelihood = BatchLikelihood.of(batch, PLANE, CORRELATED).without(bad)
    kept = replace(batch.part(np.flatnonzero(~bad)), new=4)
    expected = BatchLikelihood.of(kept, PLANE, CORRELATED)
    np.testing.assert_allclose(likelihood.log(XI), expected.log(XI), rtol=1e-9)
    assert likelihood.new_count == expected.new_count == 4
    np.testing.assert_array_equal(likelihood.rows, np.flatnonzero(~bad))


def test_without_nothing_bad_is_itself():
    likelihood = BatchLikelihood.of(plane_batch(), PLANE, CORRELATED)
    assert likelihood.without(np.zeros(T, dtype=bool)) is likelihood


def test_rounding_and_sigma_of_the_map_are_in_the_covariance():
    batch = plane_batch()
    rounded = replace(PLANE, quantisation=3e-5)
    expected = np.diag(batch.sigma**2 + 3e-5**2 / 12.0)
    np.testing.assert_allclose(
        BatchLikelihood.of(batch, rounded, NoiseModel()).covariance, expected, rtol=1e-12
    )
    side = np.linspace(1e-5, 9e-5, PLANE.values.shape[1]) * np.ones((PLANE.values.shape[0], 1))
    uneven = replace(PLANE, sigma=side)
    here = (np.zeros(4), np.zeros((4, 4)))
    covariance = BatchLikelihood.of(batch, uneven, CORRELATED, place=here).covariance
    own = np.maximum(
        uneven.sigma_at(batch.latitude, batch.longitude), 3e-5
    )  # the larger of what map and user say
    np.testing.assert_allclose(np.diag(covariance), batch.sigma**2 + own**2 + 2e-5**2, rtol=1e-12)
    assert own.max() > 3e-5


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1e-4), st.floats(10.0, 1e5), st.floats(0.0, 1e-3))
def test_covariance_is_symmetric_positive_definite(seed, map_sigma, length, bias):
    random = np.random.default_rng(seed)
    n = 25
    latitude, longitude = -0.6 + 1e-3 * random.random(n), 2.5 + 1e-3 * random.random(n)
    white = random.uniform(1e-7, 1e-5, n) ** 2
    R = residual_covariance(latitude, longitude, white, np.full(n, map_sigma), length, bias)
    assert (R == R.T).all()
    np.linalg.cholesky(R)
    np.testing.assert_allclose(np.diag(R), white + map_sigma**2 + bias**2)


def test_off_the_map_nothing_is_likely():
    batch = plane_batch()
    likelihood = BatchLikelihood.of(batch, PLANE, CORRELATED)
    away = np.array([[1e6, 0.0, 0.0, 0.0], [0.0, 0.0, 500.0, 0.0], [0.0, 0.0, 0.0, 0.0]])
    log = likelihood.log(away)
    assert (log[:2] == -np.inf).all()
    assert np.isfinite(log[2])
    assert likelihood.misfit(away[0]) == np.inf
    assert np.isnan(likelihood.linearise(away[0])[0]).any()
    np.testing.assert_array_equal(likelihood.nuisance_at(away[0]), -batch.nuisance_reading)


def test_a_hole_in_the_map_is_off_the_map():
    values = PLANE.values.copy()
    batch = plane_batch()
    i = int(np.argmin(np.abs(PLANE.latitude - batch.latitude[5])))
    j = int(np.argmin(np.abs(PLANE.longitude - batch.longitude[5])))
    values[i, j] = np.nan
    likelihood = BatchLikelihood.of(batch, replace(PLANE, values=values), NoiseModel())
    assert likelihood.log(np.zeros((1, 4)))[0] == -np.inf


def test_no_readings_say_nothing():
    likelihood = BatchLikelihood.of(plane_batch(reading=np.full(T, np.nan)), PLANE, CORRELATED)
    assert likelihood.new_count == 0
    assert (likelihood.log(XI) == 0.0).all()


def test_linearised_residuals_against_finite_differences(rough_map):
    batch, _ = make_batch(rough_map, (100.0, 50.0, 0.1, -0.1), jacobian=(1e-9, 0.0, 3e-6, 1e-4))
    likelihood = BatchLikelihood.of(batch, rough_map, NoiseModel())
    xi = np.array([60.0, -40.0, 0.2, 0.1])
    residual, slope = likelihood.linearise(xi)
    np.testing.assert_array_equal(residual, likelihood.linearise(xi)[0])
    for i, step in enumerate([0.5, 0.5, 2e-3, 2e-3]):
        d = step * np.eye(4)[i]
        difference = (likelihood.linearise(xi + d)[0] - likelihood.linearise(xi - d)[0]) / (
            2.0 * step
        )
        np.testing.assert_allclose(slope[:, i] * step, difference * step, atol=2e-11)


def test_residuals_at_the_true_error_are_the_noise(rough_map):
    error = (100.0, 50.0, 0.1, -0.1)
    keys = {"jacobian": (1e-9, 0.0, 3e-6, 1e-4)}
    batch, _ = make_batch(rough_map, error, seed=None, **keys)
    likelihood = BatchLikelihood.of(batch, rough_map, NoiseModel())
    np.testing.assert_allclose(likelihood.linearise(np.array(error))[0], 0.0, atol=2e-9)
    assert np.abs(likelihood.linearise(np.zeros(4))[0]).max() > 1e-6


def test_a_factor_on_the_variance(rough_map):
    batch, _ = make_batch(rough_map)
    likelihood = BatchLikelihood.of(batch, rough_map, CORRELATED)
    np.testing.assert_allclose(
        likelihood.scaled(4.0).log(XI), likelihood.log(XI) / 4.0, rtol=1e-12
    )
    np.testing.assert_allclose(likelihood.scaled(4.0).covariance, 4.0 * likelihood.covariance)


def test_many_errors_are_computed_each_for_itself(rough_map):
    batch, _ = make_batch(rough_map)
    likelihood = BatchLikelihood.of(batch, rough_map, CORRELATED)
    together = likelihood.log(XI)
    assert [likelihood.log(xi[None])[0] for xi in XI] == list(together)
