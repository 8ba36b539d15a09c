"""Recorded tracks by the bank's models: densities, what is told, the map beyond its edge, error
bars."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import ORIGIN, make_batch
from helpers.tracks import field_of, made_track
from isogal.earth.ellipsoid import metres_per_radian
from isogal.earth.frames import horizontal_difference
from isogal.evaluation.consistency import chi_square_interval, nees_per_axis
from isogal.maps.displacement import SIZE
from isogal.maps.error_ellipses import ellipses_of
from isogal.matching.interfaces import SecondaryBatch
from isogal.matching.pmht.cells import residuals_at
from isogal.matching.pmht.states import States
from isogal.scenario import Matcher
from isogal.seeds import generator
from isogal.tracks.averaging import few, neighbours
from isogal.tracks.continued_map import continued
from isogal.tracks.evidence import Seen, correlations, held_together, with_heavy_tails
from isogal.tracks.matching import Uncertainty, match_track
from isogal.tracks.models import (
    EVEN,
    LENGTHS,
    PATTERNS,
    SHAPES,
    pattern_of,
    track_models,
)
from isogal.tracks.widening import displacement, excess

DISTURBANCE = field_of("disturbance")
EASTWARD, _ = make_batch(DISTURBANCE, velocity=(0.0, 60.0))
SETTINGS = Matcher(batch_length=40)


def seen_of(batch, field_map=DISTURBANCE, **said):
    """The readings of a batch, with the models of what is told."""
    return Seen.of(SecondaryBatch(0, batch, field_map), Matcher(**said), "")


def test_innovations_with_heavy_tails_have_a_density():
    w = np.linspace(-60.0, 60.0, 40_001)
    density = np.exp(with_heavy_tails(-0.5 * w**2)) / np.sqrt(2.0 * np.pi)
    step = w[1] - w[0]
    assert density.sum() * step == pytest.approx(1.0, abs=1e-6)
    # one in ten is five times as wide
    assert (density * w**2).sum() * step == pytest.approx(0.9 + 0.1 * 25.0, rel=1e-5)


def test_evidence_of_blocks_is_that_of_a_multivariate_normal_distribution(monkeypatch):
    monkeypatch.setattr("isogal.tracks.evidence.with_heavy_tails", lambda log_normal: log_normal)
    batch, _ = make_batch(DISTURBANCE, velocity=(0.0, 60.0), scans=20)
    centres = np.array([[0.0, 0.0], [400.0, -300.0], [-900.0, 100.0]])
    seen = seen_of(batch).placed(centres, np.ones(3))
    which = np.arange(0, len(seen.models.sigma), 17)
    parts = seen.at(centres, 50.0, which).parts
    assert parts.shape == (len(which), 8, 3)
    residual, constant = seen.residuals(centres), 10.0 * np.log(2.0 * np.pi)
    for found, m in zip(parts.sum(axis=1), which.tolist(), strict=True):
        normal = multivariate_normal(np.zeros(20), seen.covariance(m, 50.0))
        np.testing.assert_allclose(found - constant, normal.logpdf(residual.T), rtol=1e-8)
    assert np.isclose(np.exp(seen.models.log_prior).sum(), 1.0)


def test_at_each_place_the_error_that_the_map_says_there_is_the_likeliest_before_any_reading():
    rows, columns = DISTURBANCE.values.shape
    north = np.broadcast_to(np.linspace(1e-5, 9e-5, rows)[:, None], (rows, columns))
    field_map = replace(DISTURBANCE, sigma=north)
    batch, _ = make_batch(field_map, velocity=(0.0, 60.0), scans=20)
    centres = np.array([[0.0, 0.0], [6000.0, 0.0], [-3000.0, 0.0]])
    seen = seen_of(batch, field_map).placed(centres[:1], np.ones(1))
    radian = metres_per_radian(ORIGIN[0])[0]
    there = [field_map.sigma_at(ORIGIN[0] - shift / radian, ORIGIN[1]) for shift in centres[:, 0]]
    expected = np.array(there) / there[0]
    np.testing.assert_allclose(seen.relative(centres), expected, rtol=1e-2)
    every = np.arange(len(seen.models.sigma))
    seen = seen.at(centres, 50.0, every)
    # of each sigma, shape and length: a log-normal density of the sigma's, whose middle moves
    prior = seen.by_model - seen.parts.sum(axis=1)
    np.testing.assert_allclose(prior[:, 0], seen.models.log_prior, atol=1e-2)
    np.testing.assert_allclose(np.exp(prior).sum(axis=0), 1.0, rtol=1e-6)
    mean = np.exp(prior).T @ np.log(seen.models.sigma)
    assert mean[1] < mean[0] < mean[2]
    exact = seen_of(batch, field_map, options={"trust": 1.0}).placed(centres[:1], np.ones(1))
    assert not exact.at(centres, 50.0, np.arange(1)).stated.any()


def models(field_map=DISTURBANCE, **said):
    batch, _ = make_batch(field_map)
    return track_models(Matcher(**said), batch, field_map, States.of(batch, field_map))


def test_what_is_told_narrows_the_models():
    assert set(models().lengths) == set(LENGTHS)
    assert models(map_sigma=0.0, bias_sigma=0.0).sigma.tolist() == [0.0]
    keys = {"map_sigma": 3e-5, "map_correlation_length": 2e3, "bias_sigma": 0.0}
    told = models(**keys)
    best = int(np.argmax(told.log_prior))
    assert (told.sigma[best], told.length[best]) == (3e-5, 2e3)
    assert (pattern_of(told) == EVEN).all()
    assert len(models(**keys, options={"trust": 1.0}).sigma) == 1


def _shifts(field_map, count=40):
    track, _, _ = made_track(field_map, count, (300.0, -200.0), 1e-6)
    settings = Matcher(batch_length=count)
    return match_track(track, field_map, settings, Uncertainty(500.0))[0].shifts


def _gridded(sigma, ellipse=(4e6, 0.0, 4e6), length=2e3):
    """A map that says a 1-sigma, as of gridded readings, and over what area it holds together."""
    shape = DISTURBANCE.values.shape
    return replace(
        DISTURBANCE,
        sigma=np.full(shape, sigma),
        correlation_length=length,
        error_ellipses=np.broadcast_to(ellipse, (*shape, 3)),
    )


def test_a_gridded_map_that_knows_nothing_gives_no_fix():
    """Though its readings fit at one place alone, as is seen where it says a smaller error."""
    track, _, _ = made_track(DISTURBANCE, 40, (300.0, -200.0), 1e-6)
    shown = float(np.std(track.value))
    for share, given in ((0.25, True), (10.0, False)):
        fix = match_track(track, _gridded(share * shown), SETTINGS, Uncertainty(1000.0))[0].fix
        assert fix.published == given
        assert given or "its own 1-sigma" in fix.reason


def test_what_a_gridded_map_does_not_resolve_is_left_to_the_readings():
    field_map = _gridded(2e-5)
    whole = replace(field_map, sigma=np.hypot(field_map.sigma, 5e-5), unresolved=5e-5)
    expected, found = (seen_of(EASTWARD, one) for one in (field_map, whole))
    np.testing.assert_allclose(found.models.sigma, expected.models.sigma, rtol=1e-9)
    np.testing.assert_allclose(found.own_variance, expected.own_variance, rtol=1e-9)


def test_a_gridded_map_may_be_displaced():
    """An error of 2 mGal over 2 km, of a field of 10 mGal RMS; each is found within a factor."""
    gridded = _gridded(2e-5)
    assert not displacement(_shifts(DISTURBANCE)).any()
    short, long = _shifts(gridded), _shifts(gridded, 80)
    (north, skew), (_, east) = displacement(short)
    assert north == pytest.approx(east) and abs(skew) < 1e-6 * north
    assert SIZE * 1e3 * 0.02 < np.sqrt(north) < SIZE * 4e3 * 0.4
    # of one model, however long the track is
    for shifts in (short, long):
        (whole,) = shifts.seen
        seen = replace(whole, which=whole.which[:1], parts=whole.parts[:1])
        one = replace(shifts, seen=(seen,))
        error = seen.map_sigma[0] ** 2
        share = error / (error + seen.shown(one.likeliest))
        expected = (SIZE * seen.length[0]) ** 2 * share * np.eye(2)
        np.testing.assert_allclose(displacement(one), expected, rtol=1e-6, atol=1e-3)


def test_a_displacement_is_of_the_size_of_the_errors_along_the_track():
    """Errors hold together over 2.45 km where the track is, over 1.2 km on most of the map."""
    there = seen_of(EASTWARD, _gridded(2e-5, (9e6, 0.0, 4e6), 1.2e3))
    there = there.placed(np.zeros((1, 2)), np.ones(1))
    np.testing.assert_allclose(there.length / there.models.length, np.sqrt(6.0) / 1.2, rtol=1e-9)
    nowhere = seen_of(EASTWARD, DISTURBANCE).placed(np.zeros((1, 2)), np.ones(1))
    np.testing.assert_array_equal(nowhere.length, nowhere.models.length)


def test_errors_do_not_hold_together_across_a_line_of_the_survey():
    """A track along the lines has one gap, one across them as many as it crosses."""
    one, other = np.full(10, 4.0), np.full(10, 2.0)
    assert held_together(one) == pytest.approx(4.0)
    crossing = held_together(np.concatenate([one, [0.0], other]))
    assert crossing**2 == pytest.approx((10.0**2 * 16.0 + 10.0**2 * 4.0) / 21.0**2)


def test_the_usual_length_of_a_gridded_map_is_not_that_of_exponentials():
    """`isogal match` passes it on as if it were an option."""
    gridded = _gridded(1e-5, (4e6, 0.0, 1e6), 1.5e3)
    passed_on = models(gridded, map_correlation_length=1.5e3)
    assert passed_on.shape.tolist() == models(gridded).shape.tolist()
    assert passed_on.shape.max() // len(passed_on.lengths) >= SHAPES - PATTERNS
    own = models(gridded, map_correlation_length=1e3)
    assert own.shape.max() // len(own.lengths) < PATTERNS


def test_all_kinds_of_correlation_have_the_length_as_their_integral():
    way = np.linspace(0.0, 60e3, 3001)
    for length in (2000.0, 4000.0):
        kinds = correlations(np.abs(way[:, None] - way), np.array([length]))
        assert len(kinds) == SHAPES // PATTERNS
        for kind in kinds:
            assert np.trapezoid(kind[0], way) == pytest.approx(length, rel=0.02)
            assert np.linalg.eigvalsh(kind[::30, ::30])[0] > 0.0


def test_a_continued_map_is_the_map_where_there_is_one_and_doubtful_elsewhere():
    values = DISTURBANCE.values.copy()
    values[10:14, 20:30] = np.nan
    holed = replace(DISTURBANCE, values=values)
    longer = continued(holed, 5000.0)
    track, _, _ = made_track(DISTURBANCE)
    on_map = holed.value(track.latitude, track.longitude)
    inside = longer.field.value(track.latitude, track.longitude)
    np.testing.assert_allclose(inside, np.where(np.isnan(on_map), inside, on_map), rtol=1e-9)
    assert np.isfinite(longer.field.values).all()
    doubt = longer.doubt
    assert doubt.max() <= np.nanstd(values) * (1.0 + 1e-12)
    assert doubt[0, 0] > 0.0
    rim = (longer.field.values.shape[0] - values.shape[0]) // 2
    np.testing.assert_array_equal(doubt[rim:-rim, rim:-rim] > 0.0, np.isnan(values))
    # what the map says of its error goes along
    kriged = replace(holed, sigma=0.1 + 0 * values)
    np.testing.assert_array_equal(continued(kriged, 5000.0).field.sigma, 0.1)


def test_rows_are_apart_by_the_lengths_of_the_maps_error_in_their_direction():
    """An error that holds together over 6 km in one direction and 1 km across it, the usual length
    being 2 km."""
    shifts, weight = np.array([[0.0, 0.0], [300.0, -200.0]]), np.array([0.7, 0.3])
    for azimuth, length in ((0.5 * np.pi, 6e3), (0.0, 1e3)):
        ellipse = ellipses_of(np.array(6e3), np.array(1e3), np.array(azimuth))
        seen = seen_of(EASTWARD, _gridded(2e-5, ellipse)).placed(shifts, weight)
        distance = np.hypot(*np.moveaxis(seen.apart, -1, 0)) * 2e3 / length
        expected = correlations(distance, seen.models.lengths)
        np.testing.assert_allclose(seen.correlation, expected, rtol=2e-2)
        assert set(seen.models.lengths) == {1e3, 2e3, 4e3}
    plain = seen_of(EASTWARD)
    assert plain.placed(shifts, weight).correlation is plain.correlation


def test_sigmas_of_rows_are_those_of_the_map_where_they_probably_are():
    columns = np.linspace(1e-5, 3e-5, DISTURBANCE.values.shape[1])
    field_map = replace(DISTURBANCE, sigma=columns * np.ones_like(DISTURBANCE.values))
    seen = seen_of(EASTWARD, field_map).placed(np.array([[0.0, 5000.0]]), np.ones(1))
    east = metres_per_radian(EASTWARD.latitude)[1]
    own = field_map.sigma_at(EASTWARD.latitude, EASTWARD.longitude - 5000.0 / east)
    np.testing.assert_allclose(seen.load(0) * columns.mean(), own, rtol=1e-6)


@cache
def _match(run):
    random = generator(11, run, "track")
    error = random.normal(0.0, 500.0, 2)
    start = tuple(random.uniform(-15e3, 5e3, 2))
    track, latitude, longitude = made_track(DISTURBANCE, 40, error, 1e-5, run, start)
    # a map error that nobody tells, correlated over 2 km
    distance = np.arange(40) * float(np.hypot(*track.velocity[0])) * 10.0
    covariance = (3e-5) ** 2 * np.exp(-np.abs(distance[:, None] - distance) / 2000.0)
    wrong = np.linalg.cholesky(covariance) @ random.standard_normal(40)
    track = replace(track, value=track.value + wrong)
    match = match_track(track, DISTURBANCE, SETTINGS, Uncertainty(position=500.0))[0]
    fix = match.fix
    if not fix.published:
        return match, np.nan
    apart = horizontal_difference(fix.latitude, fix.longitude, latitude[-1], longitude[-1])
    return match, float(nees_per_axis(apart, fix.covariance))


def test_nothing_told_of_a_wrong_map_the_error_bars_are_honest():
    """7 tracks over a map that is 3 mGal wrong: the mean NEES is below the upper end of its
    99.9 % interval, and not absurdly small; sigma and length come out within a factor of two."""
    found = [_match(run) for run in range(7)]
    nees = np.array([value for _, value in found])
    nees = nees[np.isfinite(nees)]
    assert nees.size >= 5
    assert 0.2 < nees.mean() < chi_square_interval(nees.size, confidence=0.999)[1]
    sigma = [match.fix.diagnostics["map_sigma"] for match, _ in found]
    assert 1.5e-5 < np.median(sigma) < 6e-5


def test_a_spike_is_left_out():
    track, latitude, longitude = made_track(DISTURBANCE, 40, (300.0, 200.0), 1e-6)
    track.value[33] += 1e-2
    fix = match_track(track, DISTURBANCE, SETTINGS, Uncertainty(500.0))[0].fix
    assert fix.published
    assert fix.diagnostics["readings_left_out"] >= 1.0
    apart = horizontal_difference(fix.latitude, fix.longitude, latitude[-1], longitude[-1])
    assert np.hypot(*apart) < 100.0


def test_the_jackknife_never_narrows_and_moments_are_those_of_the_cells(monkeypatch):
    match, _ = _match(3)
    shifts = match.shifts
    assert np.linalg.eigvalsh(excess(shifts)).min() >= -1e-9
    # which counts on maps that do not say their error
    monkeypatch.setattr("isogal.tracks.widening._fixes", lambda *_: 1e5 * np.eye(2))
    assert excess(shifts).any() and not excess(_shifts(_gridded(2e-5))).any()
    mean, covariance = shifts.moments
    np.testing.assert_allclose(shifts.weight @ shifts.centres, mean)
    apart = shifts.centres - mean
    inner = np.einsum("c,ci,cj->ij", shifts.weight, apart, apart)
    assert (np.linalg.eigvalsh(covariance - inner) > 0.0).all()
    assert np.isclose(shifts.places.sum(), 1.0, atol=0.05)


def test_the_covariance_of_means_is_that_of_their_readings_averaged():
    batch, _ = make_batch(DISTURBANCE, scans=400, velocity=(0.0, 5.0))
    seen = seen_of(batch)
    own = seen.rows.of[seen.points] == np.arange(len(seen.rows.count))[:, None]
    mean = own / own.sum(axis=1)[:, None]
    distance = np.hypot(*np.moveaxis(seen.apart, -1, 0))
    every = correlations(distance, seen.models.lengths)
    for found, each in zip(seen.correlation, every, strict=True):
        np.testing.assert_allclose(found, mean @ each @ mean.T, rtol=1e-9)


def test_few_readings_are_rows_of_their_own_whatever_channels_are_missing():
    batch, _ = make_batch(DISTURBANCE, velocity=(0.0, 60.0), scans=12)
    rows = seen_of(batch).readings
    rows = rows._replace(channel=np.array([0, 0, 1, 0, 1, 2, 0, 0, 0, 1, 2, 2]))
    found = neighbours(rows, 300.0, 0)
    np.testing.assert_array_equal([found.first, few(found)], [np.arange(12)] * 2)


def test_rows_are_means_of_neighbouring_readings():
    count = 1500
    batch, _ = make_batch(DISTURBANCE, scans=count, velocity=(0.0, 0.1))
    north = 500.0 - 50.0 * np.abs(np.arange(count) % 20 - 10)  # to and fro
    batch = replace(batch, latitude=ORIGIN[0] + north / metres_per_radian(ORIGIN[0])[0])
    seen = seen_of(batch)
    sizes, first = seen.rows.count, seen.rows.first
    assert len(sizes) <= 220
    np.testing.assert_allclose(seen.white * sizes**2, np.add.reduceat(seen.readings.noise, first))
    centre = np.array([[100.0, -50.0]])
    each = residuals_at(seen.readings, seen.field_map.grid, centre)
    expected = np.add.reduceat(each, first) / sizes[:, None]
    np.testing.assert_allclose(seen.residuals(centre), expected)
    seen = seen.placed(centre, np.ones(1))
    for m in range(0, len(seen.models.sigma), 29):
        assert np.linalg.eigvalsh(seen.covariance(m, 10.0))[0] > 0.0


def test_a_drifting_track_and_a_rigid_one_agree_where_there_is_no_drift():
    """By the bank's hypotheses, and on the grid of shifts."""
    track, _, _ = made_track(DISTURBANCE, count=40, error=(300.0, -200.0), sigma=1e-5)
    settings = Matcher(batch_length=40, map_sigma=1e-5)
    (rigid,) = match_track(track, DISTURBANCE, settings, Uncertainty(500.0))
    (drifting,) = match_track(track, DISTURBANCE, settings, Uncertainty(500.0, velocity=0.1))
    apart = drifting.error[:2] - rigid.error[:2]
    assert apart @ np.linalg.solve(rigid.covariance[:2, :2], apart) < 2.0
    ratio = np.linalg.det(drifting.covariance[:2, :2]) / np.linalg.det(rigid.covariance[:2, :2])
    assert 0.5 < np.sqrt(ratio) < 4.0


