"""What a batch says, against closed forms on a plane and exact posteriors on a grid."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.bank import (
    LETTER,
    PLANE,
    by_grid,
    close,
    flown,
    kalman,
    noise_of,
    pmht,
    posterior_of,
    with_map_error,
)
from helpers.batches import field_map_of, make_batch, wavy
from isogal.evaluation.consistency import nees_per_axis
from isogal.maps.error_ellipses import ellipses_of

ERROR = np.array([250.0, -300.0, 0.03, 0.02])
WRONG = {"map_sigma": 2e-5, "map_correlation_length": 3000.0, **LETTER}


@pytest.mark.parametrize(("settings", "noise"), [
    ({}, {}),
    (WRONG, {"map_sigma": 2e-5, "length": 3000.0}),
    ({"bias_sigma": 1e-5}, {"bias": 1e-5}),
    (WRONG | {"bias_sigma": 1e-5}, {"map_sigma": 2e-5, "length": 3000.0, "bias": 1e-5}),
])  # fmt: skip
def test_on_a_plane_it_is_the_kalman_update(settings, noise):
    batch, _ = make_batch(PLANE, ERROR, jacobian=(1e-9, 0.0, 3e-6, 1e-4))
    fix, memory = pmht(**settings).match(batch, PLANE, None)
    assert fix.published, fix.reason
    assert len(memory.fields[0].bank) == 1
    expected = kalman(batch, noise_of(batch, **noise))
    close(posterior_of(fix, batch.prior), expected, 0.02)
    # the position alone, for those who cannot use more
    prior = batch.prior[:2, :2]
    gain = prior @ np.linalg.inv(prior + fix.covariance)
    np.testing.assert_allclose((np.eye(2) - gain) @ prior, expected[1][:2, :2], rtol=0.05)


@pytest.mark.parametrize("taken", [True, False])
@pytest.mark.parametrize("sigma", [0.0, 2e-5])
def test_no_reading_counts_twice(taken, sigma):
    """Three batches one after the other tell what one batch of all readings tells, whether the
    navigator takes the fixes in between or not."""
    settings = WRONG | {"map_sigma": sigma}
    error, prior = np.array([300.0, -600.0, 0.4, 0.3]), (400.0, 0.4)
    keys = {"scans": 10, "start": (-3000.0, -3000.0), "seed": None}
    noise = 1e-5 * np.random.default_rng(2).standard_normal((3, 10))

    def change(batch, number):
        return replace(batch, reading=batch.reading + noise[number])

    *_, (batch, fix, _, left) = flown(
        PLANE, pmht(**settings), 3, error, prior, taken=taken, change=change, **keys
    )
    at_end = error + np.concatenate([200.0 * error[2:], np.zeros(2)])
    first = np.eye(4)
    first[:2, 2:] = 200.0 * np.eye(2)
    whole, _ = make_batch(
        PLANE, at_end, 30, start=keys["start"], seed=None,
        prior=first @ np.diag(np.repeat(np.square(prior), 2)) @ first.T,
    )  # fmt: skip
    whole = replace(whole, reading=whole.reading + noise.ravel())
    mean, covariance = kalman(whole, noise_of(whole, sigma, 3000.0))
    got = posterior_of(fix, batch.prior)
    close((got[0] - left + at_end, got[1]), (mean, covariance), 0.1)


def test_weights_are_the_probabilities_of_models():
    """Of readings that are Gaussian on a plane: the density of all of them by each model."""
    batch, _ = make_batch(PLANE, ERROR)
    batch = with_map_error(batch, 4e-5, 4000.0, 3)
    bank = pmht(map_sigma=2e-5, bias_sigma=1e-5).match(batch, PLANE, None)[1].fields[0].bank
    which, n = bank.models, len(batch)
    value, north, east = PLANE.value_and_gradient(batch.latitude, batch.longitude)
    H = batch.reading_jacobian - np.einsum(
        "ti,tij->tj", np.stack([north, east], axis=-1), batch.transition
    )
    log = np.empty(len(which.sigma))
    for m in range(len(log)):
        sigma, length = which.sigma[m], which.length[m]
        R = noise_of(batch, sigma, length, 1e-5) + (which.noise[m] - 1.0) * 1e-10 * np.eye(n)
        covariance = R + which.start[m] * H @ batch.prior @ H.T
        log[m] = which.log_prior[m] + multivariate_normal.logpdf(
            batch.reading - value, np.zeros(n), covariance
        )
    plain = (which.lag == 0.0) & (which.initial[:, -1] == 0.0)
    log -= np.logaddexp.reduce(log[plain])
    got = bank.of_models
    got -= np.logaddexp.reduce(got[plain])
    likely = plain & (log > -6.0)
    assert likely.sum() >= 8
    np.testing.assert_allclose(got[likely], log[likely], atol=0.05)


def test_two_places_that_fit_have_their_weights():
    """A field that repeats itself every km."""
    twice = field_map_of(
        lambda north, east: (
            3e-5 * np.sin(2 * np.pi * np.asarray(north) / 1000.0)
            + 3e-5 * np.sin(2 * np.pi * np.asarray(east) / 1000.0)
        )
    )
    batch, _ = make_batch(twice, (300.0, 100.0, 0.0, 0.0), prior_sigma=(450.0, 1e-4), seed=4)
    bank = pmht().match(batch, twice, None)[1]
    bank = bank.fields[0].bank.moved(-bank.taken)
    place, weight = by_grid(batch, twice, noise_of(batch), 3000.0, 30.0)
    probability = bank.weight
    far = 0
    for north in (-700.0, 300.0, 1300.0):
        for east in (-900.0, 100.0, 1100.0):
            exact = weight[np.hypot(*(place - [north, east]).T) < 400.0].sum()
            got = probability[np.hypot(*(bank.mean[:, :2] - [north, east]).T) < 400.0].sum()
            far += 0.02 < exact < 0.5
            assert got == pytest.approx(exact, rel=0.1, abs=0.01)
    assert far >= 2


def test_shares_of_scans_are_the_whole():
    batch, _ = make_batch(PLANE, ERROR)
    batch = replace(batch, new=12)
    fix, _ = pmht(mode="retrodiction").match(batch, PLANE, None)
    assert all(share is None for share in fix.scan_information[:18])
    estimate, covariance = np.zeros(7), batch.covariance
    for t in range(18, 30):  # the navigator's estimate at the end, told scan by scan
        share = fix.of_scan(t).information
        back = batch.backward[t]
        before = back @ covariance @ back.T
        after = np.linalg.inv(np.linalg.inv(before) + share.matrix)
        forward = np.linalg.inv(back)
        estimate = estimate + forward @ after @ share.vector
        covariance = forward @ after @ forward.T
    close((estimate[:4], covariance[:4, :4]), posterior_of(fix, batch.prior), 1e-4)
    summed = sum(np.linalg.inv(fix.scan_covariance[t]) for t in range(18, 30))
    np.testing.assert_allclose(np.linalg.inv(summed), fix.covariance, rtol=1e-9)


LENGTH, SIGMA = 2000.0, 4e-5
BESIDE = ((69.0, 164.0), (66.0, -261.0), (181.0, 89.0))
"""m; drawn with 200 m, where the map says 210 to 230 m."""


class OnDisplacedMap:
    """A matcher whose map is not where the readings were taken."""

    def __init__(self, by: tuple[float, float], *, lengths: bool) -> None:
        def beside(north, east):
            return wavy(north - by[0], east - by[1])

        plain = field_map_of(beside)
        ellipse = ellipses_of(*(np.array(one) for one in (LENGTH, LENGTH, 0.0)))
        nodes = np.broadcast_to(ellipse, (*plain.shape, 3)) if lengths else None
        self.matcher = pmht(map_sigma="auto")
        self.field_map = field_map_of(
            beside,
            sigma=np.full(plain.shape, SIGMA),
            correlation_length=LENGTH,
            error_ellipses=nodes,
        )

    def match(self, batch, _, memory):
        """Match a batch on the displaced map."""
        return self.matcher.match(batch, self.field_map, memory)


def nees_of(matcher: OnDisplacedMap) -> np.ndarray:
    """Per axis of a navigator that knows its place to 20 m, after each of ten fixes."""
    legs = flown(
        field_map_of(wavy),
        matcher,
        legs=10,
        scans=10,
        error=(15.0, -10.0, 0.0, 0.0),
        prior_sigma=(20.0, 0.02),
        sigma=1e-6,
    )
    result = []
    for batch, fix, _, error in legs:
        mean, covariance = np.zeros(4), batch.prior
        if fix.published:
            mean, covariance = posterior_of(fix, batch.prior)
        result.append(nees_per_axis(error[:2] - mean[:2], covariance[:2, :2]))
    return np.array(result)


def test_a_sure_navigator_is_not_pulled_away():
    nees = [nees_of(OnDisplacedMap(by, lengths=True)).mean() for by in BESIDE]
    assert np.mean(nees) < 1.5
