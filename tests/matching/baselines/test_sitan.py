"""SITAN: the fitted plane by hand, and the filter on a plane map, where it must be exact."""

import numpy as np
import pytest

from helpers.batches import field_map_of, make_batch
from isogal.matching.baselines.readings import AssumedNoise, UsableReadings
from isogal.matching.baselines.sitan import Sitan, SitanOptions, plane


@pytest.mark.parametrize("region", [0.0, 1.5])
@pytest.mark.parametrize("bias_sigma", [0.0, 3e-5])
def test_exact_on_a_plane_map(region, bias_sigma):
    tilted = field_map_of(lambda n, e: 3e-8 * n - 2e-8 * e)
    batch, _ = make_batch(
        tilted, (200.0, -100.0, 0.05, 0.0), sigma=1e-5, jacobian=(-8e-9, 0.0, 6e-6, 1.2e-4)
    )
    noise = AssumedNoise(bias_sigma=bias_sigma)
    fix, _ = Sitan(noise, SitanOptions(region=region)).match(batch, tilted, None)
    # least squares on all readings at once; a plane in metres is a plane in degrees up to the
    # map's curvature, a metre here
    readings = UsableReadings.of(batch, tilted, noise, whole=True)
    residual, slope = readings.linearise(tilted, np.zeros(4))
    R = np.diag(readings.arrays.sigma**2) + bias_sigma**2
    matrix = slope.T @ np.linalg.solve(R, slope)
    np.testing.assert_allclose(fix.information.matrix, matrix, rtol=2e-3, atol=1e-4 * matrix.max())
    posterior = np.linalg.inv(np.linalg.inv(batch.prior) + matrix)
    mean = -posterior @ slope.T @ np.linalg.solve(R, residual)
    told = np.linalg.solve(
        np.linalg.inv(batch.prior) + fix.information.matrix, fix.information.vector
    )
    units = np.array([1.0, 1.0, 1e-3, 1e-3])
    np.testing.assert_allclose(told / units, mean / units, atol=1.0)


def test_gate_leaves_a_spike_out(rough_map):
    batch, _ = make_batch(rough_map, prior_sigma=(100.0, 0.05))
    batch.reading[10] += 50e-5
    fix, _ = Sitan(options=SitanOptions(gate=5.0)).match(batch, rough_map, None)
    assert fix.diagnostics["readings_used"] == 29.0
    every, _ = Sitan().match(batch, rough_map, None)
    assert every.diagnostics["misfit"] > 3.0 * fix.diagnostics["misfit"]


def test_plane_through_a_bowl_by_hand():
    # n² over n = -200, -100, ..., 200: mean (4 + 1 + 0 + 1 + 4) / 5 = 2, mean square (16 + 1 + 0 +
    # 1 + 16) / 5 = 6.8, of 100² m²; a slope of 3 east
    side = 100.0 * np.arange(-2.0, 3.0)
    value, slope, left = plane(side[:, None] ** 2 + 3.0 * side, np.array([200.0, 200.0]))
    np.testing.assert_allclose([value, *slope, left], [2e4, 0.0, 3.0, (6.8 - 4.0) * 1e8])
