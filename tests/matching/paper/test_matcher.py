"""The paper's matcher: its iteration against an independent implementation, its fixes on a made-up
and on a real field, batches that it declines."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import multivariate_normal

from helpers.batches import field_map_of, make_batch
from isogal.matching.paper.iteration import PaperOptions, ScanCandidates, maximise
from isogal.matching.paper.kalman import constant_velocity
from isogal.matching.paper.matcher import PmhtPaper
from isogal.matching.registry import load_matcher
from isogal.scenario import Matcher

ERROR = (250.0, -300.0, 0.03, 0.02)


SCANS, WANTED, Q, ITERATIONS = 6, 4, 1e-3, 4
TIME = 10.0 * np.arange(SCANS)
FIRST = np.diag([300.0**2, 200.0**2, 0.3**2, 0.3**2])


def made_up_batch():
    """States of the navigator and candidates of scans, one of which has none."""
    rng = np.random.default_rng(5)
    navigator = np.concatenate(
        [200.0 * np.arange(SCANS)[:, None] * np.ones(2), np.full((SCANS, 2), 20.0)], axis=1
    )
    position = navigator[:, None, :2] + rng.normal(scale=300.0, size=(SCANS, WANTED, 2))
    variance = rng.uniform(80.0, 200.0, (SCANS, WANTED)) ** 2
    variance[2], variance[3, 3:] = np.inf, np.inf
    return navigator, ScanCandidates(position, variance)


def associated(candidates, t, centre, R_bar):
    """Eqs. s3-01, s3-02, s3-021 and s32-1 of a scan: z-bar and R-bar."""
    n = candidates.there[t].sum()
    used = candidates.variance[t] if R_bar is None else np.full(WANTED, R_bar[t])
    p = np.array(
        [
            multivariate_normal.pdf(candidates.position[t, i], centre[t], used[i] * np.eye(2))
            for i in range(n)
        ]
    )
    w = p / p.sum()
    return w @ candidates.position[t, :n], w @ candidates.variance[t, :n]


def smoothed(start, z_bar, R_bar):
    """Eqs. forward and backward: smoothed states, last covariance, predicted states."""
    F, Q_ = constant_velocity(np.diff(TIME), Q)
    kalman = KalmanFilter(dim_x=4, dim_z=2)
    kalman.x, kalman.P, kalman.H = start[:, None].copy(), FIRST.copy(), np.eye(2, 4)
    y, P, predictions = [kalman.x.copy()], [kalman.P.copy()], [kalman.x.copy()]
    for t in range(1, SCANS):
        kalman.predict(F=F[t - 1], Q=Q_[t - 1])
        predictions.append(kalman.x.copy())
        if z_bar[t] is not None:
            kalman.update(z_bar[t][:, None], R=R_bar[t] * np.eye(2))
        y.append(kalman.x.copy())
        P.append(kalman.P.copy())
    X = np.array(y)[..., 0]
    for t in range(SCANS - 2, -1, -1):
        predicted_P = F[t] @ P[t] @ F[t].T + Q_[t]
        X[t] += P[t] @ F[t].T @ np.linalg.inv(predicted_P) @ (X[t + 1] - F[t] @ X[t])
    return X, P[-1], np.array(predictions)[..., 0]


@pytest.mark.parametrize("predicted", [True, False])
def test_iteration_equals_section_3_2_written_out(predicted):
    navigator, candidates = made_up_batch()
    X, centre, R_bar = navigator.copy(), navigator[:, :2].copy(), None
    for _ in range(ITERATIONS):
        z_bar, new_R = [None] * SCANS, np.zeros(SCANS)
        for t in np.flatnonzero(candidates.there.any(axis=1)):
            z_bar[t], new_R[t] = associated(candidates, t, centre, R_bar)
        R_bar = new_R
        X, last_P, predictions = smoothed(X[0], z_bar, R_bar)
        centre = (predictions if predicted else X)[:, :2].copy()

    options = PaperOptions(
        acceleration_density=Q, iterations=ITERATIONS,
        association="predicted" if predicted else "smoothed",
    )  # fmt: skip
    estimate = maximise(navigator, FIRST, np.diff(TIME), candidates, options)
    assert estimate.iterations == ITERATIONS
    np.testing.assert_allclose(estimate.state, X, rtol=1e-8)
    np.testing.assert_allclose(estimate.covariance[-1], last_P, rtol=1e-8)
    np.testing.assert_allclose(
        estimate.weight.sum(axis=1), candidates.there.any(axis=1).astype(float)
    )


def test_declines_off_the_map_and_where_it_ends(rough_map):
    far, _ = make_batch(rough_map, start=(0.0, 35e3), reading=np.zeros(30))
    fix, _ = PmhtPaper().match(far, rough_map, None)
    assert fix.published  # half of the scans are on the map
    further, _ = make_batch(rough_map, start=(0.0, 38.5e3), reading=np.zeros(30))
    fix, _ = PmhtPaper().match(further, rough_map, None)
    assert "readings have the map around them" in fix.reason
    outside, _ = make_batch(rough_map, start=(0.0, 60e3), reading=np.zeros(30))
    fix, _ = PmhtPaper().match(outside, rough_map, None)
    assert fix.reason == "the track is outside the map"


def test_stops_aiding_where_the_map_is_flat():
    flat_here = field_map_of(
        lambda n, e: 1e-4 * np.where(n > 20e3, np.sin(n / 1e3), 0.0) + 0.0 * e
    )
    batch, _ = make_batch(flat_here)
    fix, _ = PmhtPaper().match(batch, flat_here, None)
    assert fix.reason.startswith("map feature variability 0 of")
    assert fix.diagnostics["feature_variability"] == 0.0


def test_the_less_feature_the_more_covariance(rough_map):
    batch, _ = make_batch(rough_map, ERROR)
    plain, _ = PmhtPaper(PaperOptions(covariance_factor=1.0, variability_exponent=0.0)).match(
        batch, rough_map, None
    )
    weighted, _ = PmhtPaper().match(batch, rough_map, None)
    variability = weighted.diagnostics["feature_variability"]
    shown = weighted.candidates
    np.testing.assert_allclose(np.bincount(shown.scan, shown.weight, minlength=len(batch)), 1.0)
    np.testing.assert_allclose(
        weighted.covariance, 30.0 / variability * plain.covariance, rtol=1e-12
    )
    # half of the readings were used before: each counts once over two batches
    overlapping, _ = make_batch(rough_map, ERROR, new=15)
    twice, _ = PmhtPaper().match(overlapping, rough_map, None)
    np.testing.assert_allclose(twice.covariance, 2.0 * weighted.covariance, rtol=1e-12)


@pytest.mark.parametrize("weak", [False, True])
def test_stops_aiding_where_the_candidates_are_on_no_track(rough_map, weak):
    """Where it is asked to; of a velocity that is hardly known fixes are sixty sigmas wrong."""
    sigma, worst, asked = (500.0, 50.0 if weak else 0.05), 0.0, PaperOptions(largest_residual=30)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        error = rng.normal(0.0, np.repeat(sigma, 2))
        batch, truth = make_batch(rough_map, tuple(error), prior_sigma=sigma, seed=seed)
        fix, _ = PmhtPaper(asked).match(batch, rough_map, None)
        as_published, _ = PmhtPaper().match(batch, rough_map, None)
        away = truth.error_of(as_published)
        worst = max(worst, np.sqrt(away @ np.linalg.solve(as_published.covariance, away)))
        assert fix.published != weak
        if weak:
            assert fix.reason.startswith("the candidates are on no track: mean square residual")
        else:
            assert (fix.latitude, fix.longitude) == (as_published.latitude, as_published.longitude)
    assert (worst > 30.0) == weak


def test_retrodiction_holds_the_information_once(rough_map):
    batch, _ = make_batch(rough_map, ERROR)
    matcher = load_matcher(Matcher(name="pmht-paper", mode="retrodiction"))
    fix, _ = matcher.match(batch, rough_map, None)
    assert fix.scan_position.shape == (30, 2)
    np.testing.assert_allclose(fix.scan_position[-1], [fix.latitude, fix.longitude])
    np.testing.assert_allclose(
        np.linalg.inv(fix.scan_covariance).sum(axis=0), np.linalg.inv(fix.covariance), rtol=1e-9
    )


def test_stops_early_when_told_to(rough_map):
    batch, _ = make_batch(rough_map, ERROR)
    fix, _ = PmhtPaper(PaperOptions(epsilon=1e4)).match(batch, rough_map, None)
    assert fix.diagnostics["iterations"] == 1.0
