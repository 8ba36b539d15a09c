"""The bank of hypotheses beside a navigator, in a linear world where all is known."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.navigators import random_covariance
from isogal.matching.interfaces import Information
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.error_hypotheses import ErrorHypotheses, with_delay

SIGMA = np.array([50.0, 50.0, 0.05, 0.05, 2e-5, 2e-5, 3e-4])
VELOCITY = np.array([12.0, 18.0])
STEP = 50.0
FORWARD = np.eye(7)
FORWARD[:2, 2:4] = STEP * np.eye(2)
FORWARD[2:4, 4:6] = [[0.0, 9.8 * STEP], [-9.8 * STEP, 0.0]]
GROWTH = np.diag([1.0, 1.0, 1e-3, 1e-3, 1e-7, 1e-7, 1e-7]) ** 2
FIX = np.array([15.0, 60.0])
"""1-sigma of a fix in its two axes, m."""


@dataclass
class Step:
    """A fix, before a navigator takes it that assumes factors of 1 and no delay."""

    error: np.ndarray
    """Of the navigator's estimate."""
    prior: np.ndarray
    mean: np.ndarray
    """By which it corrects itself."""
    posterior: np.ndarray
    bank: ErrorHypotheses
    """With the fix, and the error relative to the estimate before it."""


def flown(count, seed, navigator=1.0, noise=1.0, delay=0.0, growth=1.0):
    """Steps of a navigator in a world with these factors of variances (growth: beside that of the
    navigator) and a delay (s)."""
    rng = np.random.default_rng(seed)
    prior, bank = np.diag(SIGMA**2), ErrorHypotheses.before(np.diag(SIGMA**2))
    error = np.sqrt(navigator) * SIGMA * rng.standard_normal(7)
    for _ in range(count):
        turn = rng.uniform(0.0, np.pi)
        axes = np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
        H = np.concatenate([axes / FIX[:, None], np.zeros((2, 5))], axis=1)
        shown = error[:2] + delay * VELOCITY
        z = H[:, :2] @ shown + np.sqrt(noise) * rng.standard_normal(2)
        told = Information(H.T @ z, H.T @ H)
        posterior = np.linalg.inv(np.linalg.inv(prior) + told.matrix)
        mean = posterior @ told.vector
        bank = bank.informed(told, prior, VELOCITY)
        yield Step(error, prior, mean, posterior, bank)
        bank = bank.moved(mean).grown(FORWARD, GROWTH, np.zeros((7, 7)))
        error = FORWARD @ (error - mean)
        error += np.sqrt(navigator * growth * np.diag(GROWTH)) * rng.standard_normal(7)
        prior = FORWARD @ posterior @ FORWARD.T + GROWTH


def test_as_assumed_is_the_navigator_itself():
    for step in flown(30, 4):
        np.testing.assert_allclose(step.bank.mean[0, :7], step.mean, atol=1e-6 * SIGMA.max())
        np.testing.assert_allclose(
            step.bank.covariance[0, :7, :7], step.posterior, rtol=1e-6, atol=1e-15
        )
        assert step.bank.mean[0, 7] == step.bank.covariance[0, 7, 7] == 0.0


@pytest.mark.parametrize("seed", range(5))
def test_evidence_is_the_density_of_the_fix(seed):
    rng = np.random.default_rng(seed)
    prior = random_covariance(SIGMA, seed)
    H, z = rng.standard_normal((3, 7)) / SIGMA, 3.0 * rng.standard_normal(3)
    before = ErrorHypotheses.before(prior)
    after = before.informed(Information(H.T @ z, H.T @ H), prior, VELOCITY)
    whole = H @ with_delay(VELOCITY)
    density = [
        multivariate_normal.logpdf(z, np.zeros(3), whole @ P @ whole.T + r * np.eye(3))
        for P, r in zip(before.covariance, before.noise, strict=True)
    ]
    gained = after.log_weight - before.log_weight
    kept = after.log_weight > -CONSTANTS.untold_reach_log
    assert kept[0] and kept.sum() > 5
    expected = np.array(density) - density[0]
    np.testing.assert_allclose((gained - gained[0])[kept], expected[kept], rtol=1e-6, atol=1e-6)


def test_assumptions_that_are_right_are_rarely_in_doubt():
    """Of 24 navigators, each with 100 fixes. The odds of all others together are 0.2 at first, and
    a false Bayes factor of 11 has a probability of 1/11 at most (Ville's inequality)."""
    least, _ = CONSTANTS.assumptions_probability
    doubted = [
        min(step.bank.probability[0] for step in flown(100, seed)) < least for seed in range(24)
    ]
    assert sum(doubted) <= 4


