"""The baseline matchers: what all have in common, and the parts of each by hand."""

import dataclasses
import itertools

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching.baselines.iccp import Iccp, _Contours, _iterate
from isogal.matching.baselines.readings import (
    UsableReadings,
    publish_measured,
    publish_posterior,
    shift_covariance,
)
from isogal.matching.baselines.sitan import plane
from isogal.matching.baselines.tercom import Tercom
from isogal.matching.baselines.viterbi import Viterbi, _emissions, _trellis
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


def update(prior, z, R, H):
    K = prior @ H.T @ np.linalg.inv(H @ prior @ H.T + R)
    return K @ z, prior - K @ H @ prior


def measured_error(batch, fix):
    """The navigator's error (2,) according to the fix."""
    metres = metres_per_radian(batch.latitude[-1])
    return np.array(
        [
            (batch.latitude[-1] - fix.latitude) * metres[0],
            (batch.longitude[-1] - fix.longitude) * metres[1],
        ]
    )


def test_publishing_a_posterior(rough_map):
    batch, _ = make_batch(rough_map, prior_sigma=(200.0, 0.05))
    mean = np.array([30.0, -40.0, 0.01, 0.0])
    covariance = np.diag([50.0**2, 60.0**2, 0.04**2, 0.05**2])
    fix = publish_posterior(batch, mean, covariance, {"figure": 1.0})
    new_mean, new_covariance = update(
        batch.prior, measured_error(batch, fix), fix.covariance, np.eye(2, 4)
    )
    np.testing.assert_allclose(new_mean[:2], mean[:2], rtol=1e-6)
    np.testing.assert_allclose(new_covariance[:2, :2], covariance[:2, :2], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(
        np.linalg.inv(np.linalg.inv(batch.prior) + fix.information.matrix),
        covariance,
        rtol=1e-6,
        atol=1e-9,
    )
    np.testing.assert_allclose(
        np.linalg.inv(fix.scan_covariance).sum(axis=0), np.linalg.inv(fix.covariance), rtol=1e-9
    )
    nothing = publish_posterior(batch, np.zeros(4), batch.prior, {})
    assert nothing.reason == "the readings tell nothing that the navigator does not know"


def test_publishing_a_measurement_counts_each_reading_once(rough_map):
    batch, _ = make_batch(rough_map, new=10)
    fix = publish_measured(batch, np.array([30.0, -40.0]), np.diag([100.0, 400.0]), {})
    np.testing.assert_allclose(measured_error(batch, fix), [30.0, -40.0], rtol=1e-9)
    np.testing.assert_allclose(fix.covariance, np.diag([300.0, 1200.0]))
    assert np.isnan(fix.scan_covariance[:20]).all()
    np.testing.assert_allclose(
        np.linalg.inv(fix.scan_covariance[20:]).sum(axis=0), np.linalg.inv(fix.covariance)
    )


def test_curvature_covariance_by_hand():
    # ten readings of slope 2 north, ten of slope 4 east, sigma 1: information 40 and 160; a
    # velocity error that looks like half a unit of the north slope shifts the fix by half a metre
    # per unit
    slope = np.zeros((20, 4))
    slope[:10, 0], slope[10:, 1], slope[:10, 2] = 2.0, 4.0, 1.0
    covariance = shift_covariance(slope, np.ones(20), np.diag([0.36, 0.0]), 1e3)
    np.testing.assert_allclose(covariance, np.diag([1 / 40 + 0.25 * 0.36, 1 / 160]), atol=1e-12)
    blind = shift_covariance(slope * [1, 0, 1, 1], np.ones(20), np.zeros((2, 2)), 1e3)
    np.testing.assert_allclose(blind, np.diag([1 / 40, 1e6]), rtol=1e-9)


def test_readings_in_and_out(rough_map):
    reading = np.array(make_batch(rough_map)[0].reading)
    reading[3] = np.nan
    batch, _ = make_batch(rough_map, reading=reading, new=20)
    whole = UsableReadings.of(batch, rough_map, 2e-5)
    new = UsableReadings.of(batch, rough_map, whole=False)
    assert list(whole.row) == [0, 1, 2, *range(4, 30)]
    assert list(new.row) == list(range(10, 30))
    np.testing.assert_allclose(whole.sigma, np.hypot(1e-5, 2e-5))
    known = field_map_of(lambda n, e: 1e-8 * n + 0.0 * e, sigma=4e-5, quantisation=1e-6)
    np.testing.assert_allclose(
        UsableReadings.of(batch, known, 2e-5).sigma,
        np.sqrt(1e-10 + 16e-10 + 1e-12 / 12.0),
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


def test_closest_points_lead_to_the_move():
    # for each point of the track two contour lines, one along north, one along east
    tangent = np.where(np.arange(20)[:, None] % 2 == 0, [1.0, 0.0], [0.0, 1.0])
    point = np.tile([30.0, -40.0], (20, 1))
    contours = _Contours(point, tangent, np.ones(20), np.arange(21))
    shift, nearest = _iterate(contours, np.zeros(2))
    np.testing.assert_allclose(shift, [30.0, -40.0], atol=0.2)
    assert np.array_equal(nearest, np.arange(20))


@pytest.mark.parametrize("region", [0.0, 1.5])
@pytest.mark.parametrize("bias_sigma", [0.0, 3e-5])
def test_exact_on_a_plane_map(region, bias_sigma):
    tilted = field_map_of(lambda n, e: 3e-8 * n - 2e-8 * e)
    batch, _ = make_batch(
        tilted, (200.0, -100.0, 0.05, 0.0), sigma=1e-5, jacobian=(-8e-9, 0.0, 6e-6, 1.2e-4)
    )
    matcher = build("sitan", bias_sigma=bias_sigma, options={"region": region})
    fix, _ = matcher.match(batch, tilted, None)
    # least squares on all readings at once; a plane in metres is a plane in degrees up to the
    # map's curvature, a metre here
    readings = UsableReadings.of(batch, tilted)
    residual, slope = readings.linearise(tilted, np.zeros(4))
    R = np.diag(readings.sigma**2) + bias_sigma**2
    matrix = slope.T @ np.linalg.solve(R, slope)
    np.testing.assert_allclose(fix.information.matrix, matrix, rtol=2e-3, atol=1e-4 * matrix.max())
    posterior = np.linalg.inv(np.linalg.inv(batch.prior) + matrix)
    mean = -posterior @ slope.T @ np.linalg.solve(R, residual)
    told = np.linalg.solve(
        np.linalg.inv(batch.prior) + fix.information.matrix, fix.information.vector
    )
    units = np.array([1.0, 1.0, 1e-3, 1e-3])
    np.testing.assert_allclose(told / units, mean / units, atol=1.0)


def test_plane_through_a_bowl_by_hand():
    # n² over n = -200, -100, ..., 200: mean (4 + 1 + 0 + 1 + 4) / 5 = 2, mean square (16 + 1 + 0 +
    # 1 + 16) / 5 = 6.8, of 100² m²; a slope of 3 east
    side = 100.0 * np.arange(-2.0, 3.0)
    value, slope, left = plane(side[:, None] ** 2 + 3.0 * side, np.array([200.0, 200.0]))
    np.testing.assert_allclose([value, *slope, left], [2e4, 0.0, 3.0, (6.8 - 4.0) * 1e8])


def test_trellis_equals_trying_all_paths():
    rng = np.random.default_rng(4)
    cells, scans, sigma, drift = 3, 4, 0.4, (0.3, 0.2)
    nodes = 0.05 * rng.standard_normal((12, 12)).cumsum(0).cumsum(1)
    grid = Grid(nodes, 12, 0.0, 1e-3, 0.0, 1e-3)
    side = np.array([-120.0, 0.0, 120.0])
    radian = np.full((scans, 2), 1e-5)
    latitude, longitude = 5e-3 + 3e-4 * np.arange(scans), np.full(scans, 6e-3)
    level = rng.standard_normal(scans)
    jacobian = 1e-3 * rng.standard_normal((scans, 4))
    start = -0.5 * (side[:, None] ** 2 + side[None, :] ** 2) / 100.0**2
    noise = np.full(scans, sigma)
    transition = np.zeros((scans, 2, 4))
    columns = grid, latitude, longitude, radian, level, noise, transition, jacobian
    readings = UsableReadings(*columns, np.arange(scans))
    place = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1)
    path, marginal = _trellis(_emissions(readings, place, 120.0, noise**2), start, drift)

    places = list(itertools.product(range(cells), range(cells)))
    emission = np.zeros((scans, cells, cells))
    for t, (i, j) in itertools.product(range(scans), places):
        value, by_lat, by_lon = value_and_gradient(
            grid, latitude[t] - side[i] * radian[t, 0], longitude[t] - side[j] * radian[t, 1]
        )
        slope = np.array([by_lat * radian[t, 0], by_lon * radian[t, 1]]) - jacobian[t, :2]
        variance = sigma**2 + 120.0**2 / 12.0 * slope @ slope
        residual = level[t] - value - jacobian[t, :2] @ [side[i], side[j]]
        emission[t, i, j] = np.exp(-0.5 * residual**2 / variance) / np.sqrt(variance)
    step = [[0.5 * d, 1.0 - d, 0.5 * d] for d in drift]
    best, best_path, total = 0.0, None, np.zeros((cells, cells))
    for candidate in itertools.product(places, repeat=scans):
        p = np.exp(start[candidate[0]]) * np.prod(
            [emission[(t, *place)] for t, place in enumerate(candidate)]
        )
        for (a, b), (c, d) in itertools.pairwise(candidate):
            p *= (
                0.0 if max(abs(a - c), abs(b - d)) > 1 else step[0][c - a + 1] * step[1][d - b + 1]
            )
        total[candidate[-1]] += p
        if p > best:
            best, best_path = p, candidate
    assert [tuple(place) for place in path] == list(best_path)
    np.testing.assert_allclose(marginal, total / total.sum(), rtol=1e-9)


def test_a_path_at_the_edge_is_no_fix(rough_map):
    batch, _ = make_batch(rough_map, (900.0, 900.0, 0.0, 0.0), prior_sigma=(100.0, 0.02))
    fix, _ = Viterbi().match(batch, rough_map, None)
    assert fix.reason == "the most probable path ends at the edge of the search grid"
