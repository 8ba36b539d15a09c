"""How much more, or less, a map is wrong in some places than the covariance says.

Readings that were left out show it: their squared errors over the variance that was expected of
them. It is described in two steps. First it follows the roughness r² of the field around
(`isogal.maps.gridding.roughness`),

    a²(x) = c (d + r²(x) / r0²)^b,

with c, b, d and the width of the smoothing that make the errors most likely. Then what is left is
averaged in blocks, and the averages q smoothed with Gaussian weights about each place,

    a²(x) -> a²(x) (n + Σ w q) / (n + Σ w),

with the width of the weights and the n, how many blocks 1 counts for, with which each block is
predicted best from the others (not from those next to it that were left out with it, as errors
hold together). Last, c is such that the mean squared normalised error is 1. Variances of the
field's errors are multiplied by a²; the noise of readings is not."""

import math
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.maps.gridding.roughness import Roughness, block_means, local_variance

_SMOOTHING = (0.5, 1.0, 2.0, 4.0)
"""Widths over which the roughness is smoothed, in lengths."""
_WIDTHS = (1.0, 1.5, 2.5, 4.0, 6.0, 10.0)
"""In sides of a block."""
_COUNTS = (2.0, 4.0, 8.0, 16.0, 64.0)
_MOST_BLOCKS = 2500
_TOGETHER = 6.0
"""Sides of a block; errors of readings that were left out together may hold together so far."""


@dataclass(frozen=True, slots=True, eq=False)
class _Rough:
    """The factor that follows the roughness."""

    roughness: Roughness
    usual: float
    """r0²."""
    log_factor: float
    power: float
    least: float

    def at(self, places: Array, without: Integers | None = None) -> Array:
        ratio = self.roughness.at(places, without) / self.usual
        return np.asarray(np.exp(self.log_factor) * (self.least + ratio) ** self.power)


@dataclass(frozen=True, slots=True, eq=False)
class _Smooth:
    """What is left, place by place."""

    centre: Array
    """(B, 2) m, blocks."""
    ratio: Array
    """(B,)"""
    part: Integers
    """(B,)"""
    side: float
    """Of a block, m."""
    width: float
    """1-sigma of the weights, m."""
    count: float
    """n; infinite = no place differs from another."""

    def at(self, places: Array, without: Integers | None = None) -> Array:
        if not math.isfinite(self.count):
            return np.ones(len(places))
        out = np.empty(len(places))
        for first in range(0, len(places), 4096):
            rows = slice(first, first + 4096)
            square = square_distances(places[rows], self.centre)
            together = None if without is None else self.together(places[rows], without[rows])
            weight = _weights(square, self.width, together)
            out[rows] = (self.count + weight @ self.ratio) / (self.count + weight.sum(axis=1))
        return out

    def together(self, places: Array, part: Integers) -> Booleans:
        """Return (P, B) whether blocks were left out with places and lie next to them."""
        near = square_distances(places, self.centre) < (_TOGETHER * self.side) ** 2
        return np.asarray((part[:, None] == self.part) & near)


