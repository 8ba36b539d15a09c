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
from isogal.matrices import lower


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

    def distances(self, x: Array) -> Array:
        """Return (K,) squared Mahalanobis distances of a point (n,)."""
        mean, covariance = np.ascontiguousarray(self.mean), np.ascontiguousarray(self.covariance)
        return np.asarray(_distances(np.ascontiguousarray(x), mean, covariance))

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
        weight, mean, covariance = _joined(
            self.weight[order], self.mean[order], self.covariance[order], most
        )
        rank = np.argsort(-weight, kind="stable")
        return Mixture(weight[rank] / weight.sum(), mean[rank], covariance[rank])

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
def _joined(weight, mean, covariance, most):  # type: ignore[no-untyped-def]
    """Return weights, means and covariances of Gaussians, heaviest first, that are joined to the
    heaviest one within one 1-sigma of which their means lie; so many of these at most."""
    count, n = mean.shape
    leader = np.full(count, -1)
    found = 0
    for k in range(count):
        if leader[k] >= 0 or found == most:
            continue
        a, b, c = covariance[k, 0, 0], covariance[k, 0, 1], covariance[k, 1, 1]
        limit = a * c - b * b
        for other in range(k, count):
            north, east = mean[other, 0] - mean[k, 0], mean[other, 1] - mean[k, 1]
            square = c * north * north - 2.0 * b * north * east + a * east * east
            if leader[other] < 0 and (other == k or square < limit):
                leader[other] = found
        found += 1
    total, middle, spread = np.zeros(found), np.zeros((found, n)), np.zeros((found, n, n))
    for k in range(count):
        if leader[k] >= 0:
            total[leader[k]] += weight[k]
    for k in range(count):
        if leader[k] >= 0:
            for i in range(n):
                middle[leader[k], i] += weight[k] / total[leader[k]] * mean[k, i]
    for k in range(count):
        if leader[k] >= 0:
            share, centre = weight[k] / total[leader[k]], middle[leader[k]]
            for i in range(n):
                for j in range(n):
                    apart = (mean[k, i] - centre[i]) * (mean[k, j] - centre[j])
                    spread[leader[k], i, j] += share * (covariance[k, i, j] + apart)
    return total, middle, spread


@kernel
def overlapping(mean, covariance, separation):  # type: ignore[no-untyped-def]
    """Return (K,) for each Gaussian the number of the group that it belongs to: two overlap where
    their means are not so many 1-sigmas apart along the line between them, and those that overlap
    in one chain or another are a group."""
    count = mean.shape[0]
    group, waiting = np.full(count, -1), np.empty(count, np.int64)
    found = 0
    for first in range(count):
        if group[first] >= 0:
            continue
        group[first], waiting[0], left = found, first, 1
        while left:
            left -= 1
            k = waiting[left]
            for other in range(first + 1, count):
                if group[other] >= 0:
                    continue
                north, east = mean[other, 0] - mean[k, 0], mean[other, 1] - mean[k, 1]
                variance = (
                    north * north * (covariance[k, 0, 0] + covariance[other, 0, 0])
                    + 2.0 * north * east * (covariance[k, 0, 1] + covariance[other, 0, 1])
                    + east * east * (covariance[k, 1, 1] + covariance[other, 1, 1])
                )  # times the squared distance
                square = north * north + east * east
                if 2.0 * square * square <= separation * separation * variance:
                    group[other], waiting[left] = found, other
                    left += 1
        found += 1
    return group


def largest_sigma(covariance: Array) -> float:
    """Return the 1-sigma of position, m, in its most uncertain direction, of a covariance whose
    first two states are north and east."""
    north, cross, east = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    return math.sqrt(0.5 * (north + east) + math.hypot(0.5 * (north - east), cross))


@kernel
def _distances(x, mean, covariance):  # type: ignore[no-untyped-def]
    """Return `Mixture.distances`."""
    out = np.zeros(mean.shape[0])
    white = np.empty(mean.shape[1])
    for k in range(mean.shape[0]):
        factor = lower(covariance[k])
        for i in range(mean.shape[1]):
            white[i] = x[i] - mean[k, i]
            for j in range(i):
                white[i] -= factor[i, j] * white[j]
            white[i] /= factor[i, i]
            out[k] += white[i] * white[i]
    return out


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
