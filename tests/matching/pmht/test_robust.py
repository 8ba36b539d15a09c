"""The monitor of recorded tracks: fixes confirmed with twice the noise, and widened where the
residuals show that the noise model is wrong."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from helpers.tracks import field_of, made_track
from isogal.earth.ellipsoid import metres_per_radian
from isogal.evaluation.consistency import chi_square_interval
from isogal.matching.interfaces import Fix, Information, declined
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.robust import TrackMonitor, excess_covariance, with_excess
from isogal.scenario import Matcher
from isogal.seeds import generator
from isogal.tracks.batches import build_batch
from isogal.tracks.matching import Uncertainty, match_track

DISTURBANCE = field_of("disturbance")
PRIOR = np.diag([3e3**2, 3e3**2, 1e-12, 1e-12])


def regression(run: int, noise_of, count: int = 300):
    """Least squares of two parameters from whitened readings; returns error, H⁻¹ and the
    excess."""
    random = generator(11, run, "sandwich")
    slope = np.zeros((count, 4))
    slope[:, :2] = (
        random.normal(0.0, 1e-2, (count, 2)) * np.exp(random.normal(0.0, 0.4, count))[:, None]
    )
    reading = noise_of(slope) * random.normal(size=count)
    curvature = slope[:, :2].T @ slope[:, :2]
    error = np.linalg.solve(curvature, slope[:, :2].T @ reading)
    residual = reading - slope[:, :2] @ error
    return error, np.linalg.inv(curvature), excess_covariance(residual, slope, PRIOR)[:2, :2]


def test_residuals_that_fit_the_noise_model_widen_nothing_but_by_chance():
    excess = [regression(run, lambda slope: 1.0)[2] for run in range(300)]
    share = np.mean([one.any() for one in excess])
    assert share < 0.12  # two tests at two 1-sigmas each


def test_where_errors_grow_with_the_gradient_the_widened_covariance_is_the_honest_one():
    """Errors three times the model's where the map is steep: NEES per axis 1 is right."""

    def steep(slope):
        size = np.hypot(slope[:, 0], slope[:, 1])
        return 3.0 * size / np.sqrt(np.mean(size**2))

    plain, widened = [], []
    for run in range(300):
        error, covariance, excess = regression(run, steep)
        plain.append(error @ np.linalg.solve(covariance, error) / 2.0)
        widened.append(error @ np.linalg.solve(covariance + excess, error) / 2.0)
    low, high = chi_square_interval(300, confidence=0.999)
    assert np.mean(plain) > 5.0 * high
    assert (
        low - 0.1 < np.mean(widened) < high + 0.2
    )  # the residuals are a little smaller than the errors that they are taken for


def test_correlation_that_the_model_leaves_out_is_seen():
    random = generator(12, 0, "correlated")
    slope = np.zeros((400, 4))
    slope[:, :2] = 1e-2 * np.sin(np.arange(400)[:, None] / np.array([30.0, 41.0]))
    walk = np.convolve(random.normal(size=404), np.ones(5) / np.sqrt(5.0), mode="valid")
    assert np.trace(excess_covariance(walk, slope, PRIOR)) > np.trace(
        np.linalg.inv(slope[:, :2].T @ slope[:, :2])
    )


def test_a_direction_that_the_readings_do_not_tell_is_left_alone():
    slope = np.zeros((100, 4))
    slope[:, 0] = 1e-2
    excess = excess_covariance(5.0 * generator(13, 0, "one").normal(size=100), slope, PRIOR)
    assert excess[0, 0] > 0.0
    assert excess[1, 1] == pytest.approx(0.0, abs=1e-9)
    assert not excess_covariance(np.ones(100), np.zeros((100, 4)), PRIOR).any()


def test_a_widened_fix_keeps_its_place_in_both_its_forms():
    matrix = np.diag([1e-4, 4e-4, 0.0, 0.0])
    place = np.array([100.0, -50.0])
    vector = np.concatenate([matrix[:2, :2] @ place, [0.0, 0.0]])
    fix = Fix(0.0, 0.5, 1.0, np.diag([1e4, 2500.0]), information=Information(vector, matrix))
    excess = np.zeros((4, 4))
    excess[:2, :2] = [[500.0, 300.0], [300.0, 900.0]]
    wide = with_excess(fix, excess, 30)
    np.testing.assert_allclose(np.linalg.inv(wide.information.matrix[:2, :2]), wide.covariance)
    np.testing.assert_allclose(
        np.linalg.solve(wide.information.matrix[:2, :2], wide.information.vector[:2]), place
    )
    assert (wide.latitude, wide.longitude) == (fix.latitude, fix.longitude)


