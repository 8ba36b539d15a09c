"""The baseline matchers: what all have in common, and the parts of some by hand."""

import dataclasses

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.baselines.iccp import Iccp
from isogal.matching.baselines.readings import (
    AssumedNoise,
    UsableReadings,
)
from isogal.matching.baselines.sitan import Sitan, SitanOptions
from isogal.matching.baselines.tercom import Tercom
from isogal.matching.baselines.viterbi import Viterbi
from isogal.matching.failures import UNEXPLAINED
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
    for seed in range(40):
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
    assert len(nees) >= 33
    assert np.median(ratio) < {"iccp": 0.8}.get(name, 0.55)
    # 40 values of chi-square(2)/2: mean 1 +- 0.16, 99.9 % below 1.6; ICCP is cautious, none may
    # be overconfident
    assert 0.15 < np.mean(nees) < 1.6


@pytest.mark.parametrize("name", NAMES)
def test_a_prior_much_wider_than_the_map_is_no_error(rough_map, name):
    # of the point-mass grid's first nodes only a few lie on the map
    batch, _ = make_batch(rough_map, DRIFT, prior_sigma=(3e5, 0.05))
    fix, _ = build(name).match(batch, rough_map, None)
    assert not fix.published or np.isfinite(fix.covariance).all()


@pytest.mark.parametrize("name", ["iccp", "particle"])
def test_readings_that_no_place_explains_give_no_fix(rough_map, name):
    batch, _ = make_batch(rough_map, DRIFT, sigma=1e-4)
    surer = dataclasses.replace(batch, sigma=np.full(30, 2e-6))
    fix, _ = build(name).match(surer, rough_map, None)
    assert UNEXPLAINED in fix.diagnostics, fix.reason


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


def test_a_map_that_repeats_itself_gives_no_fix():
    # waves of 1 km northwards and eastwards: every kilometre fits
    def egg_box(n, e):
        return 2e-5 * (np.sin(2 * np.pi * n / 1000.0) + np.sin(2 * np.pi * e / 1000.0))

    eggs = field_map_of(egg_box, half=20e3, step=100.0)
    batch, _ = make_batch(eggs, prior_sigma=(800.0, 0.02))
    fix, _ = Tercom().match(batch, eggs, None)
    assert fix.reason == "no unique shift of least difference in the search window"
    assert fix.diagnostics["ambiguity"] > 0.5
    narrow, _ = make_batch(eggs, prior_sigma=(80.0, 0.02))
    fix, _ = Tercom().match(narrow, eggs, None)
    assert fix.published


def test_noise_wider_than_the_window_gives_no_fix(rough_map):
    batch, _ = make_batch(rough_map, sigma=5e-4)
    fix, _ = Iccp().match(batch, rough_map, None)
    assert "have a contour in the search window" in fix.reason


@pytest.mark.parametrize("region", [0.0, 1.5])
@pytest.mark.parametrize("bias_sigma", [0.0, 3e-5])
def test_exact_on_a_plane_map(region, bias_sigma):
    tilted = field_map_of(lambda n, e: 3e-8 * n - 2e-8 * e)
    batch, _ = make_batch(
        tilted, (200.0, -100.0, 0.05, 0.0), sigma=1e-5, jacobian=(-8e-9, 0.0, 6e-6, 1.2e-4)
    )
    noise = AssumedNoise(bias_sigma=bias_sigma)
    fix, _ = Sitan(noise, SitanOptions(region=region)).match(batch, tilted, None)
    # least squares on all readings at once; a plane in metres is a plane in degrees up to the
    # map's curvature, a metre here
    readings = UsableReadings.of(batch, tilted, noise, whole=True)
    residual, slope = readings.linearise(tilted, np.zeros(4))
    R = np.diag(readings.arrays.sigma**2) + bias_sigma**2
    matrix = slope.T @ np.linalg.solve(R, slope)
    np.testing.assert_allclose(fix.information.matrix, matrix, rtol=2e-3, atol=1e-4 * matrix.max())
    posterior = np.linalg.inv(np.linalg.inv(batch.prior) + matrix)
    mean = -posterior @ slope.T @ np.linalg.solve(R, residual)
    told = np.linalg.solve(
        np.linalg.inv(batch.prior) + fix.information.matrix, fix.information.vector
    )
    units = np.array([1.0, 1.0, 1e-3, 1e-3])
    np.testing.assert_allclose(told / units, mean / units, atol=1.0)


def test_gate_leaves_a_spike_out(rough_map):
    batch, _ = make_batch(rough_map, prior_sigma=(100.0, 0.05))
    batch.reading[10] += 50e-5
    fix, _ = Sitan(options=SitanOptions(gate=5.0)).match(batch, rough_map, None)
    assert fix.diagnostics["readings_used"] == 29.0
    every, _ = Sitan().match(batch, rough_map, None)
    assert every.diagnostics["misfit"] > 3.0 * fix.diagnostics["misfit"]
    batch.reading[:] += 1.0
    none, _ = Sitan(options=SitanOptions(gate=5.0)).match(batch, rough_map, None)
    assert UNEXPLAINED in none.diagnostics


def test_a_path_at_the_edge_is_no_fix(rough_map):
    batch, _ = make_batch(rough_map, (900.0, 900.0, 0.0, 0.0), prior_sigma=(100.0, 0.02))
    fix, _ = Viterbi().match(batch, rough_map, None)
    assert fix.reason == "the most probable path ends at the edge of the search grid"
