"""Parameters that change: their covariance over a batch, and what conditioning on all readings of
several batches says of them."""

from dataclasses import replace

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.parameters import Parameters
from isogal.matching.pmht.likelihood import BatchLikelihood
from isogal.matching.pmht.noise_model import NoiseModel
from isogal.matching.pmht.sensor_bias import BiasEstimate
from isogal.matching.pmht.wandering import Wandering

SIGMA, SCANS = 1e-5, 12
PLANE = field_map_of(lambda north, east: 4e-8 * north - 3e-8 * east, half=60e3, step=2000.0)


def dense(time, sigma, correlation_time, walk, since):
    """Covariance of one parameter at times, which walks since a time."""
    apart = np.abs(time[:, None] - time)
    if np.isfinite(correlation_time):
        return sigma**2 * np.exp(-apart / correlation_time)
    return sigma**2 + walk**2 * (np.minimum(time[:, None], time) - since)


@pytest.mark.parametrize(
    ("correlation_time", "walk", "early"),
    [(500.0, 0.0, -300.0), (20.0, 0.0, -300.0), (np.inf, 0.3, 0.0)],
)
def test_together_the_parts_are_the_whole_process(correlation_time, walk, early):
    time = np.array([early, 0.3 * early, 0.0, 10.0, 25.0, 70.0, 100.0])
    told = Parameters((), np.array([2.0]), np.ones((7, 1)))
    told = replace(told, time=np.array([correlation_time]), walk=np.array([walk]))
    found = Wandering.of(told, 0.0, 100.0)
    at_start = found.carried(time)[:, 0] * found.kept[0]
    new = found.arrived(time)[:, 0] * found.fresh[0]
    whole = 4.0 * np.outer(at_start, at_start) + np.outer(new, new)
    whole += found.bridge(time, np.ones((7, 1)))
    np.testing.assert_allclose(
        whole, dense(time, 2.0, correlation_time, walk, 0.0), rtol=1e-9, atol=1e-12
    )


def test_constants_and_batches_without_time_do_not_change():
    still = Parameters((), np.ones(1), np.ones((7, 1)))
    assert Wandering.of(still, 0.0, 100.0) is None
    assert Wandering.of(None, 0.0, 100.0) is None
    told = replace(still, time=np.array([50.0]), walk=np.zeros(1))
    assert Wandering.of(told, 5.0, 5.0) is None
    assert Wandering.of(replace(told, time=np.array([np.inf])), 0.0, 5.0) is None


@pytest.mark.parametrize("overlap", [0, 4])
def test_over_several_batches_it_is_the_conditional_mean(overlap):
    """Of a navigator without error: one stationary parameter, one that walks, one constant."""
    random = np.random.default_rng(7)
    plain, _ = make_batch(PLANE, np.zeros(4), SCANS, sigma=SIGMA, seed=1)
    plain = replace(plain, prior=np.diag(np.square([1e-3, 1e-3, 1e-6, 1e-6])))
    sigma, time, walk = (
        SIGMA * np.array([5.0, 3.0, 4.0]),
        [200.0, np.inf, np.inf],
        [0.0, 1e-6, 0.0],
    )
    step = plain.time[1] - plain.time[0]
    stamps = plain.time[0] + step * np.arange(3 * SCANS)
    columns = np.stack([np.ones(len(stamps)), np.sin(np.arange(len(stamps))), stamps / 300.0], 1)
    process = [dense(stamps, *each, stamps[0]) for each in zip(sigma, time, walk, strict=True)]
    nearly = 1e-20 * np.eye(len(stamps))
    roots = [np.linalg.cholesky(one + nearly) for one in process]
    drawn = [root @ random.standard_normal(len(stamps)) for root in roots]
    truth = np.stack(drawn, axis=1)
    felt = (columns * truth).sum(axis=1) + SIGMA * random.standard_normal(len(stamps))
    estimate, used = None, 0
    while used < len(stamps):
        first = max(used - overlap, 0)
        rows = np.arange(first, min(first + SCANS, len(stamps)))
        part = plain.part(np.arange(len(rows)))
        base = BatchLikelihood.of(part, PLANE, NoiseModel()).linearise(np.zeros(4))[0]
        told = Parameters((), sigma, columns[rows], time=np.array(time), walk=np.array(walk))
        batch = replace(
            part,
            time=stamps[rows],
            reading=part.reading - base + felt[rows],
            new=len(rows) - (used - first),
            parameters=told,
        )
        start = estimate or BiasEstimate.unknown(stamps[0], 0.0, 0.0, parameters=told)
        bias = start.at_end(batch)
        whole = bias.added_to(batch)
        likelihood = BatchLikelihood.of(whole, PLANE, NoiseModel())
        estimate = bias.measured(whole, likelihood, np.zeros(4), batch.prior)
        used = int(rows[-1]) + 1
    total = SIGMA**2 * np.eye(len(stamps))
    for k, one in enumerate(process):
        total += np.outer(columns[:, k], columns[:, k]) * one
    cross = np.stack([one[-1] * columns[:, k] for k, one in enumerate(process)])
    mean = cross @ np.linalg.solve(total, felt)
    left = np.diag([one[-1, -1] for one in process]) - cross @ np.linalg.solve(total, cross.T)
    np.testing.assert_allclose(estimate.mean[2:], mean, atol=2e-2 * SIGMA)
    np.testing.assert_allclose(
        np.sqrt(np.diag(estimate.covariance)[2:]), np.sqrt(np.diag(left)), rtol=2e-2
    )
