"""A planted map error comes back: sigma within a factor of 1.4, length within 2.5, none where
there is none."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import make_batch
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.map_error import MapErrorEstimate, _means, differs, roughness
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.noise_model import NoiseModel, residual_covariance
from isogal.matching.pmht.sensor_bias import BiasEstimate
from isogal.scenario import Matcher as MatcherSettings

BASE = NoiseModel(bias_sigma=0.0)
BATCHES = 12
SCANS = 60


def estimate(field_map, sigma, length, batches=BATCHES, bias=0.0, told=None, it=None):
    for k in range(batches):
        start = (-12e3 + 1500.0 * k, -12e3 + 1700.0 * (k % 5))
        batch, _ = make_batch(
            field_map,
            (80.0, -60.0, 0.02, 0.01),
            scans=SCANS,
            sigma=1e-5,
            prior_sigma=(100.0, 0.03),
            start=start,
            velocity=(17.0, 18.0),
            seed=k,
        )
        random = np.random.default_rng(1000 + k)
        R = residual_covariance(
            batch.latitude,
            batch.longitude,
            np.full(SCANS, 1e-14),
            np.full(SCANS, sigma),
            length,
            0.0,
        )
        planted = (
            np.linalg.cholesky(R) @ random.standard_normal(SCANS) + bias * random.standard_normal()
        )
        batch = replace(batch, reading=batch.reading + planted)
        it = it or MapErrorEstimate.unknown(batch, field_map)
        known = bias if told is None else told
        batch = (
            BiasEstimate.unknown(float(batch.time[0]), known, 0.0).at_end(batch).added_to(batch)
        )
        likelihood = BatchLikelihood.of(batch, field_map, it.model(BASE))
        it = it.update(batch, likelihood, field_map, np.zeros(4))
    return it


@pytest.mark.parametrize(("sigma", "length"), [(3e-5, 4000.0), (1e-5, 2000.0), (6e-5, 1000.0)])
def test_planted_sigma_and_length_come_back(rough_map, sigma, length):
    model = estimate(rough_map, sigma, length).model(BASE)
    assert sigma / 1.4 < model.map_sigma < sigma * 1.4
    assert length / 2.5 < model.correlation_length < length * 2.5


def test_a_right_map_is_found_right(rough_map):
    it = estimate(rough_map, 0.0, 4000.0)
    assert it.model(BASE).map_sigma < 3e-6  # a third of the sensor's noise
    assert it.batches == BATCHES


def test_a_bias_is_not_taken_for_map_error(rough_map):
    model = estimate(rough_map, 1e-6, 4000.0, bias=1e-4).model(BASE)
    assert model.map_sigma < 5e-6
    not_told = estimate(rough_map, 1e-6, 4000.0, bias=1e-4, told=0.0).model(BASE)
    assert not_told.map_sigma > 3e-5


def test_it_sharpens_with_every_batch(rough_map):
    few, many = (estimate(rough_map, 3e-5, 4000.0, batches=n) for n in (1, 8))
    assert many.probability.max() > few.probability.max()
    assert few.probability.sum() == pytest.approx(1.0)


def test_start_knows_nothing_and_scales_with_the_map(rough_map):
    batch, _ = make_batch(rough_map)
    start = MapErrorEstimate.unknown(batch, rough_map)
    assert start.batches == 0
    assert start.doubt == pytest.approx(0.0, abs=1e-12)
    by_sigma = start.probability.sum(axis=1)
    small = start.sigma < roughness(rough_map)
    assert np.ptp(by_sigma[small]) == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(by_sigma[~small]) < 0.0).all()
    much = replace(rough_map, values=10.0 * rough_map.values)
    tenfold = MapErrorEstimate.unknown(replace(batch, sigma=10.0 * batch.sigma), much)
    np.testing.assert_allclose(tenfold.sigma, 10.0 * start.sigma)
    np.testing.assert_allclose(tenfold.prior, start.prior, atol=1e-9)
    assert (
        start.sigma[0]
        < 0.01 * rough_map.values.std()
        < 0.3 * rough_map.values.std()
        < start.sigma[-1]
    )
    flat = MapErrorEstimate.unknown(batch, replace(rough_map, values=0.0 * rough_map.values))
    assert (flat.sigma > 0.0).all()


def test_readings_of_much_noise_make_no_map_worse(rough_map):
    """Three per cent of their noise were once the least error that a map could have: with 1e5 mGal
    the horizontal gravity of the map was then taken for 3000 mGal wrong."""
    batch, _ = make_batch(rough_map)
    poor = MapErrorEstimate.unknown(replace(batch, sigma=1e5 * batch.sigma), rough_map)
    assert poor.sigma[0] == pytest.approx(roughness(rough_map))
    assert poor.model(BASE).map_sigma < 6.0 * roughness(rough_map)


def test_nothing_is_learnt_off_the_map(rough_map):
    batch, _ = make_batch(rough_map, prior_sigma=(100.0, 0.03))
    start = MapErrorEstimate.unknown(batch, rough_map)
    away = np.array([1e6, 0.0, 0.0, 0.0])
    assert (
        start.update(batch, BatchLikelihood.of(batch, rough_map, BASE), rough_map, away) is start
    )


@pytest.mark.parametrize("before", [0, 4, 10])
def test_evidence_is_the_density_of_the_new_given_the_old(rough_map, before):
    """Against dense Gaussians: p(all residuals of a fixed navigator) / p(old ones), the
    navigator's error known to the new ones only."""
    scans = 16
    batch, _ = make_batch(
        rough_map,
        (30.0, -20.0, 0.01, 0.0),
        scans=scans,
        prior_sigma=(60.0, 0.03),
        velocity=(17.0, 18.0),
    )
    random = np.random.default_rng(before)
    batch = replace(
        batch,
        new=scans - before,
        nuisance_reading=1e-5 * random.standard_normal((scans, 2)),
        nuisance_position=20.0 * random.standard_normal((scans, 2, 2)),
        reading=batch.reading + 2e-5 * random.standard_normal(),
    )
    start = MapErrorEstimate.unknown(batch, rough_map)
    likelihood = BatchLikelihood.of(batch, rough_map, replace(BASE, map_sigma=2e-5))
    mean = np.array([10.0, 10.0, 0.0, 0.0])
    got = start.update(batch, likelihood, rough_map, mean).log_weight - start.prior
    residual, slope = likelihood.linearise(mean)
    drift = likelihood.nuisance_at(mean)
    fixed = residual - slope @ mean
    known = slope @ batch.prior @ slope.T + drift @ drift.T
    expected = np.empty_like(got)
    for i, sigma in enumerate(start.sigma):
        for j, length in enumerate(start.length):
            R = residual_covariance(
                batch.latitude, batch.longitude, batch.sigma**2, np.full(scans, sigma), length, 0.0
            )
            # given the old residuals, at a given error: regression; then the error is integrated
            # out
            gain = (
                np.linalg.solve(R[:before, :before], R[:before, before:]).T
                if before
                else np.zeros((scans, 0))
            )
            turn = np.concatenate([-gain, np.eye(scans - before)], axis=1)
            S = turn @ (known + R) @ turn.T
            expected[i, j] = multivariate_normal(np.zeros(scans - before), S).logpdf(turn @ fixed)
    np.testing.assert_allclose(got - got.max(), expected - expected.max(), atol=1e-6)