@pytest.mark.parametrize(
    ("world", "what"),
    [
        ({"navigator": 30.0}, "navigator"),
        ({"noise": 10.0}, "noise"),
        ({"delay": 20.0}, "delay"),
    ],
)
def test_what_is_wrong_is_found(world, what):
    for seed in range(8):
        *_, last = flown(150, seed, **world)
        bank = last.bank
        weight = bank.probability
        assert weight[0] < 0.01
        if what == "delay":
            mean, covariance = bank.believed()
            assert abs(mean[7] - 20.0) < 4.0 * np.sqrt(covariance[7, 7])
            assert weight[bank.covariance[:, 7, 7] > 0.0].sum() > 0.9
        else:
            factor = np.exp(weight @ np.log(getattr(bank, what)))
            assert world[what] / 3.0 < factor < world[what] * 3.0


def test_inertial_sensors_that_are_worse_than_told_are_found_soon():
    """A start that is as told is evidence against all hypotheses about the whole navigator: by
    them alone 7 of these 20 are in doubt within 45 fixes, with those about its growth 13."""
    least, _ = CONSTANTS.assumptions_probability
    found = 0
    for seed in range(20):
        steps = flown(45, seed, growth=100.0)
        found += any(step.bank.probability[0] < least for step in steps)
    assert found > 10


def test_what_the_bank_believes_is_honest():
    """NEES per axis of 60 navigators that are 5.5 times worse than assumed: a mean chi-square of
    120 is within 0.75 and 1.27 in 95 % of cases; the factor is not known exactly, either."""
    alone, together = [], []
    for seed in range(60):
        *_, step = flown(20, seed, navigator=30.0)
        mean, covariance = step.bank.believed()
        for found, its in ((step.mean, step.posterior), (mean, covariance)):
            apart = (step.error - found[:7])[:2]
            square = apart @ np.linalg.solve(its[:2, :2], apart)
            (together if its is covariance else alone).append(0.5 * square)
    assert 0.7 < np.mean(together) < 1.6
    assert np.mean(alone) > 3.0


def test_a_hypothesis_that_was_wrong_for_long_can_come_back():
    *_, last = flown(200, 1)
    bank = last.bank
    assert bank.log_weight.min() >= -CONSTANTS.untold_reach_log
    assert bank.log_weight.max() == 0.0


def bank_of(seed):
    """A bank as it is amid a run, and random numbers."""
    random = np.random.default_rng(seed)
    bank = ErrorHypotheses.before(random_covariance(SIGMA, seed))
    covariance = np.stack(
        [random_covariance(np.append(SIGMA, 3.0), seed + k) for k in range(len(bank.noise))]
    )
    mean = np.append(SIGMA, 3.0) * random.standard_normal(covariance.shape[:2])
    return replace(bank, mean=mean, covariance=covariance), random


def test_a_bank_grows_as_in_numpy():
    bank, random = bank_of(3)
    forward = FORWARD + 1e-3 * random.standard_normal((7, 7)) * SIGMA[:, None] / SIGMA
    growth, more = random_covariance(SIGMA, 40), random_covariance(2.0 * SIGMA, 41)
    after = bank.grown(forward, growth, more)
    whole = np.eye(8)
    whole[:7, :7] = forward
    unit = np.outer(np.append(SIGMA, 3.0), np.append(SIGMA, 3.0))
    for k in range(len(bank.noise)):
        expected = whole @ bank.covariance[k] @ whole.T
        expected[:7, :7] += bank.navigator[k] * growth + more
        np.testing.assert_allclose(after.covariance[k] / unit, expected / unit, atol=1e-9)
        np.testing.assert_allclose(after.mean[k], whole @ bank.mean[k], rtol=1e-9)


def test_a_bank_takes_information_as_kalman_filters_do():
    bank, random = bank_of(4)
    prior = random_covariance(SIGMA, 50)
    half = random.standard_normal((3, 7)) / SIGMA  # of rank 3, so that it is H'H
    told = Information(half.T @ random.standard_normal(3), half.T @ half)
    after = bank.informed(told, prior, VELOCITY)
    H = half @ with_delay(VELOCITY)
    z = np.linalg.lstsq(half.T, told.vector, rcond=None)[0]
    log_weight = np.empty(len(bank.noise))
    unit = np.outer(np.append(SIGMA, 3.0), np.append(SIGMA, 3.0))
    for k in range(len(bank.noise)):
        P = bank.covariance[k]
        S = H @ P @ H.T + bank.noise[k] * np.eye(3)
        gain = P @ H.T @ np.linalg.inv(S)
        innovation = z - H @ bank.mean[k]
        np.testing.assert_allclose(after.mean[k], bank.mean[k] + gain @ innovation, rtol=1e-6)
        np.testing.assert_allclose(
            after.covariance[k] / unit, (P - gain @ H @ P) / unit, atol=1e-7
        )
        density = multivariate_normal.logpdf(innovation, np.zeros(3), S)
        log_weight[k] = bank.log_weight[k] + density
    reach = np.maximum(log_weight - log_weight.max(), -CONSTANTS.untold_reach_log)
    np.testing.assert_allclose(after.log_weight, reach, atol=1e-6)
