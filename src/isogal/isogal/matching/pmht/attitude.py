"""The navigator's attitude error, which goes with what a batch says of position and velocity.

docs/mathematics.md, section 7.3.
"""

from functools import lru_cache

import numpy as np

from isogal.arrays import Array
from isogal.matching.interfaces import Batch
from isogal.matching.matrices import symmetric
from isogal.matching.pmht.likelihood import BatchLikelihood


def with_attitude(
    batch: Batch, likelihood: BatchLikelihood, mean: Array, covariance: Array
) -> tuple[Array, Array, Array]:
    """Return posterior mean (n,), covariance and prior (n, n) of the navigator's error; n = 7
    where the batch knows the attitude, else 4.

    Given xi ~ N(mean (4,), covariance (4, 4)) the navigator's drift is what the readings say of
    it, linearised at the mean. Without the attitude a navigator would go on believing it
    independent of what it has just learnt.
    """
    if batch.attitude is None:
        return mean, covariance, batch.prior
    by_xi, root = batch.attitude
    count = root.shape[1]
    drift, slope, spread = (array[:count] for array in likelihood.nuisance_given(mean))
    follow = by_xi + root @ slope
    full = np.concatenate([mean, by_xi @ mean + root @ drift])
    return (
        full,
        _joint(covariance, follow, root @ spread[:, :count] @ root.T),
        joint_prior(batch),
    )


@lru_cache(maxsize=4)  # several ask it of the same batch
def joint_prior(batch: Batch) -> Array:
    """Return the navigator's covariance (n, n) of its position, velocity and, where the batch
    knows it, attitude error; n = 7 or 4. Not to be written to.
    """
    if batch.attitude is None:
        return batch.prior
    by_xi, root = batch.attitude
    return _joint(batch.prior, by_xi, root @ root.T)


def _joint(covariance: Array, gain: Array, rest: Array) -> Array:
    """Return the covariance of (x, gain x + e), e ~ N(0, rest)."""
    n = len(covariance)
    whole = np.empty((n + len(rest), n + len(rest)))
    whole[:n, :n], whole[n:, :n] = covariance, gain @ covariance
    whole[:n, n:] = whole[n:, :n].T
    whole[n:, n:] = whole[n:, :n] @ gain.T + rest
    whole = symmetric(whole)
    whole.flat[:: len(whole) + 1] *= 1.0 + 1e-14
    return whole
