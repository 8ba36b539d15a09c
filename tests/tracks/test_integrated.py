"""Rigid tracks with the noise integrated out: densities, the map beyond its edge, error bars."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import ORIGIN, make_batch
from helpers.tracks import field_of, made_track
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.consistency import chi_square_interval, nees_per_axis
from isogal.maps.error_ellipses import ellipses_of
from isogal.scenario import Matcher
from isogal.seeds import generator
from isogal.tracks.continued_map import continued
from isogal.tracks.integrated.evidence import Surroundings, log_likelihoods
from isogal.tracks.integrated.jackknife import jackknife_excess
from isogal.tracks.integrated.matcher import IntegratedMatcher
from isogal.tracks.integrated.noise_models import (
    UNKNOWN_LENGTHS,
    Correlation,
    Told,
    noise_models,
)
from isogal.tracks.integrated.readings import readings_of
from isogal.tracks.integrated.search import moments_of, surroundings
from isogal.tracks.matching import Uncertainty, match_track

DISTURBANCE = field_of("disturbance")


def test_log_likelihoods_are_those_of_a_multivariate_normal_distribution():
    random = np.random.default_rng(1)
    x = np.sort(random.uniform(0.0, 2e4, 12))
    distance = np.abs(x[:, None] - x)
    known = np.diag(random.uniform(0.5, 2.0, 12)) + 0.1
    shapes = {"even": np.ones(12), "gradient": random.uniform(0.5, 2.0, 12)}
    around = Surroundings(distance, known, shapes)
    models = noise_models(Told(), own_sigma=False, spread=10.0)
    residual = 3.0 * random.standard_normal((12, 4))
    found = log_likelihoods(residual, models, around)
    for i, j, k, b in ((0, 0, 3, 0), (5, 1, 9, 1), (11, 0, 13, 1)):
        covariance = around.covariance(
            models.correlations[i], models.shapes[j], models.scales[k], models.offsets[b]
        )
        expected = multivariate_normal(np.zeros(12), covariance).logpdf(residual.T)
        np.testing.assert_allclose(found[i, j, k, b], expected, rtol=1e-8)
    assert np.isclose(np.exp(models.log_prior).sum(), 1.0)


def test_what_is_told_narrows_the_models():
    exact = noise_models(Told(sigma=0.0, offset_sigma=0.0), own_sigma=False, spread=10.0)
    assert exact.log_prior.size == 1
    told = noise_models(
        Told(sigma=3.0, correlation_length=2e3, offset_sigma=0.0), own_sigma=False, spread=10.0
    )
    best = np.unravel_index(np.argmax(told.log_prior), told.log_prior.shape)
    assert told.scales[best[2]] == 3.0
    assert told.correlations[best[0]].length == 2e3
    literal = noise_models(Told(3.0, 2e3, 0.0, trust=1.0), own_sigma=False, spread=10.0)
    assert literal.log_prior.size == 1


def test_a_continued_map_is_the_map_where_there_is_one_and_doubtful_elsewhere():
    values = DISTURBANCE.values.copy()
    values[10:14, 20:30] = np.nan
    holed = replace(DISTURBANCE, values=values)
    longer = continued(holed, 5000.0)
    track, _, _ = made_track(DISTURBANCE)
    known = np.isfinite(holed.value(track.latitude, track.longitude))
    inside = longer.field.value(track.latitude, track.longitude)
    assert np.isfinite(inside).all()
    np.testing.assert_allclose(
        inside[known], holed.value(track.latitude, track.longitude)[known], rtol=1e-9
    )
    assert np.isfinite(longer.field.values).all()
    doubt = np.asarray(longer.doubt.sigma)
    assert doubt.max() <= longer.spread
    assert doubt[0, 0] > 0.0
    rows = (longer.field.values.shape[0] - values.shape[0]) // 2
    columns = (longer.field.values.shape[1] - values.shape[1]) // 2
    own = doubt[rows : rows + values.shape[0], columns : columns + values.shape[1]]
    np.testing.assert_array_equal(own > 0.0, np.isnan(values))
    # what the map says of its error goes along
    kriged = replace(holed, correlation_lengths=np.full(values.shape, 3e3), sigma=0.1 + 0 * values)
    around = continued(kriged, 5000.0).field
    np.testing.assert_array_equal(around.correlation_lengths, 3e3)


_ONE_LENGTH = np.ones((*DISTURBANCE.values.shape, 1)) * np.array([1.0, 0.0, 1.0])
"""Circles of 1 m at all nodes."""


def _kriged(azimuth):
    """The map with errors that hold together over 6 km in one direction and 1 km across it, the
    usual length being 2 km."""
    shape = DISTURBANCE.values.shape
    ellipse = ellipses_of(np.array(6e3), np.array(1e3), np.array(azimuth))
    return replace(
        DISTURBANCE,
        sigma=np.full(shape, 2e-5),
        correlation_length=2000.0,
        error_ellipses=np.tile(ellipse, (*shape, 1)),
    )


def test_rows_are_apart_by_the_lengths_of_the_maps_error_in_their_direction():
    batch, _ = make_batch(DISTURBANCE, np.zeros(4), velocity=(0.0, 60.0))
    shifts, weight = np.array([[0.0, 0.0], [300.0, -200.0]]), np.array([0.7, 0.3])
    for azimuth, length in ((0.5 * np.pi, 6e3), (0.0, 1e3)):
        readings = readings_of(batch, continued(_kriged(azimuth), 5000.0))
        distance, alike = readings.in_lengths(shifts, weight)
        np.testing.assert_allclose(
            distance, readings.distance * 2e3 / length, rtol=2e-3, atol=1e-6
        )
        np.testing.assert_allclose(alike, 1.0)
        around = surroundings(readings, shifts, weight)
        np.testing.assert_array_equal(around.distance, distance)
    circles = np.linspace(1e3, 5e3, DISTURBANCE.values.shape[1])[None, :, None] ** 2
    uneven = replace(_kriged(0.0), error_ellipses=circles * _ONE_LENGTH)
    around = surroundings(readings_of(batch, continued(uneven, 5000.0)), shifts, weight)
    assert 0.5 < around.alike[0, -1] < 0.99
    model, level = Correlation(2000.0), around.shapes["even"][[0, -1]].prod()
    expected = around.alike[0, -1] * np.exp(-around.distance[0, -1] / 2000.0) * level
    assert around.map_covariance(model, "even")[0, -1] == pytest.approx(
        expected, rel=1e-6, abs=0.0
    )
    np.testing.assert_array_equal(around.part(7).alike, around.alike[:7, :7])
    plain = readings_of(batch, continued(DISTURBANCE, 5000.0))
    assert surroundings(plain, shifts, weight).distance is plain.distance


def test_the_maps_usual_length_is_the_middle_of_the_models():
    batch, _ = make_batch(DISTURBANCE, np.zeros(4), velocity=(0.0, 60.0))
    matcher = IntegratedMatcher.from_settings(Matcher(batch_length=len(batch)))
    for field_map, lengths in ((_kriged(0.3), {1e3, 2e3, 4e3}), (DISTURBANCE, UNKNOWN_LENGTHS)):
        _, memory = matcher.match(batch, field_map, None)
        found = {one.length for one in memory.posterior.models.correlations if not one.smooth}
        assert found == set(lengths)


def _match(run, **told):
    random = generator(11, run, "track")
    error = random.normal(0.0, 500.0, 2)
    start = tuple(random.uniform(-15e3, 5e3, 2))
    track, latitude, longitude = made_track(
        DISTURBANCE, count=60, error=error, sigma=1e-5, seed=run, start=start
    )
    # a map error that nobody tells, correlated over 2 km
    distance = np.arange(60) * float(np.hypot(*track.velocity[0])) * 10.0
    covariance = (3e-5) ** 2 * np.exp(-np.abs(distance[:, None] - distance) / 2000.0)
    wrong = np.linalg.cholesky(covariance) @ random.standard_normal(60)
    track = replace(track, value=track.value + wrong)
    match = match_track(
        track, DISTURBANCE, Matcher(batch_length=60, **told), Uncertainty(position=500.0)
    )[0]
    fix = match.fix
    if not fix.published:
        return match, np.nan
    apart = horizontal_difference(fix.latitude, fix.longitude, latitude[-1], longitude[-1])
    return match, float(nees_per_axis(apart, fix.covariance))


def test_nothing_told_of_a_wrong_map_the_error_bars_are_honest():
    """10 tracks over a map that is 3 mGal wrong: the mean NEES is below the upper end of its
    99.9 % interval, and not absurdly small; sigma and length come out within a factor of two."""
    found = [_match(run) for run in range(10)]
    nees = np.array([value for _, value in found])
    nees = nees[np.isfinite(nees)]
    assert nees.size >= 8
    assert 0.2 < nees.mean() < chi_square_interval(nees.size, confidence=0.999)[1]
    sigma = [match.fix.diagnostics["map_sigma"] for match, _ in found]
    assert 1.5e-5 < np.median(sigma) < 6e-5


def test_a_spike_is_left_out():
    track, latitude, longitude = made_track(DISTURBANCE, error=(300.0, 200.0), sigma=1e-6)
    value = track.value.copy()
    value[33] += 1e-2
    match = match_track(
        replace(track, value=value), DISTURBANCE, Matcher(batch_length=60), Uncertainty(800.0)
    )[0]
    assert match.fix.published
    assert match.fix.diagnostics["readings_left_out"] >= 1.0
    end = match.rows.stop - 1
    apart = horizontal_difference(
        match.fix.latitude, match.fix.longitude, latitude[end], longitude[end]
    )
    assert np.hypot(*apart) < 100.0


def test_the_jackknife_never_narrows_and_moments_are_those_of_the_cells():
    match, _ = _match(3)
    posterior = match.shifts
    excess = jackknife_excess(posterior)
    assert np.linalg.eigvalsh(excess).min() >= -1e-9
    mean, covariance = moments_of(posterior.shifts, posterior.weight)
    found_mean, found = posterior.moments
    np.testing.assert_allclose(found_mean, mean)
    assert (np.linalg.eigvalsh(found - covariance) > 0.0).all()


def _there_and_back(scans, width):
    """A batch whose track goes to and fro, north and south, and slowly east."""
    batch, _ = make_batch(DISTURBANCE, np.zeros(4), scans=scans, velocity=(0.0, 0.1))
    step = np.arange(scans)
    north = 0.1 * width * np.where(step % 20 < 10, step % 20, 20 - step % 20)
    return replace(batch, latitude=batch.latitude[0] + north / metres_per_radian(ORIGIN[0])[0])


def test_errors_of_averaged_readings_have_a_covariance():
    """Some correlation functions of averaged distances are no covariances: those of smooth errors
    had eigenvalues down to -0.03 here, with a nugget."""
    shifts, weight = np.zeros((1, 2)), np.ones(1)
    for scans, width, per_row, length in (
        (60, 300.0, 1, 500.0),
        (400, 500.0, 4, 500.0),
        (1500, 1e3, 7, 2e3),
    ):
        readings = readings_of(_there_and_back(scans, width), continued(DISTURBANCE, 5000.0))
        assert (readings.average > 0.0).sum(axis=1).max() == per_row
        around = surroundings(readings, shifts, weight)
        model = Correlation(length, smooth=True)
        covariance = around.map_covariance(model, "even")
        assert covariance.shape == (len(readings),) * 2
        assert np.linalg.eigvalsh(covariance)[0] > 0.0
        if per_row == 4:  # and four points to a row: every reading is one
            each = model.matrix(readings.distance, np.ones(scans))
            np.testing.assert_allclose(
                covariance, readings.average @ each @ readings.average.T, rtol=1e-12, atol=0.0
            )
        left = np.arange(len(readings)) % 5 != 2
        some = surroundings(readings.without(~left), shifts, weight)
        expected = covariance[np.ix_(left, left)]
        np.testing.assert_allclose(some.map_covariance(model, "even"), expected)
        first = around.part(7).map_covariance(model, "even")
        np.testing.assert_allclose(first, covariance[:7, :7])


def test_what_is_no_covariance_is_not_taken_for_one():
    distance = np.array([[0.0, 1.0, 9e4], [1.0, 0.0, 1.0], [9e4, 1.0, 0.0]])  # of no places
    around = Surroundings(distance, 1e-2 * np.eye(3), {"even": np.ones(3), "gradient": np.ones(3)})
    models = noise_models(Told(), own_sigma=False, spread=10.0)
    with pytest.raises(np.linalg.LinAlgError, match="no covariance"):
        log_likelihoods(np.zeros((3, 1)), models, around)
