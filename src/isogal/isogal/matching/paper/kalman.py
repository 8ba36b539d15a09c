"""Linear Kalman filter and fixed-interval smoother of a short batch (paper eqs. forward,
backward).

Filter and smoother are compiled and work on one batch: T scans, n states, m measured numbers a
scan. Scan 0 carries the prior and is not updated, as in the paper, whose forward process starts at
y_{1|1} = x_1. A measurement with a NaN is left out: the scan is only predicted."""

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.matrices import inverse_of_lower, lower, product, product_transposed


@kernel
def _solved(a: Array, b: Array) -> Array:
    """Return the x (n, m) of a x = b for a symmetric positive definite a (n, n); NaN where it is
    not definite."""
    whitening = inverse_of_lower(lower(a))
    return product(whitening.T, product(whitening, b))


def constant_velocity(interval: Array, acceleration_density: float) -> tuple[Array, Array]:
    """Transitions F and process noises Q of (north, east, velocity north, velocity east)
    (Bar-Shalom, Li & Kirubarajan 2001, 6.2.2).

    Parameters
    ----------
    interval : (T - 1,) array
        Time from each scan to the next, s.
    acceleration_density : float
        Spectral density q of the white acceleration, m²/s³.

    Returns
    -------
    F, Q : (T - 1, 4, 4) arrays
        Of paper eq. s3-03; metres and m/s.
    """
    dt, place, rate = interval[:, None], [0, 1], [2, 3]
    F, Q = np.tile(np.eye(4), (len(interval), 1, 1)), np.zeros((len(interval), 4, 4))
    F[:, place, rate] = dt
    Q[:, place, place] = acceleration_density * dt**3 / 3.0
    Q[:, place, rate] = Q[:, rate, place] = acceleration_density * dt**2 / 2.0
    Q[:, rate, rate] = acceleration_density * dt
    return F, Q


@kernel
def _store(means: Array, covariances: Array, t: int, mean: Array, covariance: Array) -> None:
    for i in range(mean.shape[0]):
        means[t, i] = mean[i]
        for j in range(mean.shape[0]):
            covariances[t, i, j] = covariance[i, j]


@kernel
def forward_filter(
    mean: Array, covariance: Array, F: Array, Q: Array, H: Array, z: Array, R: Array
) -> tuple[Array, Array, Array, Array]:
    """Run the forward process of paper eq. forward.

    Parameters
    ----------
    mean : (n,) array
        y_{1|1}.
    covariance : (n, n) array
        P_{1|1}.
    F, Q : (T - 1, n, n) arrays
        Transition and process noise from each scan to the next.
    H : (m, n) array
        Measurement matrix.
    z : (T, m) array
        Measurements; a row with NaN is skipped, row 0 is not used.
    R : (T, m, m) array
        Their covariances.

    Returns
    -------
    filtered_mean (T, n), filtered_covariance (T, n, n)
        y_{t|t} and P_{t|t}.
    predicted_mean (T, n), predicted_covariance (T, n, n)
        y_{t|t-1} and P_{t|t-1}; at scan 0 all four are the prior's.
    """
    scans, states = z.shape[0], mean.shape[0]
    filtered_mean = np.empty((scans, states))
    filtered_covariance = np.empty((scans, states, states))
    predicted_mean = np.empty((scans, states))
    predicted_covariance = np.empty((scans, states, states))
    _store(filtered_mean, filtered_covariance, 0, mean, covariance)
    _store(predicted_mean, predicted_covariance, 0, mean, covariance)
    for t in range(1, scans):
        P = product_transposed(product(F[t - 1], filtered_covariance[t - 1]), F[t - 1])
        x = np.zeros(states)
        for i in range(states):
            for j in range(states):
                x[i] += F[t - 1, i, j] * filtered_mean[t - 1, j]
                P[i, j] += Q[t - 1, i, j]
        _store(predicted_mean, predicted_covariance, t, x, P)
        _store(filtered_mean, filtered_covariance, t, x, P)
        missing = False
        for i in range(z.shape[1]):
            missing = missing or np.isnan(z[t, i])
        if missing:
            continue
        HP = product(H, P)
        S = product_transposed(HP, H)
        for i in range(S.shape[0]):
            for j in range(S.shape[0]):
                S[i, j] += R[t, i, j]
        Kt = _solved(S, HP)
        for i in range(states):
            for k in range(z.shape[1]):
                innovation = z[t, k]
                for j in range(states):
                    innovation -= H[k, j] * x[j]
                filtered_mean[t, i] += Kt[k, i] * innovation
                for j in range(states):
                    # half from either side keeps it symmetric
                    filtered_covariance[t, i, j] -= 0.5 * (
                        Kt[k, i] * HP[k, j] + HP[k, i] * Kt[k, j]
                    )
    return filtered_mean, filtered_covariance, predicted_mean, predicted_covariance


@kernel
def backward_smoother(
    filtered_mean: Array,
    filtered_covariance: Array,
    predicted_mean: Array,
    predicted_covariance: Array,
    F: Array,
) -> tuple[Array, Array]:
    """Run the backward process of paper eq. backward, with the covariances that belong to it
    (Rauch, Tung & Striebel 1965).

    Parameters
    ----------
    filtered_mean, filtered_covariance, predicted_mean, predicted_covariance
        As `forward_filter` returns them.
    F : (T - 1, n, n) array
        Transition from each scan to the next.

    Returns
    -------
    mean (T, n), covariance (T, n, n)
        x_t and P_t given all T scans.
    """
    mean = filtered_mean.copy()
    covariance = filtered_covariance.copy()
    states = mean.shape[1]
    for t in range(filtered_mean.shape[0] - 2, -1, -1):
        gain_t = _solved(predicted_covariance[t + 1], product(F[t], filtered_covariance[t]))
        change = product(covariance[t + 1] - predicted_covariance[t + 1], gain_t)
        for i in range(states):
            for k in range(states):
                mean[t, i] += gain_t[k, i] * (mean[t + 1, k] - predicted_mean[t + 1, k])
                for j in range(states):
                    covariance[t, i, j] += 0.5 * (
                        gain_t[k, i] * change[k, j] + change[k, i] * gain_t[k, j]
                    )
    return mean, covariance