@pytest.mark.parametrize("negative", [1e-9, 1e-6, 2e-4])
def test_widening_makes_no_information_out_of_what_was_none(negative):
    """A direction in which the posterior was wider than the prior stays without information,
    however much is added to it."""
    matrix = np.diag([-negative, 4e-4, 0.0, 0.0])
    vector = np.array([1e-3, 4e-4 * -50.0, 0.0, 0.0])
    fix = Fix(0.0, 0.5, 1.0, np.diag([1e8, 2500.0]), information=Information(vector, matrix))
    excess = np.diag([5000.0, 900.0, 0.0, 0.0])
    wide = with_excess(fix, excess, 30).information.matrix
    np.testing.assert_allclose(wide, np.diag([0.0, 1.0 / (2500.0 + 900.0), 0.0, 0.0]), atol=1e-12)


@dataclass(frozen=True)
class Scripted(Pmht):
    """Answers with a given fix instead of matching; None = ambiguous."""

    answer: Fix | None = None

    def match(self, batch, field_map, memory):
        left = replace(memory, hypotheses=Mixture.gaussian(np.zeros(4), batch.prior))
        return self.answer or declined(batch, "ambiguous: 2 places fit"), left


def monitored(answer: Fix | None = None) -> TrackMonitor:
    return TrackMonitor(Scripted(Pmht.from_settings(Matcher()).settings, answer=answer))


def batch_and_fix(position: float):
    track, _, _ = made_track(DISTURBANCE, count=30, error=(350.0, -250.0))
    prior = Uncertainty(position=position).prior
    batch = build_batch(track, np.zeros((30, 4)), slice(0, 30), 30, np.zeros(4), prior)
    fix, after = Pmht.from_settings(Matcher()).match(batch, DISTURBANCE, None)
    assert fix.published
    return batch, fix, after


def test_a_fix_not_confirmed_with_twice_the_noise_is_declined_and_its_hypotheses_go_on():
    batch, fix, after = batch_and_fix(1500.0)
    none, memory = monitored().confirmed(fix, batch, DISTURBANCE, None, after)
    assert none.reason == "not found with twice the noise: ambiguous: 2 places fit"
    assert memory.hypotheses is not None
    same, memory = monitored(fix).confirmed(fix, batch, DISTURBANCE, None, after)
    assert same is fix
    assert memory is after
    north = metres_per_radian(fix.latitude)[0]
    away = replace(fix, latitude=fix.latitude + 10.0 * np.sqrt(fix.covariance[0, 0]) / north)
    none, _ = monitored(away).confirmed(fix, batch, DISTURBANCE, None, after)
    assert none.reason == "not found with twice the noise: that finds it elsewhere"


def test_a_fix_from_a_narrow_prior_needs_no_confirmation():
    batch, fix, after = batch_and_fix(0.9 * CONSTANTS.wide_prior_m)
    assert monitored().confirmed(fix, batch, DISTURBANCE, None, after) == (fix, after)


class Vague:
    """A matcher that publishes next to nothing."""

    name, context = "vague", 0

    def __init__(self, sigma):
        self.covariance = np.diag(np.square(sigma))

    def match(self, batch, field_map, memory):
        return Fix(
            float(batch.time[-1]),
            float(batch.latitude[-1]),
            float(batch.longitude[-1]),
            self.covariance,
        ), None


def test_a_fix_less_certain_than_the_prior_is_none():
    track, _, _ = made_track(DISTURBANCE, count=30)
    prior = Uncertainty(position=1000.0)
    empty = match_track(track, DISTURBANCE, Matcher(), prior, matcher=Vague((6e3, 1e5)))[0].fix
    assert empty.reason == "wider than the prior: 1-sigma of 100 km where 1 km were known"
    (one_way,) = match_track(track, DISTURBANCE, Matcher(), prior, matcher=Vague((300.0, 1e5)))
    assert one_way.fix.reason == empty.reason
    # but it tells something
    assert np.sqrt(one_way.covariance[0, 0]) == pytest.approx(300.0, rel=0.05)
    good = match_track(track, DISTURBANCE, Matcher(), prior, matcher=Vague((300.0, 999.0)))[0].fix
    assert good.published