@dataclass(frozen=True, slots=True, eq=False)
class Amplitude:
    """Factor of the variance, place by place."""

    rough: _Rough
    smooth: _Smooth

    @classmethod
    def learnt(
        cls,
        places: Array,
        value: Array,
        left_out: tuple[Integers, Integers],
        errors: Array,
        length: float,
    ) -> "Amplitude":
        """Learn the factor.

        Parameters
        ----------
        places, value : (N, 2+) m, (N,)
            Of all readings.
        left_out : (M,), (N,)
            Rows of those that were left out; and the part (N,) of the survey that each reading
            was left out with.
        errors : (3, M)
            Their errors, squared; the variances expected of the field, and of readings' noise.
        length : float
            m, over which the field changes.
        """
        local = local_variance(places, value)
        rows, part = left_out
        there, own = places[rows], part[rows]
        choices = [
            _fitted_rough(Roughness.of(places, local, part, width * length), there, own, errors)
            for width in _SMOOTHING
        ]
        rough = min(choices, key=lambda choice: choice[1])[0]
        square, field, noise = errors
        ratio = square / (field * rough.at(there, own) + noise)
        smooth = _fitted_smooth(there, ratio, own, length)
        factor = rough.at(there, own) * smooth.at(there, own)
        low, high = -10.0, 10.0
        for _ in range(50):
            middle = 0.5 * (low + high)
            more = np.mean(square / (field * factor * math.exp(middle) + noise)) > 1.0
            low, high = (middle, high) if more else (low, middle)
        return cls(replace(rough, log_factor=rough.log_factor + low), smooth)

    def at(self, places: Array, without: Integers | None = None) -> Array:
        """Return (P,) the factor of the variance at places (P, 2+), each as if the readings of
        some part (P,) had been left out."""
        return self.rough.at(places, without) * self.smooth.at(places, without)

    def describe(self) -> dict[str, float]:
        """Return the parameters for a report."""
        return {
            "roughness_width_m": self.rough.roughness.width,
            "roughness_power": self.rough.power,
            "smoothing_width_m": self.smooth.width if math.isfinite(self.smooth.count) else 0.0,
        }


def _fitted_rough(
    roughness: Roughness, there: Array, part: Integers, errors: Array
) -> tuple[_Rough, float]:
    """Return the most likely factor with one smoothing, and minus its mean log-likelihood."""
    from scipy.optimize import minimize

    square, field, noise = errors
    rough = roughness.at(there, part)
    usual = float(np.median(rough)) or 1.0

    def cost(p: Array) -> float:
        factor = np.exp(np.clip(p[0], -20, 20)) * (np.exp(p[2]) + rough / usual) ** p[1]
        variance = field * factor + noise
        prior = 0.5 * ((p[1] - 0.5) ** 2 + (p[2] / 2.0) ** 2) / 100.0
        return 0.5 * float(np.mean(np.log(variance) + square / variance)) + prior

    found = minimize(
        cost,
        [0.0, 0.5, -1.0],
        method="L-BFGS-B",
        bounds=[(-10.0, 10.0), (0.0, 1.5), (-5.0, 3.0)],
    )
    log_factor, power, least = found.x
    return _Rough(roughness, usual, log_factor, power, math.exp(least)), float(found.fun)


def _fitted_smooth(places: Array, ratio: Array, part: Integers, side: float) -> _Smooth:
    """Return the smoothed ratio of squared errors to their variances (M,) that predicts each block
    best from the others."""
    while True:
        centre, block, _, part_of = block_means(places, ratio, part, side)
        if len(block) <= _MOST_BLOCKS:
            break
        side *= 1.25
    best = _Smooth(centre, block, part_of, side, side, math.inf)
    least = 0.5 * float(block.mean())
    square, together = square_distances(centre, centre), best.together(centre, part_of)
    for width in side * np.array(_WIDTHS):
        weight = _weights(square, width, together)
        near, total = weight @ block, weight.sum(axis=1)
        for own in _COUNTS:
            there = (own + near) / (own + total)
            cost = 0.5 * float(np.mean(np.log(there) + block / there))
            if cost < least:
                best, least = replace(best, width=float(width), count=own), cost
    return best


def _weights(square: Array, width: float, together: Booleans | None) -> Array:
    """Return (P, B) weights of blocks at places whose squared distances to them are given."""
    weight = np.exp(-0.5 * square / width**2)
    if together is not None:
        weight[together] = 0.0
    return np.asarray(weight)


def square_distances(here: Array, there: Array) -> Array:
    """Return (N, M) m² between places (N, 2+) and (M, 2+)."""
    square = (here[:, 0, None] - there[:, 0]) ** 2
    return np.asarray(square + (here[:, 1, None] - there[:, 1]) ** 2)
