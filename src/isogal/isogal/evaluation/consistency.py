"""Consistency of a filter: its NEES, and the chi-square intervals that it must lie in
(docs/mathematics.md, section 11.3).

Bar-Shalom, Li, Kirubarajan, "Estimation with Applications to Tracking and Navigation", section
5.4: for a consistent filter the normalised estimation error squared, e' P^-1 e, is chi-square with
as many degrees of freedom as e has components. Divided by that number its mean is 1; above 1 the
filter is overconfident."""

import numpy as np
from numpy.typing import ArrayLike

from isogal.arrays import Array


def nees_per_axis(error: ArrayLike, covariance: ArrayLike) -> Array:
    """Return the normalised estimation error squared, divided by the number of axes; its mean is 1
    for a consistent filter.

    Parameters
    ----------
    error : (..., n) array
        Estimate minus truth; NaN = none.
    covariance : (..., n, n) array
        Covariance of the error according to the estimator; broadcasts against `error`.

    Returns
    -------
    (...) array
        e' P^-1 e / n; NaN where error or covariance is not finite, infinite where the covariance
        is not positive definite (no estimator can be that certain).
    """
    error = np.asarray(error, dtype=np.float64)
    covariance = np.asarray(covariance, dtype=np.float64)
    axes = error.shape[-1]
    shape = np.broadcast_shapes(error.shape[:-1], covariance.shape[:-2])
    error = np.broadcast_to(error, (*shape, axes)).reshape(-1, axes)
    covariance = np.broadcast_to(covariance, (*shape, axes, axes)).reshape(-1, axes, axes)
    result = np.full(error.shape[0], np.nan)
    known = np.isfinite(error).all(axis=-1) & np.isfinite(covariance).all(axis=(-2, -1))
    definite = known.copy()
    definite[known] = np.linalg.eigvalsh(covariance[known])[:, 0] > 0.0
    result[known & ~definite] = np.inf
    solved = np.linalg.solve(covariance[definite], error[definite][..., None])[..., 0]
    result[definite] = np.einsum("ij,ij->i", error[definite], solved) / axes
    return result.reshape(shape)


def chi_square_interval(
    samples: float, axes: int = 2, confidence: float = 0.95
) -> tuple[float, float]:
    """Return the interval in which the mean of a consistent filter's NEES per axis lies with the
    given probability.

    Parameters
    ----------
    samples : float
        How many independent values were averaged, or are worth those that were (see
        `effective_samples`).
    axes : int
        Components of the error behind each value.
    confidence : float
        Probability of the interval, two-sided.

    Returns
    -------
    tuple of float
        Lower and upper end, around 1.
    """
    from scipy.special import gammaincinv  # scipy.stats would take seconds to import

    freedom = samples * axes
    tail = (1.0 - confidence) / 2.0
    # chi-square is a gamma distribution of shape freedom / 2 and scale 2
    low, high = (2.0 * float(gammaincinv(freedom / 2.0, p)) / freedom for p in (tail, 1.0 - tail))
    return low, high


def effective_samples(values: ArrayLike) -> float:
    """Return how many independent values (R, B) values are worth: runs are independent, the B
    values of a run are correlated in time.

    N / tau with the integrated autocorrelation time tau = 1 + 2 sum rho_k, rho pooled over runs
    and summed up to its first value that is not positive (initial positive sequence, Geyer 1992).
    NaN (declined batches) are left out. Never fewer than one a run."""
    values = np.asarray(values, dtype=np.float64)
    known = np.isfinite(values)
    count = int(known.sum())
    if count < 2:
        return float(count)
    deviation = np.where(known, values - values[known].mean(), 0.0)
    variance = float((deviation**2).sum()) / count
    if variance == 0.0:
        return float(count)
    tau = 1.0
    for lag in range(1, values.shape[1]):
        pairs = int((known[:, lag:] & known[:, :-lag]).sum())
        if pairs == 0:
            break
        rho = float((deviation[:, lag:] * deviation[:, :-lag]).sum()) / pairs / variance
        if rho <= 0.0:
            break
        tau += 2.0 * rho
    runs = int(known.any(axis=1).sum())
    return float(max(count / tau, runs))


def mean_nees(values: ArrayLike) -> tuple[float, tuple[float, float]]:
    """Return the mean of (R, B) NEES values per axis of two axes, NaN left out, and the chi-square
    interval of 95 % that it lies in for a consistent estimator; NaN where there is no value."""
    values = np.atleast_2d(np.asarray(values, dtype=np.float64))
    known = ~np.isnan(values)
    if not known.any():
        return np.nan, (np.nan, np.nan)
    independent = effective_samples(values)
    return float(values[known].mean()), chi_square_interval(independent)


def spread_test(
    error: ArrayLike, covariance: ArrayLike, confidence: float = 0.95
) -> tuple[Array, tuple[float, float], bool]:
    """Compare the errors of R independent runs with the covariance that a filter (or the bound's
    recursion) claims.

    At one instant the R errors are independent, so the sum of their e' P^-1 e is chi-square with R
    n degrees of freedom, exactly so for Gaussian errors. Choose few instants, well apart: those
    close together are correlated, which makes the interval conservative.

    Parameters
    ----------
    error : (R, K, n) array
        Errors of R runs at K instants, for example of the unaided navigator.
    covariance : (K, n, n) or (R, K, n, n) array
        Their covariance as claimed.
    confidence : float
        Probability that a consistent filter passes, at least.

    Returns
    -------
    (K,) array, pair of float, bool
        Mean over runs of e' P^-1 e / n; the interval that all K together stay in with at least
        that confidence (Bonferroni); and whether they do.
    """
    runs, instants, axes = np.shape(error)
    values = np.asarray(nees_per_axis(error, covariance).mean(axis=0))
    low, high = chi_square_interval(runs, axes, 1.0 - (1.0 - confidence) / instants)
    return values, (low, high), bool(np.all((values >= low) & (values <= high)))
