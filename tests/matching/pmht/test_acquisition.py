"""The search over tens of kilometres: the true place is among the tiles, evidence and moments are
right, nothing off the map."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from helpers.batches import field_map_of, make_batch
from isogal.matching.pmht import acquisition
from isogal.matching.pmht.acquisition import _tiles, acquire
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matching.pmht.importance_sampling import Sampling, sample
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.noise_model import NoiseModel

NOISE = NoiseModel()
OFFSET = np.array([500.0, -500.0, 0.0, 0.0])


@pytest.mark.parametrize(
    "error", [(8000.0, -6000.0, 0.0, 0.0), (-12000.0, 9000.0, 0.1, -0.1), (0.0, 0.0, 0.0, 0.0)]
)
def test_the_true_place_is_among_the_tiles(rough_map, error):
    batch, _ = make_batch(rough_map, error, scans=60, prior_sigma=(10e3, 0.1))
    found = acquire(BatchLikelihood.of(batch, rough_map, NOISE), np.zeros(4), batch.prior, 64)
    tiles, _, misfit, _ = found
    assert 0.0 < misfit < 2.0 * 60
    assert 1 <= len(tiles) <= 64
    assert tiles.weight.sum() == pytest.approx(1.0)
    assert (np.diff(tiles.weight) <= 0.0).all()
    away = np.linalg.norm(tiles.mean[:, :2] - error[:2], axis=1)
    assert away.min() < 300.0
    assert (
        tiles.log_density(np.array([error]))[0]
        > Mixture.gaussian(np.zeros(4), batch.prior).log_density(np.array([error]))[0]
    )


def test_around_another_mean(rough_map):
    error = np.array([8000.0, -6000.0, 0.0, 0.0])
    batch, _ = make_batch(rough_map, error, scans=60, prior_sigma=(3e3, 0.1))
    tiles, *_ = acquire(
        BatchLikelihood.of(batch, rough_map, NOISE), error + OFFSET, batch.prior, 16
    )
    assert np.linalg.norm(tiles.mean[0, :2] - error[:2]) < 300.0


@pytest.mark.parametrize("error", [(300.0, -200.0, 0.0, 0.0), (1500.0, 500.0, 0.02, -0.03)])
@pytest.mark.parametrize("sigma", [1e-4, 1e-5, 1e-6])
def test_evidence_is_the_samplers(rough_map, sigma, error):
    """Where noise is small against what the map changes within a cell it may be too low, as the
    cells are widened, never too high."""
    batch, _ = make_batch(rough_map, error, prior_sigma=(800.0, 0.01), sigma=sigma)
    likelihood = BatchLikelihood.of(batch, rough_map, NOISE)
    _, evidence, *_ = acquire(likelihood, np.zeros(4), batch.prior, 64)
    posterior, _ = sample(
        likelihood, Mixture.gaussian(np.zeros(4), batch.prior), Sampling(samples=8192)
    )
    assert posterior.beta == 1.0
    assert evidence < posterior.log_evidence + 0.5
    assert evidence > posterior.log_evidence - (0.5 if sigma > 5e-6 else 30.0)


def test_a_ridge_on_a_plane_is_tiled():
    """One contour across the search area: tiles follow it, with the posterior's extent along and
    across."""
    slope = 5e-8
    plane = field_map_of(lambda north, east: slope * north + 0.0 * east, half=60e3, step=2000.0)
    batch, _ = make_batch(plane, (1000.0, 0.0, 0.0, 0.0), prior_sigma=(3000.0, 1e-4), sigma=1e-4)
    tiles, evidence, *_ = acquire(
        BatchLikelihood.of(batch, plane, NOISE), np.zeros(4), batch.prior, 400
    )
    mean, covariance = tiles.moments()
    across = 1e-4 / slope / np.sqrt(30.0)
    assert mean[0] == pytest.approx(1000.0, abs=4.0 * across)
    assert np.sqrt(covariance[1, 1]) == pytest.approx(3000.0, rel=0.05)
    assert np.sqrt(covariance[0, 0]) < 2.0 * across
    assert len(tiles) > 30
    H = -slope * batch.transition[:, 0]
    value = plane.value(batch.latitude, batch.longitude)
    exact = multivariate_normal.logpdf(
        batch.reading, value, H @ batch.prior @ H.T + 1e-8 * np.eye(30)
    )
    assert evidence - 30 * np.log(1e-4) - 15 * np.log(2 * np.pi) == pytest.approx(exact, abs=0.3)


def test_nothing_off_the_map(rough_map):
    batch, _ = make_batch(rough_map, prior_sigma=(1000.0, 0.1))
    likelihood = BatchLikelihood.of(batch, rough_map, NOISE)
    assert acquire(likelihood, np.array([1e6, 0.0, 0.0, 0.0]), batch.prior, 16) is None


def test_partly_off_the_map(rough_map):
    batch, _ = make_batch(rough_map, start=(30e3, 0.0), prior_sigma=(8000.0, 0.1))
    tiles, *_ = acquire(BatchLikelihood.of(batch, rough_map, NOISE), np.zeros(4), batch.prior, 16)
    assert np.isfinite(tiles.mean).all()
    assert np.linalg.norm(tiles.mean[:, :2], axis=1).min() < 300.0


def test_too_many_cells_that_may_be_right_are_not_divided(rough_map, monkeypatch):
    """Readings that say little leave most cells possible: to go on with some of them would be to
    know more than they say."""
    batch, _ = make_batch(rough_map, scans=8, prior_sigma=(8000.0, 0.1), sigma=3e-4)
    likelihood = BatchLikelihood.of(batch, rough_map, NOISE)
    divided, *_ = acquire(likelihood, np.zeros(4), batch.prior, 4096)
    few = replace(CONSTANTS, coarse_cells=1500, fine_cells=9 * 30, fine_enough_sigma=0.01)
    monkeypatch.setattr(acquisition, "CONSTANTS", few)
    coarse, *_ = acquire(likelihood, np.zeros(4), batch.prior, 4096)
    of_all, of_few = (np.sqrt(np.diag(one.moments()[1])[:2]) for one in (divided, coarse))
    np.testing.assert_allclose(of_few, of_all, rtol=0.05)


def test_a_tile_has_the_moments_of_its_cells():
    random = np.random.default_rng(3)
    cells = np.unique(random.integers(-40, 40, (900, 2)), axis=0)
    weight, size, most = random.exponential(size=len(cells)), 120.0, 50
    root = random.standard_normal((4, 4))
    mean, covariance = random.standard_normal(4), root @ root.T + np.eye(4)
    follow = np.linalg.solve(covariance[:2, :2], covariance[:2, 2:]).T
    tiles = _tiles(cells, weight, size, mean, covariance, follow, most)
    groups: dict[tuple[int, ...], list[int]] = {}
    for k, cell in enumerate(cells // CONSTANTS.tile_cells):
        groups.setdefault(tuple(cell), []).append(k)
    heaviest = sorted(groups.values(), key=lambda rows: -weight[rows].sum())[:most]
    assert len(groups) > len(tiles) == most
    np.testing.assert_allclose(
        tiles.weight,
        [weight[rows].sum() / weight[np.concatenate(heaviest)].sum() for rows in heaviest],
    )
    joint = np.vstack([np.eye(2), follow])
    given = covariance[2:, 2:] - follow @ covariance[:2, 2:]
    for k, rows in enumerate(heaviest):
        place = cells[rows] * size
        centre = np.average(place, axis=0, weights=weight[rows])
        spread = np.cov(place.T, aweights=weight[rows], ddof=0) + np.eye(2) * size**2 / 6.0
        np.testing.assert_allclose(tiles.mean[k], mean + joint @ centre)
        expected = joint @ spread @ joint.T
        expected[2:, 2:] += given
        np.testing.assert_allclose(tiles.covariance[k], expected, rtol=1e-9, atol=1e-6)
