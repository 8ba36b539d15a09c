"""Gaussian mixtures: density, samples, moments, pruning."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components
from scipy.stats import multivariate_normal

from helpers.navigators import random_covariance
from isogal.matching.pmht.gaussian_mixture import Mixture, overlapping

SIGMA = np.array([300.0, 200.0, 0.3, 0.2])


def mixture(count=3, seed=0):
    random = np.random.default_rng(seed)
    weight = random.uniform(0.2, 1.0, count)
    return Mixture(
        weight / weight.sum(),
        2000.0 * random.standard_normal((count, 4)) * [1.0, 1.0, 1e-4, 1e-4],
        np.stack([random_covariance(SIGMA, seed + k) for k in range(count)]),
    )


@pytest.mark.parametrize("count", [1, 3])
def test_density_equals_scipy(count):
    it = mixture(count)
    x = np.random.default_rng(1).normal(0.0, 1500.0, (50, 4)) * [1.0, 1.0, 1e-3, 1e-3]
    parts = [
        w * multivariate_normal.pdf(x, m, P)
        for w, m, P in zip(it.weight, it.mean, it.covariance, strict=True)
    ]
    expected = np.log(np.sum(parts, axis=0))
    good = np.isfinite(expected)
    assert good.sum() > 20
    np.testing.assert_allclose(it.log_density(x)[good], expected[good], rtol=1e-9)


def test_density_far_away_does_not_underflow():
    assert np.isfinite(mixture().log_density(np.full((1, 4), 1e7))).all()


def test_draws_have_the_moments_of_the_mixture():
    it = mixture()
    random = np.random.default_rng(2)
    points = np.column_stack([random.random(40000), random.standard_normal((40000, 4))])
    x = it.draw(points)
    mean, covariance = it.moments()
    deviation = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose((x.mean(axis=0) - mean) / deviation, 0.0, atol=4.5 / 200.0)
    np.testing.assert_allclose(
        (np.cov(x.T) - covariance) / deviation / deviation[:, None], 0.0, atol=0.05
    )
    assert it.draw(np.array([[1.0, 0, 0, 0, 0], [0.0, 0, 0, 0, 0]])).shape == (
        2,
        4,
    )  # both ends of the unit interval


def test_moments_of_one():
    one = Mixture.gaussian(np.arange(4.0), np.diag(SIGMA**2))
    mean, covariance = one.moments()
    np.testing.assert_array_equal(mean, np.arange(4.0))
    np.testing.assert_allclose(covariance, np.diag(SIGMA**2))
    assert len(one) == 1


def test_moved_and_widened_go_through_the_moments():
    it = mixture()
    transition = np.eye(4)
    transition[:2, 2:] = 300.0 * np.eye(2)
    noise = np.diag([1.0, 4.0, 1e-4, 1e-4])
    mean, covariance = it.moments()
    moved = it.moved(transition, noise).moments()
    np.testing.assert_allclose(moved[0], transition @ mean, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(moved[1], transition @ covariance @ transition.T + noise, rtol=1e-9)
    np.testing.assert_allclose(it.widened(1.5).covariance, 1.5 * it.covariance)


def test_join_and_component():
    a, b = mixture(2, 1), mixture(1, 5)
    joined = Mixture.join([a, b], np.array([0.25, 0.75]))
    np.testing.assert_allclose(joined.weight, [*(0.25 * a.weight), 0.75])
    np.testing.assert_array_equal(joined.mean[2], b.mean[0])
    np.testing.assert_array_equal(joined.component(1).covariance[0], a.covariance[1])


def test_pruning_joins_near_drops_negligible_and_sorts():
    near, far = np.zeros(4), np.array([5000.0, 0.0, 0.0, 0.0])
    it = Mixture(
        np.array([0.2, 0.5, 0.3 - 1e-9, 1e-9]),
        np.array([near, far, [50.0, 0, 0, 0], far * 2]),
        np.stack([np.diag(SIGMA**2)] * 4),
    )
    pruned = it.pruned(1e-6, 10)
    assert len(pruned) == 2
    np.testing.assert_allclose(pruned.weight, [0.5, 0.5], atol=1e-8)
    mean, covariance = it.moments()
    after, spread = pruned.moments()
    np.testing.assert_allclose(after, mean, atol=1e-4)
    np.testing.assert_allclose(spread, covariance, rtol=1e-4, atol=1e-3)
    assert len(it.pruned(1e-6, 1)) == 1
    assert it.pruned(1e-6, 1).weight[0] == 1.0


@given(st.integers(0, 2**32 - 1))
def test_pruning_keeps_weights_a_distribution(seed):
    pruned = mixture(6, seed % 10**6).pruned(1e-3, 4)
    assert pruned.weight.sum() == pytest.approx(1.0)
    assert (np.diff(pruned.weight) <= 0.0).all()


def test_pruning_is_that_of_numpy():
    """Each is joined to the heaviest one within whose 1-sigma it lies, one after the other."""
    it = mixture(60, seed=4)
    order = np.argsort(-it.weight, kind="stable")
    parts = []
    while order.size and len(parts) < 12:
        apart = it.mean[order, :2] - it.mean[order[0], :2]
        inverse = np.linalg.inv(it.covariance[order[0], :2, :2])
        near = np.einsum("ki,ij,kj->k", apart, inverse, apart) < 1.0
        same, order = order[near], order[~near]
        part = it.part(same)
        weight = part.weight.sum()
        moments = Mixture(part.weight / weight, part.mean, part.covariance).moments()
        parts.append((weight, *moments))
    parts.sort(key=lambda part: -part[0])
    weight, mean, covariance = (np.array(one) for one in zip(*parts, strict=True))
    assert len(it) - len(order) > len(parts)  # some are joined
    pruned = it.pruned(0.0, 12)
    np.testing.assert_allclose(pruned.weight, weight / weight.sum(), rtol=1e-12)
    np.testing.assert_allclose(pruned.mean, mean, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(pruned.covariance, covariance, rtol=1e-9, atol=1e-9)


def test_groups_are_those_of_a_graph():
    """Connected components of the graph of all pairs that overlap."""
    it, limit = mixture(60, seed=5), 4.0
    apart = it.mean[:, None, :2] - it.mean[:, :2]
    along = apart / np.maximum(np.linalg.norm(apart, axis=2), 1e-9)[..., None]
    both = it.covariance[:, None, :2, :2] + it.covariance[:, :2, :2]
    sigma = np.sqrt(np.einsum("kli,klij,klj->kl", along, both, along))
    linked = np.sqrt(2.0) * np.linalg.norm(apart, axis=2) <= limit * sigma
    _, expected = connected_components(linked | np.eye(60, dtype=bool))
    group = overlapping(it.mean, it.covariance, limit)
    assert 1 < group.max() + 1 < 60
    np.testing.assert_array_equal(group, expected)


def test_distances_are_those_of_numpy():
    it, x = mixture(3), np.array([100.0, -50.0, 0.1, 0.2])
    expected = [
        (x - m) @ np.linalg.solve(P, x - m) for m, P in zip(it.mean, it.covariance, strict=True)
    ]
    np.testing.assert_allclose(it.distances(x), expected, rtol=1e-9)