def test_differs_and_figures(rough_map):
    batch, _ = make_batch(rough_map)
    start = MapErrorEstimate.unknown(batch, rough_map)
    model = start.model(BASE)
    assert not differs(model, model)
    assert not differs(model, replace(model, map_sigma=1.15 * model.map_sigma))
    assert differs(model, replace(model, map_sigma=1.3 * model.map_sigma))
    assert differs(model, replace(model, correlation_length=0.7 * model.correlation_length))
    assert start.figures(BASE) == {
        "map_sigma": model.map_sigma,
        "map_correlation_length_m": model.correlation_length,
    }


@pytest.mark.parametrize(
    ("sigma", "length"),
    [(6e-5, 4000.0), (1.5e-5, 4000.0), (3e-5, 8000.0), (3e-5, 2000.0), (3e-5, 4000.0)],
)
def test_what_was_told_is_set_right(rough_map, sigma, length):
    """The map errs by 3 mGal with 4 km; told twice or half of either, the estimate comes back
    towards the truth."""
    told = NoiseModel(map_sigma=sigma, correlation_length=length)
    it = MapErrorEstimate.told(told, 2.0)
    assert it.model(told) == told  # to the letter before there is evidence
    model = estimate(rough_map, 3e-5, 4000.0, it=it).model(told)
    assert 3e-5 / 1.3 < model.map_sigma < 3e-5 * 1.3
    assert abs(np.log(model.correlation_length / 4000.0)) < 0.7 * np.log(2.0)
    assert model.map_sigma > 2.0 * estimate(rough_map, 5e-6, 4000.0, it=it).model(told).map_sigma


