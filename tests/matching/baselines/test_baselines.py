"""What all baseline matchers have in common; tests of a single one are in its own file."""

import dataclasses

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.registry import load_matcher
from isogal.scenario import Matcher

NAMES = ["tercom", "iccp", "sitan", "particle", "point-mass", "viterbi"]
BAYESIAN = ["sitan", "particle", "point-mass", "viterbi"]
DRIFT = (300.0, -200.0, 0.05, 0.03)
GRAVIMETER = (-8e-9, 0.0, 6e-6, 1.2e-4)
"""What wrong latitude and velocity do to a disturbance: normal gravity changes by 0.8 mGal/km, the
Eötvös term with the velocity east (docs/mathematics.md, section 2.6)."""


def build(name, **settings):
    return load_matcher(Matcher(name=name, **settings))


@pytest.mark.parametrize("name", NAMES)
def test_errors_are_small_and_agree_with_the_covariance(rough_map, name):
    # the same prior that the errors are drawn from; the posterior is what a filter has after the
    # fix
    prior = np.diag([150.0**2, 150.0**2, 0.05**2, 0.05**2])
    nees, ratio = [], []
    for seed in range(60):
        random = np.random.default_rng(seed)
        xi = np.sqrt(np.diag(prior)) * random.standard_normal(4)
        batch, truth = make_batch(
            rough_map,
            xi,
            seed=seed,
            sigma=2e-5,
            prior=prior,
            start=random.uniform(-25e3, 20e3, 2),
            jacobian=GRAVIMETER,
        )
        fix, _ = build(name).match(batch, rough_map, None)
        if not fix.published:
            continue
        gain = prior[:2, :2] @ np.linalg.inv(prior[:2, :2] + fix.covariance)
        error = xi[:2] - gain @ (xi[:2] - truth.error_of(fix))
        covariance = (np.eye(2) - gain) @ prior[:2, :2]
        nees.append(error @ np.linalg.solve(covariance, error) / 2.0)
        ratio.append(np.hypot(*error) / np.hypot(*xi[:2]))
    assert len(nees) >= 50
    assert np.median(ratio) < {"iccp": 0.8}.get(name, 0.55)
    # 60 values of chi-square(2)/2: mean 1 +- 0.13, 99.9 % below 1.45; ICCP is cautious, none may
    # be overconfident
    assert 0.15 < np.mean(nees) < 1.6


@pytest.mark.parametrize("name", NAMES)
def test_a_prior_much_wider_than_the_map_is_no_error(rough_map, name):
    # of the point-mass grid's first nodes only a few lie on the map
    batch, _ = make_batch(rough_map, DRIFT, prior_sigma=(3e5, 0.05))
    fix, _ = build(name).match(batch, rough_map, None)
    assert not fix.published or np.isfinite(fix.covariance).all()


@pytest.mark.parametrize("name", NAMES)
def test_same_batch_same_fix_and_memory_untouched(rough_map, name):
    batch, _ = make_batch(rough_map, DRIFT)
    one, memory = build(name).match(batch, rough_map, None)
    other, _ = build(name).match(batch, rough_map, None)
    assert memory is None
    assert (one.latitude, one.longitude) == (other.latitude, other.longitude)
    np.testing.assert_array_equal(one.covariance, other.covariance)


@pytest.mark.parametrize("name", NAMES)
def test_a_noisier_sensor_gives_a_larger_covariance(rough_map, name):
    variances = []
    for sigma in (1e-5, 8e-5):
        batch, _ = make_batch(rough_map, DRIFT, sigma=sigma, prior_sigma=(300.0, 0.05))
        fix, _ = build(name).match(batch, rough_map, None)
        variances.append(np.trace(fix.covariance) if fix.published else np.inf)
    assert variances[0] < variances[1]
    assert np.isfinite(variances[0])


@pytest.mark.parametrize("name", NAMES)
def test_map_error_is_white_noise(rough_map, name):
    batch, _ = make_batch(rough_map, DRIFT, sigma=1e-5)
    doubted, _ = build(name, map_sigma=np.sqrt(15.0) * 1e-5).match(batch, rough_map, None)
    noisy, _ = build(name).match(
        dataclasses.replace(batch, sigma=np.full(30, 4e-5)), rough_map, None
    )
    assert doubted.reason == noisy.reason
    np.testing.assert_allclose(doubted.covariance, noisy.covariance, rtol=1e-6)
    automatic, _ = build(name, map_sigma="auto").match(batch, rough_map, None)
    plain, _ = build(name).match(batch, rough_map, None)
    np.testing.assert_array_equal(automatic.covariance, plain.covariance)


@pytest.mark.parametrize("name", ["tercom", "sitan", "particle", "point-mass"])
def test_an_unknown_bias_is_allowed_for(rough_map, name):
    bias = 5e-5
    batch, truth = make_batch(
        rough_map, (150.0, -100.0, 0.02, 0.02), sigma=2e-6, prior_sigma=(200.0, 0.05)
    )
    batch = dataclasses.replace(batch, reading=batch.reading + bias)
    fix, _ = build(name, bias_sigma=bias).match(batch, rough_map, None)
    assert fix.published
    error = truth.error_of(fix)
    assert error @ np.linalg.solve(fix.covariance, error) < 18.4  # chi-square(2), 1e-4
    assert np.hypot(*error) < 100.0


@pytest.mark.parametrize("name", NAMES)
def test_declines_with_a_reason(rough_map, name):
    matcher = build(name)
    batch, _ = make_batch(rough_map, DRIFT)
    missing, _ = matcher.match(
        dataclasses.replace(batch, reading=np.full(30, np.nan)), rough_map, None
    )
    assert missing.reason.startswith("only 0 of 30 scans have a reading")
    assert np.isnan(missing.covariance).all()
    outside, _ = make_batch(rough_map, start=(0.0, 80e3), reading=np.zeros(30))
    fix, _ = matcher.match(outside, rough_map, None)
    assert "have the map around them" in fix.reason
    flat = field_map_of(lambda n, e: 0.0 * n * e)
    nothing, _ = matcher.match(make_batch(flat)[0], flat, None)
    assert nothing.reason is not None


@pytest.mark.parametrize("name", NAMES)
def test_works_with_a_few_readings_missing(rough_map, name):
    batch, truth = make_batch(rough_map, (60.0, -40.0, 0.01, 0.01), prior_sigma=(100.0, 0.03))
    reading = batch.reading.copy()
    reading[[2, 3, 17]] = np.nan
    fix, _ = build(name).match(dataclasses.replace(batch, reading=reading), rough_map, None)
    assert fix.published
    error = truth.error_of(fix)
    assert error @ np.linalg.solve(fix.covariance, error) < 18.4


@pytest.mark.parametrize("name", BAYESIAN)
def test_takes_new_readings_only(rough_map, name):
    batch, _ = make_batch(rough_map, DRIFT, new=10)
    garbled = batch.reading.copy()
    garbled[:20] += 1.0
    one, _ = build(name).match(batch, rough_map, None)
    other, _ = build(name).match(dataclasses.replace(batch, reading=garbled), rough_map, None)
    assert (one.latitude, one.longitude, one.reason) == (
        other.latitude,
        other.longitude,
        other.reason,
    )
