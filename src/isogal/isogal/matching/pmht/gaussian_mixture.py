"""Gaussian mixtures over the navigator's error: the hypotheses that a matcher keeps while a batch
is ambiguous (docs/mathematics.md, section 6.4).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.matching.pmht.constants import CONSTANTS


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """K weighted Gaussians in n dimensions."""

    weight: Array
    """(K,) sums to 1."""
    mean: Array
    """(K, n)."""
    covariance: Array
    """(K, n, n)."""

    def __len__(self) -> int:
        return self.weight.shape[0]

    @classmethod
    def gaussian(cls, mean: Array, covariance: Array) -> "Mixture":
        """Return a mixture of one."""
        return cls(np.ones(1), mean[None].copy(), covariance[None].copy())

    def log_density(self, x: Array) -> Array:
        """Return (S,) log density at points (S, n)."""
        factors = np.linalg.cholesky(self.covariance)
        return _log_density(np.ascontiguousarray(x), np.log(self.weight), self.mean, factors)

    def draw(self, points: Array) -> Array:
        """Turn (S, 1 + n) points, the first coordinate uniform, the others standard normal, into
        samples (S, n).
        """
        factors = np.linalg.cholesky(self.covariance)
        edges = np.cumsum(self.weight)
        which = np.minimum(
            np.searchsorted(edges, points[:, 0] * edges[-1], side="right"), len(self) - 1
        )
        return _place(points, which, self.mean, factors)

    def moments(self) -> tuple[Array, Array]:
        """Return mean (n,) and covariance (n, n) of the whole."""
        if len(self) == 1 and self.weight[0] == 1.0:
            return self.mean[0], self.covariance[0]
        mean = self.weight @ self.mean
        apart = self.mean - mean
        return mean, np.einsum(
            "k,kij->ij", self.weight, self.covariance + apart[:, :, None] * apart[:, None, :]
        )

    def moved(self, transition: Array, noise: Array) -> "Mixture":
        """Return the mixture after x -> transition x + N(0, noise)."""
        return Mixture(
            self.weight,
            self.mean @ transition.T,
            transition @ self.covariance @ transition.T + noise,
        )

    def component(self, k: int) -> "Mixture":
        """Return one of its Gaussians alone."""
        return Mixture.gaussian(self.mean[k], self.covariance[k])

    def part(self, which: Integers) -> "Mixture":
        """Return some of its Gaussians with the weights they have."""
        return Mixture(self.weight[which], self.mean[which], self.covariance[which])

    def levelled(self) -> "Mixture":
        """Return the mixture with weights half-way to equal ones: a proposal that does not
        overlook a light Gaussian.
        """
        return Mixture(
            0.5 * self.weight + 0.5 * self.weight.sum() / len(self), self.mean, self.covariance
        )

    @classmethod
    def join(cls, parts: Sequence["Mixture"], weight: Array) -> "Mixture":
        """Return the mixture of mixtures with the given weights."""
        return cls(
            np.concatenate([w * part.weight for w, part in zip(weight, parts, strict=True)]),
            np.concatenate([part.mean for part in parts]),
            np.concatenate([part.covariance for part in parts]),
        )

    def pruned(self, negligible: float, most: int) -> "Mixture":
        """Join components whose means are within one 1-sigma of each other, drop negligible ones,
        sort heaviest first.
        """
        if len(self) == 1:
            return Mixture(np.ones(1), self.mean, self.covariance)
        order = np.argsort(-self.weight, kind="stable")
        order = order[self.weight[order] > negligible]
        weights: list[float] = []
        means: list[Array] = []
        covariances: list[Array] = []
        while order.size and len(weights) < most:
            apart = self.mean[order, :2] - self.mean[order[0], :2]
            inverse = np.linalg.inv(self.covariance[order[0], :2, :2])
            near = np.einsum("ki,ij,kj->k", apart, inverse, apart) < 1.0
            near[0] = True
            same, order = order[near], order[~near]
            part = Mixture(
                self.weight[same] / self.weight[same].sum(), self.mean[same], self.covariance[same]
            )
            mean, covariance = part.moments()
            weights.append(float(self.weight[same].sum()))
            means.append(mean)
            covariances.append(covariance)
        total = np.array(weights)
        rank = np.argsort(-total, kind="stable")
        return Mixture(
            total[rank] / total.sum(), np.array(means)[rank], np.array(covariances)[rank]
        )

    def agrees(self, other: "Mixture") -> bool:
        """Whether another mixture's mean position is within half a 1-sigma of this one's."""
        mean, covariance = self.moments()
        apart = (other.moments()[0] - mean)[:2]
        return (
            float(apart @ np.linalg.solve(covariance[:2, :2], apart))
            < CONSTANTS.agreement_variance_share
        )

    def widened(self, scale: float) -> "Mixture":
        """Return the mixture with all covariances times a factor."""
        return Mixture(self.weight, self.mean, self.covariance * scale)


@kernel
def _log_density(x, log_weight, mean, factor):  # type: ignore[no-untyped-def]
    samples, n, parts = x.shape[0], x.shape[1], mean.shape[0]
    term, largest = np.empty((parts, samples)), np.full(samples, -np.inf)
    z = np.empty((n, samples))
    for k in range(parts):
        constant = log_weight[k] - 0.5 * n * math.log(2.0 * math.pi)
        for i in range(n):
            constant -= math.log(factor[k, i, i])
        total = term[k]
        for s in range(samples):
            total[s] = constant
        for i in range(n):
            row, centre = z[i], mean[k, i]
            for s in range(samples):
                row[s] = x[s, i] - centre
            for j in range(i):
                weight, other = factor[k, i, j], z[j]
                for s in range(samples):
                    row[s] -= weight * other[s]
            scale = 1.0 / factor[k, i, i]
            for s in range(samples):
                row[s] *= scale
                total[s] -= 0.5 * row[s] * row[s]
        for s in range(samples):
            largest[s] = max(largest[s], total[s])
    if parts == 1:
        return largest
    out = np.zeros(samples)
    for k in range(parts):
        total = term[k]
        for s in range(samples):
            out[s] += math.exp(total[s] - largest[s])
    for s in range(samples):
        out[s] = largest[s] + math.log(out[s]) if largest[s] > -np.inf else -np.inf
    return out


@kernel
def _place(points, which, mean, factor):  # type: ignore[no-untyped-def]
    samples, n = points.shape[0], mean.shape[1]
    out = np.empty((samples, n))
    for s in range(samples):
        k = which[s]
        for i in range(n):
            total = mean[k, i]
            for j in range(i + 1):
                total += factor[k, i, j] * points[s, 1 + j]
            out[s, i] = total
    return out