@pytest.mark.parametrize(
    ("sigma", "length", "doubted"),
    [
        (1.5e-5, 4000.0, True),
        (3e-5, 4000.0, False),
        (6e-5, 4000.0, False),
        (3e-5, 8000.0, False),
        (3e-5, 2000.0, False),
    ],
)
def test_only_a_map_that_is_worse_than_told_is_doubted(rough_map, sigma, length, doubted):
    it = MapErrorEstimate.told(NoiseModel(map_sigma=sigma, correlation_length=length), 2.0)
    assert it.doubt == pytest.approx(0.0, abs=1e-12)
    later = estimate(rough_map, 3e-5, 4000.0, it=it)
    assert (later.doubt > 4.0) if doubted else (later.doubt < 2.5)
    batch, _ = make_batch(rough_map)
    assert MapErrorEstimate.unknown(batch, rough_map).doubt == pytest.approx(0.0, abs=1e-12)


def test_between_points_of_the_grid_sigma_is_found(rough_map):
    """The log evidence of n readings of variance s is -n / 2 (log sigma² + s / sigma²)."""
    batch, _ = make_batch(rough_map)
    start = MapErrorEstimate.unknown(batch, rough_map)
    for truth in (2.1e-5, 2.3e-5, 2.45e-5):
        evidence = -300.0 * (np.log(start.sigma**2) + (truth / start.sigma) ** 2)
        found = replace(start, log_weight=start.prior + evidence[:, None], batches=1)
        assert found.model(BASE).map_sigma == pytest.approx(truth, rel=0.02)


def test_means_over_a_finer_grid_by_parabolas():
    sigma, length = np.geomspace(1e-5, 1e-4, 9), np.geomspace(500.0, 8000.0, 4)
    # parabolas in log sigma: of these the finer grid knows what lies between
    of_sigma = np.log(sigma / 3.1e-5)[:, None]
    log_weight = -8.0 * of_sigma**2 + 0.3 * of_sigma - 0.5 * np.arange(4)
    step = np.log(sigma[1] / sigma[0])
    fine = np.log(sigma)[:, None] + step * np.arange(-0.5, 0.5, 0.25)
    there = fine.ravel()[:, None] - np.log(3.1e-5)
    p = np.exp(-8.0 * there**2 + 0.3 * there - 0.5 * np.arange(4))
    p /= p.sum()
    got = _means(sigma, length, log_weight)
    assert got[0] == pytest.approx((p.sum(axis=1) * np.exp(fine.ravel())).sum(), rel=1e-9)
    assert got[1] == pytest.approx(np.exp(p.sum(axis=0) @ np.log(length)), rel=1e-9)
    few = _means(sigma[:2], length, log_weight[:2])
    p = np.exp(log_weight[:2]) / np.exp(log_weight[:2]).sum()
    assert few[0] == pytest.approx((p.sum(axis=1) * sigma[:2]).sum(), rel=1e-9)


def pmht(**keys) -> Pmht:
    return Pmht.from_settings(MatcherSettings(**({"map_sigma": 0.0} | keys)))


def test_a_fix_says_how_wrong_a_map_of_gravity_is(rough_map):
    batch, _ = make_batch(rough_map, (250.0, -300.0, 0.03, 0.02))
    fix, memory = pmht(map_sigma="auto").match(batch, rough_map, None)
    figures = fix.diagnostics
    assert fix.map_error == (figures["map_sigma"], figures["map_correlation_length_m"])
    told, _ = pmht().match(batch, rough_map, None)
    magnetic = replace(rough_map, quantity="magnetic_anomaly")
    other, _ = pmht(map_sigma="auto").match(batch, magnetic, None)
    assert (told.map_error, other.map_error) == (None, None)
    assert "map_sigma" in other.diagnostics
    silent = replace(batch, reading=np.full(len(batch), np.nan))
    assert pmht(map_sigma="auto").match(silent, rough_map, memory)[0].map_error == fix.map_error
    assert pmht(map_sigma="auto").match(silent, rough_map, None)[0].map_error is None
