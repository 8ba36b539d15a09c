"""Several hypotheses and one batch: weights go by evidence, dead ones are dropped, equal ones
joined."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.pmht import hypotheses
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.hypotheses import update
from isogal.matching.pmht.importance_sampling import Sampling, sample
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.noise_model import NoiseModel

ERROR = np.array([250.0, -300.0, 0.0, 0.0])
NORTH = np.array([60.0, 0.0, 0.0, 0.0])
SIGMA = (100.0, 0.02)
SAMPLING = Sampling(samples=1024)


def likelihood_of(field_map, error=ERROR, **keys):
    batch, _ = make_batch(field_map, error, **({"prior_sigma": SIGMA} | keys))
    return BatchLikelihood.of(batch, field_map, NoiseModel()), batch.prior


def places(prior, means, weight):
    return Mixture(np.array(weight), np.array(means, float), np.stack([prior] * len(means)))


def tiles_around(middle):
    """Four tiles side by side."""
    offsets = 150.0 * np.array([[0.7, 0.7], [0.7, -0.7], [-0.7, 0.7], [-0.7, -0.7]])
    means = np.asarray(middle) + np.column_stack([offsets, np.zeros((4, 2))])
    return Mixture(
        np.full(4, 0.25), means, np.stack([np.diag([80.0**2, 80.0**2, 4e-4, 4e-4])] * 4)
    )


def test_the_wrong_place_dies_by_its_evidence(rough_map):
    likelihood, prior = likelihood_of(rough_map)
    result = update(
        likelihood, places(prior, [[4000.0, 4000.0, 0, 0], ERROR], [0.9, 0.1]), SAMPLING, 16
    )
    assert len(result.mixture) == 1
    assert result.mixture.weight[0] == 1.0
    assert np.linalg.norm(result.mixture.mean[0, :2] - ERROR[:2]) < 100.0
    assert result.resolved
    assert result.effective > 0.3


def test_weights_go_by_prior_times_evidence():
    """A map of two equal halves: the same readings fit 8 km apart, with equal evidence, so the
    prior's weights stay."""
    waves = field_map_of(
        lambda n, e: (
            5e-5 * (np.sin(2 * np.pi * n / 8000.0) + np.sin(2 * np.pi * (e + 0.4 * n) / 5000.0))
        )
    )
    likelihood, prior = likelihood_of(waves, np.zeros(4))
    there = [8000.0, 0.4 * -8000.0 + 5000.0, 0.0, 0.0]
    result = update(likelihood, places(prior, [np.zeros(4), there], [0.3, 0.7]), SAMPLING, 16)
    np.testing.assert_allclose(result.mixture.weight, [0.7, 0.3], atol=0.05)
    np.testing.assert_allclose(result.mixture.mean[0, :2], there[:2], atol=60.0)
    one, _ = sample(likelihood, Mixture.gaussian(np.zeros(4), prior), SAMPLING)
    assert result.log_evidence == pytest.approx(one.log_evidence, abs=0.1)


def test_two_that_come_to_the_same_place_are_joined(rough_map):
    likelihood, prior = likelihood_of(rough_map)
    around = [ERROR + NORTH, ERROR - NORTH]
    result = update(likelihood, places(prior, around, [0.5, 0.5]), SAMPLING, 16)
    assert len(result.mixture) == 1
    whole, _ = sample(likelihood, places(prior, around, [0.5, 0.5]), SAMPLING)
    deviation = np.sqrt(np.diag(whole.mixture.moments()[1]))
    np.testing.assert_allclose(
        (result.mixture.mean[0] - whole.mixture.moments()[0]) / deviation, 0.0, atol=0.2
    )
    assert result.log_evidence == pytest.approx(whole.log_evidence, abs=0.1)


def test_at_most_so_many(rough_map):
    likelihood, _ = likelihood_of(rough_map, sigma=1e-2)  # readings that decide nothing
    prior = np.diag([50.0**2, 50.0**2, 1e-4, 1e-4])
    means = [[2000.0 * i, 0.0, 0.0, 0.0] for i in range(6)]
    result = update(likelihood, places(prior, means, [1 / 6] * 6), SAMPLING, 4)
    assert len(result.mixture) == 4
    assert result.mixture.weight.sum() == pytest.approx(1.0)


