"""Cells of a search: what readings have in common, and the evidence by which cells are ranked."""

from dataclasses import replace

import numpy as np

from helpers.batches import field_map_of, make_batch, wavy
from isogal.inertial.error_state import BATCH_STATES
from isogal.matching.pmht.cells import Seen, in_common, residuals_at
from isogal.matching.pmht.models import Assumed, few, models_of
from isogal.matching.pmht.rows import rows_of
from isogal.matching.pmht.states import States

ROUGH = field_map_of(wavy)
ERROR = (2000.0, -1500.0, 0.0, 0.0)


def test_what_states_put_into_rows_in_common():
    """A random walk and a process that forgets, by the sum over all that has joined them."""
    random = np.random.default_rng(1)
    effect, decay = random.standard_normal((6, 2)), np.array([1.0, 0.8])
    start, fresh = np.array([4.0, 1.0]), random.uniform(0.1, 1.0, (6, 2))
    expected, covariance = np.zeros((6, 6)), np.zeros((6, 2, 2))
    for s in range(2):
        joined = np.r_[start[s], fresh[:, s]]
        share = np.array([[decay[s] ** (t - k) * (t >= k) for k in range(-1, 6)]
                          for t in range(6)])  # fmt: skip
        of_state = (share * joined) @ share.T
        expected += effect[:, s, None] * of_state * effect[:, s]
        covariance[:, s, s] = np.diag(of_state)
    gone = -np.arange(6)[:, None] * np.log(decay)
    found = in_common(effect, covariance, gone, np.arange(6.0))
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def seen_of(bias: float) -> tuple[Seen, np.ndarray]:
    """Readings at a place 2.5 km from where the navigator believes to be, with a bias of 2 mGal,
    and what is told of it."""
    batch, _ = make_batch(ROUGH, ERROR, 60)
    batch = replace(batch, reading=batch.reading + 2e-5)
    states = States.of(batch, ROUGH)
    rows, _ = rows_of(batch, ROUGH, states, np.array([4000.0]), None)
    told = models_of(
        Assumed(noise=1e-5, scale=1e-3, rough=1e-5, sigma=0.0, trust=1.0, bias=bias), states
    )
    rest = np.zeros((len(rows.level), BATCH_STATES, BATCH_STATES))
    return Seen.of(rows, rest, ROUGH, few(told, 1e-5)), np.array([ERROR[:2], (0.0, 0.0)])


def test_a_told_bias_is_counted():
    """As a Gaussian whose covariance has the bias in all readings."""
    (without, centres), (with_bias, _) = seen_of(0.0), seen_of(5e-5)
    residual = residuals_at(with_bias.rows, ROUGH.grid, centres)
    R = with_bias.other + 100.0**2 * with_bias.blur
    np.testing.assert_allclose(with_bias.other - without.other, 25e-10, rtol=1e-9)
    square = (np.linalg.solve(np.linalg.cholesky(R), residual) ** 2).sum(axis=0)
    expected = -0.5 * (square + np.linalg.slogdet(R)[1])
    found = with_bias.log_evidence(residual, 100.0)[:, 0]
    np.testing.assert_allclose(found, expected, rtol=1e-3)
    assert found[0] > without.log_evidence(residual, 100.0)[0, 0] + 10.0
