"""Filter and smoother against filterpy and against one dense least-squares solution of the whole
batch."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from isogal.matching.paper.kalman import backward_smoother, constant_velocity, forward_filter

SCANS = 12
H = np.eye(2, 4)


@pytest.fixture(scope="module")
def problem():
    rng = np.random.default_rng(1)
    interval = rng.uniform(5.0, 15.0, SCANS - 1)
    F, Q = constant_velocity(interval, 1e-3)
    root = rng.normal(size=(4, 4)) * np.array([[100.0], [100.0], [0.5], [0.5]])
    spread = rng.normal(size=(SCANS, 2, 2))
    R = 1e4 * (spread @ spread.transpose(0, 2, 1) + np.eye(2))
    z = rng.normal(scale=200.0, size=(SCANS, 2)) + 220.0 * np.arange(SCANS)[:, None]
    z[4] = np.nan
    return np.array([0.0, 10.0, 20.0, 18.0]), root @ root.T, F, Q, H, z, R


def test_constant_velocity_by_hand():
    F, Q = constant_velocity(np.array([2.0]), 3.0)
    np.testing.assert_array_equal(F[0], [[1, 0, 2, 0], [0, 1, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]])
    np.testing.assert_allclose(
        Q[0], 3.0 * np.array([[8 / 3, 0, 2, 0], [0, 8 / 3, 0, 2], [2, 0, 2, 0], [0, 2, 0, 2]])
    )


def test_two_steps_of_noise_are_one_long_step():
    F, Q = constant_velocity(np.array([4.0, 7.0, 11.0]), 0.2)
    np.testing.assert_allclose(F[1] @ Q[0] @ F[1].T + Q[1], Q[2], rtol=1e-14)


def test_equals_filterpy(problem):
    mean, covariance, F, Q, _, z, R = problem
    xs, Ps, xp, Pp = forward_filter(*problem)
    smooth, smooth_P = backward_smoother(xs, Ps, xp, Pp, F)

    reference = KalmanFilter(dim_x=4, dim_z=2)
    reference.x, reference.P, reference.H = mean[:, None].copy(), covariance.copy(), H
    means, covariances = [mean[:, None]], [covariance]
    for t in range(1, SCANS):
        reference.predict(F=F[t - 1], Q=Q[t - 1])
        if not np.isnan(z[t]).any():
            reference.update(z[t][:, None], R=R[t])
        means.append(reference.x.copy())
        covariances.append(reference.P.copy())
    np.testing.assert_allclose(xs, np.array(means)[..., 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(Ps, np.array(covariances), rtol=1e-9, atol=1e-9)
    # filterpy's smoother uses Fs[k + 1], Qs[k + 1] for the step from k to k + 1
    rts_mean, rts_P, _, _ = reference.rts_smoother(
        np.array(means), np.array(covariances), Fs=[np.eye(4), *F], Qs=[np.eye(4), *Q]
    )
    np.testing.assert_allclose(smooth, rts_mean[..., 0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(smooth_P, rts_P, rtol=1e-9, atol=1e-9)