def test_none_on_the_map(rough_map):
    likelihood, prior = likelihood_of(rough_map)
    assert (
        update(
            likelihood, places(prior, [[1e6, 0, 0, 0], [0, 1e6, 0, 0]], [0.5, 0.5]), SAMPLING, 16
        )
        is None
    )
    one_left = update(
        likelihood, places(prior, [[1e6, 0, 0, 0], ERROR], [0.999, 0.001]), SAMPLING, 16
    )
    assert np.linalg.norm(one_left.mixture.mean[0, :2] - ERROR[:2]) < 100.0


def test_a_wide_prior_is_searched(rough_map):
    error = np.array([9000.0, 7000.0, 0.0, 0.0])
    likelihood, prior = likelihood_of(rough_map, error, scans=60, prior_sigma=(10e3, 0.05))
    result = update(likelihood, Mixture.gaussian(np.zeros(4), prior), SAMPLING, 64)
    assert np.linalg.norm(result.mixture.mean[:, :2] - error[:2], axis=1).min() < 300.0


def test_of_many_the_right_one_survives_a_glance(rough_map):
    """A thousand places on a lattice, the true one with little weight: it must win, and the others
    must not all be sampled."""
    likelihood, _ = likelihood_of(rough_map)
    side = 400.0 * np.arange(-16, 17)
    lattice = np.stack(np.meshgrid(side, side, indexing="ij"), axis=-1).reshape(-1, 2) + ERROR[:2]
    means = np.column_stack([lattice, np.zeros((len(lattice), 2))])
    weight = np.where(np.abs(lattice - ERROR[:2]).max(axis=1) < 1.0, 0.3, 1.0)
    prior = Mixture(
        weight / weight.sum(),
        means,
        np.stack([np.diag([120.0**2, 120.0**2, 4e-4, 4e-4])] * len(means)),
    )
    assert len(prior) > CONSTANTS.sampled_hypotheses
    result = update(likelihood, prior, SAMPLING, 2048)
    assert np.linalg.norm(result.mixture.mean[0, :2] - ERROR[:2]) < 100.0
    assert result.mixture.weight[0] > 0.99
    away = update(
        likelihood,
        Mixture(prior.weight, means + np.array([1e6, 0.0, 0.0, 0.0]), prior.covariance),
        SAMPLING,
        2048,
    )
    assert away is None


