"""Compiled loops over hypotheses, where no result of the matcher shows what they do."""

import math

import numpy as np

from helpers.bank import HERE, PLANE, models, random_bank, states_of
from helpers.batches import make_batch
from isogal.matching.pmht import kernels
from isogal.matching.pmht.rows import rows_of


def test_only_what_overlaps_and_has_one_model_is_merged():
    bank = random_bank(4, 4)
    bank.which[:] = [0, 0, 0, 1]
    bank.mean[:, :2] = [[0.0, 0.0], [10.0, 5.0], [5000.0, 0.0], [0.0, 0.0]]
    bank.covariance[:, :2, :2] = 1e4 * np.eye(2)
    bank.log_weight[:] = [-1.0, -2.0, -3.0, -4.0]
    stay = kernels.merged(
        bank.which, bank.log_weight, bank.mean, bank.covariance, *bank.places(HERE)
    )
    assert list(stay) == [0, 2, 3]


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
