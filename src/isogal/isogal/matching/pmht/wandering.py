"""Bias and parameters that change slowly, from batch to batch and within one
(`isogal.matching.parameters`; docs/mathematics.md, sections 9.3 and 9.5).

With s the end of the last batch and e that of this one, phi(h) = exp(-h / tau) and q(h) =
sigma² (1 - phi(h)²) for a stationary Gauss-Markov process, phi = 1 and q = w² h for a random walk,
a parameter at e is phi(e - s) of what it was at s, and sqrt(q(e - s)) u, u ~ N(0, 1). At a time
t between them it is phi(t - s) of that at s, b(t) sqrt(q(e - s)) u with b(t) = phi(e - t) q(t - s)
/ q(e - s), and a bridge that is independent of both, of covariance phi(|t - t'|) q(min(t, t') - s)
- b(t) b(t') q(e - s). At a time before s it is phi(s - t) of that at s and what is independent, of
covariance phi(|t - t'|) q(s - max(t, t'))."""

import math
from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.matching.parameters import Parameters

_LONGEST = 30.0
"""Correlation times over which anything of a parameter is taken to be left."""


@dataclass(frozen=True, slots=True, eq=False)
class Wandering:
    """What becomes of C parameters from one batch's end to the next (s)."""

    start: float
    end: float
    sigma: Array
    """(C,) of the stationary ones."""
    time: Array
    """(C,) s, correlation time; inf = walks or stays."""
    walk: Array
    """(C,) per root second."""
    which: Integers
    """(n,) those that change."""

    @classmethod
    def of(cls, parameters: Parameters | None, start: float, end: float) -> "Wandering | None":
        """Return that of a batch's parameters; None where they stay as they are."""
        if parameters is None or parameters.time is None or parameters.walk is None:
            return None
        which = np.flatnonzero(np.isfinite(parameters.time) | (parameters.walk > 0.0))
        if not which.size or end <= start:
            return None
        return cls(start, end, parameters.sigma, parameters.time, parameters.walk, which)

    @property
    def kept(self) -> Array:
        """(C,) how much of each is left at the end."""
        return self._keep(np.array(self.end - self.start))

    @property
    def fresh(self) -> Array:
        """(n,) 1-sigma of what is new at the end, of those that change."""
        return np.sqrt(self._new(np.array(self.end - self.start)))[self.which]

    def carried(self, time: Array) -> Array:
        """Return (T, C) what a row at times (T,) has of what is left at the end of each."""
        return self._keep(np.abs(time - self.start)[:, None]) / self.kept

    def arrived(self, time: Array) -> Array:
        """Return (T, n) what it has of what is new at the end, of those that change."""
        whole = self._new(np.array(self.end - self.start))[self.which]
        since = np.maximum(time - self.start, 0.0)[:, None]
        left = np.maximum(self.end - time, 0.0)[:, None]
        share = self._keep(left)[:, self.which] * self._new(since)[:, self.which]
        return np.asarray(share / whole)

    def bridge(self, time: Array, reading: Array) -> Array:
        """Return (T, T) the covariance of the rest in rows that have (T, C) of each."""
        total = np.zeros((len(time), len(time)))
        away, arrived = time - self.start, self.arrived(time)
        same = np.sign(away)[:, None] * np.sign(away) > 0.0
        nearest = np.minimum(np.abs(away)[:, None], np.abs(away))[..., None]
        apart = np.abs(time[:, None] - time)[..., None]
        keep, new = self._keep(apart), self._new(nearest)
        for column, k in enumerate(self.which):
            b = arrived[:, column] * self.fresh[column]
            rest = np.where(same, keep[..., k] * new[..., k], 0.0) - b[:, None] * b
            total += reading[:, k, None] * reading[:, k] * rest
        return total

    def _keep(self, elapsed: Array) -> Array:
        return np.exp(-np.minimum(elapsed / self.time, _LONGEST))

    def _new(self, elapsed: Array) -> Array:
        stationary = np.where(np.isfinite(self.time), self.sigma, 0.0)
        lost = -np.expm1(-2.0 * np.minimum(elapsed / self.time, _LONGEST))
        return np.asarray(stationary**2 * lost + self.walk**2 * elapsed)


@dataclass(frozen=True, slots=True)
class Walk:
    """Of the bias, from the last batch's end to this one's (s)."""

    start: float
    end: float
    density: float
    """Map's unit per root second."""

    @property
    def walks(self) -> bool:
        """Whether there is anything to it."""
        return self.density > 0.0 and self.end > self.start

    def added(self, own: Array) -> Array:
        """Return the columns of theta's own noise (k, k) with that of the walk, if it walks."""
        if not self.walks:
            return own
        column = np.zeros(len(own))
        column[0] = self.density * math.sqrt(self.end - self.start)
        return np.column_stack([own, column])

    def share(self, time: Array) -> Array:
        """Return how much of the walk was there at times, 0 to 1."""
        return np.clip((time - self.start) / (self.end - self.start), 0.0, 1.0)

    def bridge(self, time: Array) -> Array:
        """Return (T, T) the covariance of the rest at times."""
        share = self.share(time)
        rest = np.minimum(share[:, None], share) - share[:, None] * share
        return self.density**2 * (self.end - self.start) * rest
