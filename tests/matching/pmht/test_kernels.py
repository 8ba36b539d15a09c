"""Compiled loops over hypotheses against plain NumPy."""

import math

import numpy as np
import pytest

from helpers.bank import HERE, PLANE, models, moments_of, random_bank, states_of
from helpers.batches import field_map_of, make_batch, wavy
from isogal.matching.pmht import kernels, mixture_kernels
from isogal.matching.pmht.rows import rows_of

ROUGH = field_map_of(wavy)


def test_propagation_is_a_matrix_product():
    bank, random = random_bank(0), np.random.default_rng(1)
    forward = np.eye(7) + 0.2 * random.standard_normal((7, 7))
    root = random.standard_normal((7, 7))
    growth = root @ root.T
    factor = np.linspace(1.0, 30.0, len(bank.models.sigma))
    mean, covariance = bank.mean.copy(), bank.covariance.copy()
    kernels.propagated(bank.which, factor, forward, growth, mean, covariance)
    whole = np.eye(mean.shape[1])
    whole[:7, :7] = forward
    expected = whole @ bank.covariance @ whole.T
    expected[:, :7, :7] += factor[bank.which, None, None] * growth
    np.testing.assert_allclose(mean, bank.mean @ whole.T, rtol=1e-12, atol=1e-18)
    np.testing.assert_allclose(covariance, expected, rtol=1e-9, atol=1e-15)


def filtered(x, P, z, H, noise, keep, fresh):
    """`kernels._filtered` with all states; returns x, P and the log evidence."""
    x, P, c = x.copy(), P.copy(), len(x)
    used, alone = np.arange(c), np.zeros((len(z), 0, 0))
    evidence = kernels._filtered(
        x, P, z, H, noise, keep, fresh, alone, alone, used, c, np.empty(c)
    )
    return x, P, evidence


def by_matrices(x, P, z, H, noise, keep, fresh):
    """The same, matrix by matrix."""
    wrong, width = kernels.OUTLIER
    total = 0.0
    for t in range(len(z)):
        F = np.diag(np.r_[np.ones(7), keep[t]])
        x, P = F @ x, F @ P @ F.T + np.diag(np.r_[np.zeros(7), fresh[t]])
        innovation, S = z[t] - H[t] @ x, H[t] @ P @ H[t] + noise[t]
        density = math.exp(-0.5 * innovation**2 / S) / math.sqrt(2.0 * math.pi * S)
        each, gains = [density], [1.0 / S]
        if innovation**2 / S >= kernels.SUSPECT:  # or an outlier, which says nothing
            flat = wrong / math.sqrt(2.0 * math.pi * (S + width * noise[t]))
            each, gains = [(1.0 - wrong) * density, flat], [1.0 / S, 0.0]
        total += math.log(sum(each))
        means = [x + P @ H[t] * innovation * gain for gain in gains]
        mixed = sum(p * m for p, m in zip(each, means, strict=True)) / sum(each)
        spread = sum(
            p * (P - np.outer(P @ H[t], P @ H[t]) * gain + np.outer(m - mixed, m - mixed))
            for p, m, gain in zip(each, means, gains, strict=True)
        )
        x, P = mixed, spread / sum(each)
    return x, P, total


@pytest.mark.parametrize("off", [0.0, 4.0, 20.0, 300.0])
def test_a_reading_is_a_scalar_update_and_perhaps_an_outlier(off):
    random, n = np.random.default_rng(2), 12
    root = np.eye(11) + 0.2 * random.standard_normal((11, 11))
    x, P = random.standard_normal(11), root @ root.T
    H, noise = random.standard_normal((n, 11)), random.uniform(0.5, 2.0, n)
    z = H @ (x + root @ random.standard_normal(11)) + random.standard_normal(n)
    z[5] += off
    keep, fresh = random.uniform(0.8, 1.0, (n, 4)), random.uniform(0.0, 0.1, (n, 4))
    given = (x, P, z, H, noise, keep, fresh)
    for got, expected in zip(filtered(*given), by_matrices(*given), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-8, atol=1e-10)


def test_an_outlier_moves_a_state_less_than_a_smaller_one():
    P, H, one = np.eye(7), np.eye(7)[:1], np.ones(1)
    nothing = np.zeros((1, 0))
    moved = [
        filtered(np.zeros(7), P, z * one, H, 0.1 * one, nothing, nothing)[0][0]
        for z in (2.0, 6.0, 20.0)
    ]
    assert moved[0] == pytest.approx(2.0 / 1.1)
    assert 0.0 < moved[1] < 0.1
    assert 0.0 <= moved[2] < 1e-9


