"""The navigator's attitude error, which goes with what a batch says of position and velocity.

docs/mathematics.md, section 7.3.
"""

from functools import lru_cache

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.matching.interfaces import Batch
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
        _joint(np.ascontiguousarray(covariance), follow, root @ spread[:, :count] @ root.T),
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
    prior = np.ascontiguousarray(batch.prior)
    return np.asarray(_joint(prior, np.ascontiguousarray(by_xi), root @ root.T))


@kernel
def _joint(covariance, gain, rest):  # type: ignore[no-untyped-def]
    """Return the covariance of (x, gain x + e), e ~ N(0, rest)."""
    n, m = covariance.shape[0], rest.shape[0]
    whole = np.zeros((n + m, n + m))
    for i in range(n):
        for j in range(n):
            whole[i, j] = 0.5 * (covariance[i, j] + covariance[j, i])
            for k in range(m):
                whole[n + k, i] += gain[k, j] * covariance[j, i]
    for k in range(m):
        for i in range(n):
            whole[i, n + k] = whole[n + k, i]
        for other in range(k + 1):
            value = 0.5 * (rest[k, other] + rest[other, k])
            for i in range(n):
                value += whole[n + k, i] * gain[other, i]
            whole[n + k, n + other] = whole[n + other, n + k] = value
    for i in range(n + m):
        whole[i, i] *= 1.0 + 1e-14
    return whole