@pytest.mark.parametrize("scans", [40, 300])
def test_readings_of_earlier_batches_count_as_given(scans, monkeypatch):
    """p(new | old) = p(all) / p(old), of rows that are readings, and of means of them; of Gaussian
    errors, as tails are those of blocks, which begin elsewhere without the earlier readings."""
    monkeypatch.setattr("isogal.tracks.evidence.with_heavy_tails", lambda log_normal: log_normal)
    batch, _ = make_batch(DISTURBANCE, velocity=(0.0, 20.0), scans=scans)
    centres = np.array([[0.0, 0.0], [400.0, -300.0]])
    old = scans // 4
    given = seen_of(replace(batch, new=scans - old)).placed(centres, np.ones(2))
    rows = given.old_rows
    assert given.rows.first[rows] == old
    which = np.arange(0, len(given.models.sigma), 31)
    every = replace(given, old=0).at(centres, 50.0, which).parts.sum(axis=1)
    for k, m in enumerate(which):
        factor = np.linalg.cholesky(given.covariance(int(m), 50.0)[:rows, :rows])
        white = np.linalg.solve(factor, given.residuals(centres)[:rows])
        before = -0.5 * (white**2).sum(axis=0) - np.log(np.diag(factor)).sum()
        found = given.at(centres, 50.0, which).parts[k].sum(axis=0)
        np.testing.assert_allclose(found, every[k] - before, rtol=1e-7)
    assert len(given.white) > rows
