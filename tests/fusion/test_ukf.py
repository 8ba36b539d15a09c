"""Parts of the compiled filter against filterpy (the whole: `test_reference.py`,
`test_against_numpy.py`)."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints

from helpers.navigators import SIGMA, error_between, filterpy_update, fly, random_covariance
from isogal.fusion import sigma_points
from isogal.fusion.measurements import PositionFix

SIZE = len(SIGMA)


@pytest.mark.parametrize("parameters", [(1.0, 2.0, 0.0), (0.5, 2.0, 1.0)])
def test_sigma_points_equal_filterpy(parameters):
    covariance = random_covariance(SIGMA)
    factor, points = np.empty((15, 16)), np.empty((15, 32))
    padded = np.pad(covariance, ((0, 0), (0, 1)))
    assert sigma_points.factorise(SIZE, padded, factor, np.empty(16))
    spread = sigma_points.merwe_weights(*parameters).spread
    sigma_points.spread_points(SIZE, factor, spread, points)
    expected = MerweScaledSigmaPoints(15, *parameters).sigma_points(np.zeros(15), covariance)
    assert not points[:, sigma_points.CENTRE].any()
    np.testing.assert_allclose(points[:, :15].T / SIGMA, expected[1:16] / SIGMA, atol=1e-9)
    np.testing.assert_allclose(points[:, 16:31].T / SIGMA, expected[16:] / SIGMA, atol=1e-9)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (250.0, -400.0)])
def test_position_fix_equals_filterpy(offset):
    flight = fly(fusion={"false_rejection": 0.0})
    state = flight.start
    state.covariance[:] = random_covariance(SIGMA)
    before, moved = state.copy(), state.copy()
    moved.position[:2] += np.array(offset) / 6.4e6
    z = error_between(moved, before)[:2]
    R = np.array([[120.0**2, 3000.0], [3000.0, 80.0**2]])
    error, covariance = filterpy_update(before.covariance, np.eye(2, 15), R, z)
    result = PositionFix(*moved.position[:2], R).update(state, flight.model)
    np.testing.assert_allclose(result.innovation, z, rtol=1e-4, atol=1e-9)
    expected = z @ np.linalg.solve(before.covariance[:2, :2] + R, z)
    assert result.nis == pytest.approx(expected, rel=1e-3, abs=1e-12)
    apart = error_between(state, before) - error
    np.testing.assert_allclose(apart / SIGMA, 0.0, atol=1e-3)
    scale = SIGMA * SIGMA[:, None]
    np.testing.assert_allclose(state.covariance / scale, covariance / scale, atol=1e-9)
