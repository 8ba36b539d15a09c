"""Bias and drift from batch to batch: what conditioning on all readings at once says, and what
must not be believed."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import INTERVAL, field_map_of, make_batch, wavy
from helpers.navigators import random_covariance
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.matcher import Pmht
from isogal.matching.pmht.noise_model import NoiseModel
from isogal.matching.pmht.sensor_bias import BiasEstimate
from isogal.scenario import Matcher

SCANS, BATCHES, SIGMA = 20, 4, 1e-5
SLOPE = np.array([4e-8, -3e-8])
PLANE = field_map_of(
    lambda north, east: SLOPE[0] * north + SLOPE[1] * east, half=60e3, step=2000.0
)
VELOCITY = np.array([14.0, 17.0])
BIAS_SIGMA, DRIFT_SIGMA = 5e-5, 2e-8
ELAPSED = SCANS * INTERVAL
FORWARD = np.eye(4) + ELAPSED * np.eye(4, k=2)


def batch_of(number, error, prior, reading, field_map=PLANE):
    """The batch of that number of a navigator with that error at its end; `reading` is added to
    what the map says."""
    time = 1000.0 + ELAPSED * number + INTERVAL * np.arange(SCANS)
    batch, _ = make_batch(
        field_map,
        error,
        SCANS,
        sigma=SIGMA,
        start=np.array([-3000.0, -3000.0]) + VELOCITY * ELAPSED * number,
        velocity=VELOCITY,
        seed=None,
        time=time,
    )
    return replace(
        batch,
        prior=prior,
        reading=batch.reading + reading(time),
        back_transition=np.linalg.inv(FORWARD) if number else None,
        back_nuisance=np.zeros((4, 0)) if number else None,
    )


def posterior(batch):
    """Of xi on a plane, in closed form, and the likelihood."""
    likelihood = BatchLikelihood.of(batch, PLANE, NoiseModel())
    residual, slope = likelihood.linearise(np.zeros(4))
    drift = likelihood.nuisance_at(np.zeros(4))
    weighted = np.linalg.solve(
        likelihood.covariance + drift @ drift.T, np.column_stack([residual, slope])
    )
    covariance = np.linalg.inv(np.linalg.inv(batch.prior) + slope.T @ weighted[:, 1:])
    return -covariance @ slope.T @ weighted[:, 0], covariance, likelihood


def noise_of(random, number, walk, wandered):
    """White noise and walk of the bias in a batch, and the walk by its end."""
    noise = SIGMA * random.standard_normal(SCANS)
    if walk:
        steps = walk * np.sqrt(INTERVAL) * random.standard_normal(SCANS)
        steps[0] *= number > 0
        noise += wandered + np.cumsum(steps)
        wandered += steps.sum()
    return noise, wandered


def of_all(designs, residuals, times, start, walk):
    """Mean (n,) and covariance of error, bias, drift and delay at the end of the last batch, by
    all readings at once; `start` is their covariance (n, n) before."""
    H, r = np.concatenate(designs), np.concatenate(residuals)
    elapsed = np.concatenate(times)
    end = np.eye(len(start))
    end[:4, :4] = np.linalg.matrix_power(FORWARD, BATCHES - 1)
    end[4, 5] = elapsed[-1]
    wandering = walk**2 * np.minimum(elapsed[:, None], elapsed)
    R = H @ start @ H.T + wandering + SIGMA**2 * np.eye(len(r))
    cross = end @ start @ H.T
    cross[4] += walk**2 * elapsed  # with what the bias has wandered by the end
    spread = end @ start @ end.T - cross @ np.linalg.solve(R, cross.T)
    spread[4, 4] += walk**2 * elapsed[-1]
    return cross @ np.linalg.solve(R, r), spread


@pytest.mark.parametrize(
    ("walk", "delay_sigma"), [(0.0, 0.0), (1e-6, 0.0), (0.0, 4.0), (1e-6, 4.0)]
)
@pytest.mark.parametrize("seed", range(4))
def test_a_chain_of_batches_is_conditioning_on_all_readings(seed, walk, delay_sigma):
    # a delay counts by the navigator's velocity, which is wrong by 0.1 m/s of 22
    close = 2e-3 if delay_sigma == 0.0 else 5e-2
    random = np.random.default_rng(seed)
    start_sigma = np.array([400.0, 300.0, 0.1, 0.1])
    count = 2 if delay_sigma == 0.0 else 3
    sigma = np.array([BIAS_SIGMA, DRIFT_SIGMA, delay_sigma])
    theta = random.standard_normal(3) * sigma  # at t = 1000 s
    late = -SLOPE @ VELOCITY  # change of a reading per s of delay
    error = random.standard_normal(4) * start_sigma  # at the end of the first batch
    prior = np.diag(start_sigma**2)
    estimate = BiasEstimate.unknown(1000.0, *sigma)
    corrections = np.zeros(4)  # of the navigator so far, as an error at the end of the batch
    residuals, designs, times, wandered = [], [], [], 0.0
    for number in range(BATCHES):
        noise, wandered = noise_of(random, number, walk, wandered)
        noise += late * theta[2]
        raw = batch_of(
            number, error, prior, lambda t, e=noise: theta[0] + theta[1] * (t - 1000.0) + e
        )
        raw = replace(raw, bias_walk=walk)
        bias = estimate.at_end(raw)
        batch = bias.added_to(raw)
        # the same readings for a navigator that is never corrected, by its error at the end of the
        # first batch and by theta
        residual, slope = BatchLikelihood.of(raw, PLANE, NoiseModel()).linearise(np.zeros(4))
        residuals.append(residual - slope @ corrections)
        times.append(raw.time - 1000.0)
        carried = np.linalg.matrix_power(FORWARD, number)
        of_theta = np.column_stack([np.ones(SCANS), raw.time - 1000.0, np.full(SCANS, late)])
        designs.append(np.column_stack([-slope @ carried, of_theta[:, :count]]))

        mean, covariance, likelihood = posterior(batch)
        estimate = bias.measured(batch, likelihood, mean, covariance)
        corrections = FORWARD @ (corrections + mean)
        error, prior = FORWARD @ (error - mean), FORWARD @ covariance @ FORWARD.T

    start = np.diag([*start_sigma**2, *sigma[:count] ** 2])
    expected, spread = of_all(designs, residuals, times, start, walk)
    scale = np.sqrt(np.diag(spread))
    np.testing.assert_allclose(
        (np.linalg.inv(FORWARD) @ corrections - expected[:4]) / scale[:4], 0.0, atol=close
    )
    np.testing.assert_allclose((estimate.mean - expected[4:]) / scale[4:], 0.0, atol=close)
    joint = np.block(
        [
            [covariance, covariance @ estimate.gain.T],
            [estimate.gain @ covariance, np.zeros((count, count))],
        ]
    )
    joint[4:, 4:] = estimate.covariance + estimate.gain @ covariance @ estimate.gain.T
    np.testing.assert_allclose(
        joint / scale / scale[:, None], spread / scale / scale[:, None], atol=close
    )
    assert estimate.figures()["bias_sigma"] == pytest.approx(scale[4], rel=close)
    assert estimate.figures()["drift"] == estimate.mean[1]
    assert ("reading_delay" in estimate.figures()) == (count == 3)


def chained():
    """The estimate after one batch, and the next batch of a navigator that has taken the fix."""
    prior = np.diag([400.0**2, 300.0**2, 0.01, 0.01])
    raw = batch_of(0, np.zeros(4), prior, lambda t: 3e-5 + 0.0 * t)
    bias = BiasEstimate.unknown(1000.0, BIAS_SIGMA, DRIFT_SIGMA).at_end(raw)
    batch = bias.added_to(raw)
    mean, covariance, likelihood = posterior(batch)
    estimate = bias.measured(batch, likelihood, mean, covariance)
    return estimate, batch_of(1, np.zeros(4), FORWARD @ covariance @ FORWARD.T, lambda t: 0.0 * t)


def test_a_navigator_that_has_not_taken_the_fix_has_an_error_that_says_nothing_about_the_bias():
    estimate, following = chained()
    taken = estimate.at_end(following)
    assert np.abs(taken.by_error).max() > 0.0
    refused = estimate.at_end(replace(following, prior=4.0 * following.prior))
    assert not refused.by_error.any()
    spread = estimate.covariance + estimate.gain @ estimate.error @ estimate.gain.T
    step = np.array([[1.0, ELAPSED], [0.0, 1.0]])
    np.testing.assert_allclose(refused.own @ refused.own.T, step @ spread @ step.T, rtol=1e-9)
    np.testing.assert_allclose(refused.mean, step @ estimate.mean, rtol=1e-12)


def test_a_missing_batch_breaks_the_chain():
    estimate, following = chained()
    later = replace(following, time=following.time + 200.0)
    assert not estimate.at_end(replace(later, new=SCANS - 1)).by_error.any()


def test_without_a_fix_it_is_carried_as_it_was():
    estimate, following = chained()
    bias = estimate.at_end(following)
    carried = bias.unmeasured(following)
    before = bias.by_error @ following.prior @ bias.by_error.T + bias.own @ bias.own.T
    after = carried.gain @ following.prior @ carried.gain.T + carried.covariance
    np.testing.assert_allclose(after, before, rtol=1e-9)
    np.testing.assert_allclose(carried.mean, bias.mean)


def test_attitude_of_the_navigator_is_part_of_what_a_bias_goes_together_with():
    random = np.random.default_rng(1)
    estimate, following = chained()
    drift = random.standard_normal((SCANS, 3)) * 1e-6
    by_xi, root = random.standard_normal((3, 4)) * 1e-8, random.standard_normal((3, 3)) * 1e-5
    batch = replace(
        following,
        nuisance_position=np.zeros((SCANS, 2, 3)),
        nuisance_reading=drift,
        back_nuisance=np.zeros((4, 3)),
        attitude=(by_xi, root),
    )
    bias = replace(estimate.at_end(batch), by_nuisance=random.standard_normal((2, 3)) * 1e-6)
    state = bias.unmeasured(batch)
    assert state.gain.shape == (2, 7)
    # the state's error is (xi, attitude = by_xi xi + root d): the same dependence on xi and d
    np.testing.assert_allclose(
        state.gain[:, :4] + state.gain[:, 4:] @ by_xi, bias.by_error, atol=1e-15
    )
    np.testing.assert_allclose(state.gain[:, 4:] @ root, bias.by_nuisance, rtol=1e-6)
    np.testing.assert_allclose(state.covariance, bias.own @ bias.own.T, rtol=1e-6, atol=1e-22)


# ------------------------------------------------------------
# in the matcher

ROUGH = field_map_of(wavy)


def run(settings, bias, batches=6, seed=0):
    """Errors of a navigator that takes every fix, and the last fix and memory."""
    matcher = Pmht.from_settings(Matcher(batch_length=SCANS, **settings))
    random = np.random.default_rng(seed)
    prior = np.diag([100.0**2, 100.0**2, 0.05**2, 0.05**2])
    error = np.linalg.cholesky(prior) @ random.standard_normal(4)
    memory, errors = None, []
    for number in range(batches):
        noise = SIGMA * random.standard_normal(SCANS)
        batch = batch_of(number, error, prior, lambda t, e=noise: bias + e, ROUGH)
        fix, memory = matcher.match(batch, ROUGH, memory)
        if fix.published:
            covariance = np.linalg.inv(np.linalg.inv(prior) + fix.information.matrix)
            error, prior = error - covariance @ fix.information.vector, covariance
        errors.append(
            (
                fix,
                np.hypot(*error[:2]),
                error[:2] @ np.linalg.solve(prior[:2, :2], error[:2]) / 2.0,
            )
        )
        error, prior = FORWARD @ error, FORWARD @ prior @ FORWARD.T
    return errors, memory


@pytest.mark.parametrize(
    "settings",
    [{"bias_sigma": BIAS_SIGMA}, {"map_sigma": "auto"}, {}],
    ids=["told", "auto", "untold"],
)
@pytest.mark.parametrize("bias", [1e-4, -6e-5])
def test_a_bias_is_found(settings, bias):
    """Ten and six sigmas of the sensor: told of, unknown to somebody who says so, and unknown to
    somebody who says there is none."""
    errors, memory = run(settings, bias)
    figures = errors[-1][0].diagnostics
    # who says that there is none learns better from the second batch that does not agree
    assert all(fix.published for fix, _, _ in errors[0 if settings else 2 :])
    assert abs(figures["bias"] - bias) < 3.5 * figures["bias_sigma"] < 2e-5
    assert errors[-1][1] < 60.0
    assert np.mean([nees for _, _, nees in errors]) < 3.0
    assert memory.bias is not None


def test_no_bias_is_found_where_there_is_none():
    errors, memory = run({}, 0.0)
    assert memory.bias is None
    assert "bias" not in errors[-1][0].diagnostics


def test_a_lost_navigator_is_not_taken_for_a_bias():
    matcher = Pmht.from_settings(Matcher(batch_length=SCANS))
    prior = np.diag([50.0**2, 50.0**2, 0.05**2, 0.05**2])
    memory, lost = None, False
    for number in range(3):
        batch = batch_of(
            number, np.array([6000.0, -4000.0, 0.0, 0.0]), prior, lambda t: 0.0 * t, ROUGH
        )
        fix, memory = matcher.match(batch, ROUGH, memory)
        lost |= fix.reset
    assert lost


def test_a_bias_is_given_up_where_readings_show_none_and_kept_where_they_do():
    told = (1e-4, 1e-8)
    nothing = BiasEstimate(0.0, np.zeros(2), np.diag([1e-12, 1e-20]), np.zeros((2, 4)))
    assert nothing.simplified(told) is None
    clear = replace(nothing, mean=np.array([1e-5, 5e-10]))  # ten and five 1-sigmas
    assert clear.simplified(told) is clear
    # drift is 1e-10 with 1-sigma 1e-10: of it nothing is left, and what it told of the bias
    both = np.array([[1e-12, 0.9e-16], [0.9e-16, 1e-20]])
    steady = replace(nothing, mean=np.array([1e-5, 1e-10]), covariance=both).simplified(told)
    assert steady.mean[1] == 0.0
    assert steady.mean[0] == pytest.approx(1e-5 - 0.9e-6)
    np.testing.assert_allclose(steady.covariance, np.diag([1e-12 - 0.81e-12, 0.0]), atol=1e-26)


def test_what_is_left_without_drift_is_the_conditional_gaussian():
    """Against the joint Gaussian of bias, drift and the navigator's error, given drift = 0."""
    random = np.random.default_rng(3)
    error = random_covariance(np.array([30.0, 20.0, 0.03, 0.02]), 3)
    gain = random.standard_normal((2, 4)) * np.array([[1e-7], [1e-11]])
    own = np.array([[1e-12, 2e-17], [2e-17, 1e-20]])
    estimate = BiasEstimate(0.0, np.array([1e-4, 1e-11]), own, gain, error)
    simple = estimate.simplified((1e-4, 1e-8))
    joint = np.block([[own + gain @ error @ gain.T, gain @ error], [error @ gain.T, error]])
    rest = [0, 2, 3, 4, 5]
    along = joint[rest, 1] / joint[1, 1]
    given = joint[np.ix_(rest, rest)] - np.outer(along, joint[1, rest])
    assert simple.mean[0] == pytest.approx(1e-4 - along[0] * 1e-11)
    variance = simple.covariance[0, 0] + simple.gain[0] @ error @ simple.gain[0]
    assert variance == pytest.approx(given[0, 0])
    np.testing.assert_allclose(simple.gain[0] @ error, given[0, 1:], rtol=1e-6)