def test_merging_conserves_mean_and_covariance():
    bank = random_bank(3, 8)
    bank.which[:] = 1
    order = np.argsort(-bank.log_weight)
    bank = bank.part(order)
    mean, covariance = bank.mean.copy(), bank.covariance.copy()
    weight = bank.log_weight.copy()
    place, spread = bank.places(HERE)
    stay = mixture_kernels.merged(bank.which, weight, mean, covariance, place, 1e6 * spread)
    assert list(stay) == [0]
    expected = moments_of(bank)
    assert weight[0] == pytest.approx(np.logaddexp.reduce(bank.log_weight))
    scale = np.sqrt(np.diag(expected[1]))
    np.testing.assert_allclose(mean[0] / scale, expected[0] / scale, atol=1e-10)
    np.testing.assert_allclose(covariance[0] / scale, expected[1] / scale, rtol=1e-9, atol=1e-12)


def test_only_what_overlaps_and_has_one_model_is_merged():
    bank = random_bank(4, 4)
    bank.which[:] = [0, 0, 0, 1]
    bank.mean[:, :2] = [[0.0, 0.0], [10.0, 5.0], [5000.0, 0.0], [0.0, 0.0]]
    bank.covariance[:, :2, :2] = 1e4 * np.eye(2)
    bank.log_weight[:] = [-1.0, -2.0, -3.0, -4.0]
    stay = mixture_kernels.merged(
        bank.which, bank.log_weight, bank.mean, bank.covariance, *bank.places(HERE)
    )
    assert list(stay) == [0, 2, 3]


def looked_at(field_map, sigma: float, place=(0.0, 0.0)):
    """How far a batch on a map is from linear for one hypothesis, and along which axis."""
    batch, _ = make_batch(field_map, scans=10)
    which, states = models(sigma=0.0, trust=1.0), states_of()
    rows, _ = rows_of(batch, field_map, states, which.lengths, None)
    mean, covariance = np.zeros((1, states.count)), np.zeros((1, states.count, states.count))
    mean[0, :2] = place
    covariance[0, :2, :2] = np.diag([sigma**2, sigma**2 / 100.0])
    worst, axes = np.zeros(1), np.zeros((1, 2))
    mixture_kernels.curvature(
        field_map.grid, rows, which, np.zeros(1, np.int64), np.ones(1, bool), 0, mean,
        mean[:, :2], covariance[:, :2, :2], 0.0, 2.0, worst, axes,
    )  # fmt: skip
    return worst[0], axes[0], rows


def test_a_plane_is_linear_and_a_rough_map_is_not():
    assert looked_at(PLANE, 500.0)[0] < 1e-3
    worst = [looked_at(ROUGH, sigma)[0] for sigma in (3.0, 30.0, 300.0)]
    assert worst[0] < 0.25 < worst[2]
    assert worst == sorted(worst)
    assert abs(looked_at(ROUGH, 300.0)[1][0]) == pytest.approx(300.0)


def test_curvature_is_what_the_map_departs_by():
    sigma = 200.0
    worst, axis, rows = looked_at(ROUGH, sigma)

    def at(shift):
        moved = 2.0 * shift * axis
        return ROUGH.value(
            rows.latitude + moved[0] * rows.radian[:, 0],
            rows.longitude + moved[1] * rows.radian[:, 1],
        )

    departure = 0.5 * (at(1.0) + at(-1.0)) - at(0.0)
    change = 0.5 * (at(1.0) - at(-1.0))
    stride = 1 + len(rows.level) // mixture_kernels.MOST_LOOKED_AT
    less, more = (stride * (one**2 / rows.noise)[::stride].sum() for one in (departure, change))
    assert worst == pytest.approx(math.sqrt(less / more), rel=1e-6)


def test_a_hypothesis_that_leaves_the_map_has_no_evidence():
    batch, _ = make_batch(PLANE, scans=10)
    which, states = models(sigma=0.0, trust=1.0), states_of()
    rows, _ = rows_of(batch, PLANE, states, which.lengths, None)
    mean = np.zeros((2, states.count))
    mean[1, 0] = 200e3
    covariance = np.zeros((2, states.count, states.count))
    covariance[:, :7, :7] = np.diag([1e4, 1e4, 1e-2, 1e-2, 1e-10, 1e-10, 1e-8])
    evidence = np.empty(2)
    before = mean[1].copy()
    kernels.observed(PLANE.grid, rows, which, np.zeros(2, np.int64), mean, covariance, evidence)
    assert np.isfinite(evidence[0])
    assert evidence[1] == -math.inf
    np.testing.assert_array_equal(mean[1], before)