def test_those_that_are_not_sampled_keep_their_weight():
    """Readings that decide nothing: a thousand hypotheses stay what they were, sampled or not."""
    flat = field_map_of(lambda n, e: 1e-10 * n + 0.0 * e)
    likelihood, _ = likelihood_of(flat, np.zeros(4), sigma=1e-3)
    means = np.column_stack(
        [
            3000.0 * np.arange(-5, 5).repeat(100),
            200.0 * np.tile(np.arange(-50, 50), 10),
            np.zeros((1000, 2)),
        ]
    )
    covariance = np.diag([100.0**2, 50.0**2, 1e-4, 1e-4])
    prior = Mixture(np.full(1000, 1e-3), means, np.stack([covariance] * 1000))
    mixture = update(likelihood, prior, SAMPLING, 2048).mixture
    assert len(mixture) == 1000
    np.testing.assert_allclose(mixture.weight, 1e-3, rtol=0.02)
    deviation = np.sqrt(np.diagonal(mixture.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(deviation / np.sqrt(np.diag(covariance)), 1.0, atol=0.25)


def test_neighbours_become_one(rough_map):
    """Tiles side by side are one mode, not four, when the readings say so."""
    likelihood, _ = likelihood_of(rough_map)
    tiles = tiles_around(ERROR)
    result = update(likelihood, tiles, SAMPLING, 16)
    assert len(result.mixture) == 1
    assert result.resolved
    whole, _ = sample(likelihood, tiles, Sampling(samples=8192))
    deviation = np.sqrt(np.diag(whole.mixture.moments()[1]))
    np.testing.assert_allclose(
        (result.mixture.mean[0] - whole.mixture.moments()[0]) / deviation, 0.0, atol=0.1
    )


@pytest.mark.parametrize("light", [2e-3, 2e-4])
def test_the_right_place_wins_however_light_and_far_away_it_was(rough_map, light):
    """Weight says nothing about distance: 0.2 % at 6 km leave a mixture's 1-sigma below 600 m.
    With noise like this the other places are worse by e^-20 and more, but not so hopeless that a
    sampler looks for something else."""
    likelihood, prior = likelihood_of(rough_map, sigma=3e-4, prior_sigma=(300.0, 0.02))
    wrong = np.add(ERROR, [-5000.0, 3500.0, 0.0, 0.0])
    mixture = places(
        prior, [wrong, np.add(wrong, [60.0, -40.0, 0.0, 0.0]), ERROR], [0.5, 0.5 - light, light]
    )
    assert np.sqrt(np.linalg.eigvalsh(mixture.moments()[1][:2, :2])[-1]) < CONSTANTS.wide_prior_m
    result = update(likelihood, mixture, Sampling(samples=512), 16)
    apart = [
        sample(likelihood, mixture.component(k), Sampling(samples=4096))[0].log_evidence
        for k in range(3)
    ]
    assert apart[2] - max(apart[:2]) > 15.0
    assert np.linalg.norm(result.mixture.mean[0, :2] - ERROR[:2]) < 150.0
    assert result.mixture.weight[0] > 0.999


def test_neighbours_become_one_whatever_else_is_possible():
    """Readings that decide nothing: the four tiles are one place, the hypothesis far away another,
    and weights stay."""
    flat = field_map_of(lambda n, e: 1e-10 * n + 0.0 * e)
    likelihood, _ = likelihood_of(flat, np.zeros(4), sigma=1e-3)
    far = Mixture.gaussian(
        np.add(ERROR, [-5000.0, 3500.0, 0.0, 0.0]), np.diag([80.0**2, 80.0**2, 4e-4, 4e-4])
    )
    tiles = tiles_around(ERROR)
    result = update(likelihood, Mixture.join([tiles, far], np.array([0.7, 0.3])), SAMPLING, 16)
    np.testing.assert_allclose(result.mixture.weight, [0.7, 0.3], atol=0.01)
    np.testing.assert_allclose(result.mixture.mean[:, :2], [ERROR[:2], far.mean[0, :2]], atol=10.0)
    np.testing.assert_allclose(
        np.sqrt(np.diag(result.mixture.covariance[0])[:2]), np.hypot(80.0, 105.0), rtol=0.05
    )


def test_a_light_place_far_away_survives_the_search():
    """A map that repeats itself every 12 km: of the two places that the prior allows the farther
    one is unlikely, not impossible."""
    waves = field_map_of(
        lambda n, e: (
            2e-4
            * (
                np.sin(2 * np.pi * n / 12e3)
                + np.sin(2 * np.pi * (n / 4e3 + e / 5e3))
                + np.sin(2 * np.pi * e / 7e3)
            )
        )
    )
    error = np.array([3200.0, 0.0, 0.0, 0.0])
    likelihood, prior = likelihood_of(
        waves, error, prior_sigma=(1.03 * CONSTANTS.search_prior_m, 1e-3)
    )
    mixture = update(likelihood, Mixture.gaussian(np.zeros(4), prior), SAMPLING, 64).mixture
    there = np.linalg.norm(mixture.mean[:, :2] - (error[:2] - [12e3, 0.0]), axis=1) < 300.0
    ratio = np.exp(-0.5 * (8800.0**2 - 3200.0**2) / prior[0, 0])
    assert np.linalg.norm(mixture.mean[0, :2] - error[:2]) < 100.0
    assert mixture.weight[there].sum() == pytest.approx(ratio / (1.0 + ratio), rel=0.4)


def test_what_is_too_much_for_one_update_is_left_to_the_next(rough_map, monkeypatch):
    """A right place of little weight is not reached at first, but is not lost either."""
    likelihood, prior = likelihood_of(rough_map)
    wrong = [[4000.0 * k, 4000.0, 0.0, 0.0] for k in range(-3, 4)]
    many = places(prior, [*wrong, ERROR], [*[0.141] * 7, 0.013])
    asked = []

    def counted(likelihood, *values):
        asked.append(values)
        return update_one(likelihood, *values)

    update_one = hypotheses._update_one
    monkeypatch.setattr(hypotheses, "_update_one", counted)
    every = update(likelihood, many, SAMPLING, 16)
    assert len(asked) > 4
    asked.clear()
    monkeypatch.setattr(hypotheses, "CONSTANTS", replace(CONSTANTS, update_look_ups=1))
    some = update(likelihood, many, SAMPLING, 16)
    assert len(asked) == 1
    assert np.linalg.norm(some.mixture.mean[0, :2] - ERROR[:2]) < 200.0
    assert some.log_evidence == pytest.approx(every.log_evidence, abs=1.5)
    # as vague as the few points that were asked
    assert some.mixture.covariance[0, 0, 0] > 4.0 * every.mixture.covariance[0, 0, 0]
