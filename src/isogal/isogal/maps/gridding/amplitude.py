"""How much more, or less, a map is wrong in some places than the covariance says.

Readings that were left out show it: their squared errors over the variance that was expected of
them. It is described in two steps. First it follows the roughness r² of the field around, the
variance of readings about the plane through their neighbours, smoothed,

    a²(x) = c (d + r²(x) / r0²)^b,

with c, b, d and the width of the smoothing that make the errors most likely. Then what is left is
averaged in blocks, and the averages q smoothed with Gaussian weights about each place,

    a²(x) -> a²(x) (n + Σ w q) / (n + Σ w),

with the width of the weights and the n, how many blocks 1 counts for, with which each block is
predicted best from the others (not from those next to it that were left out with it, as errors
hold together). Last, c is such that the mean squared normalised error is 1. Variances of the
field's errors are multiplied by a²; the noise of readings is not."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.maps.gridding.survey import Groups, blocks_of

_NEIGHBOURS = 16
_NEAR_BLOCKS = 60
"""Blocks next to a place that the roughness is smoothed over."""
_SMOOTHING = (0.5, 1.0, 2.0, 4.0)
"""Widths over which the roughness is smoothed, in lengths."""
_WIDTHS = (1.0, 1.5, 2.5, 4.0, 6.0, 10.0)
"""In sides of a block."""
_COUNTS = (2.0, 4.0, 8.0, 16.0, 64.0)
_MOST_BLOCKS = 2500
_TOGETHER = 6.0
"""Sides of a block; errors of readings that were left out together may hold together so far."""


@dataclass(frozen=True, slots=True, eq=False)
class _Blocks:
    """Means of values in square blocks, by the part of the survey that readings were left out
    with."""

    centre: Array
    """(B, 2) m."""
    value: Array
    """(B,)"""
    count: Array
    """(B,) readings."""
    part: Integers
    """(B,)"""

    @classmethod
    def of(cls, places: Array, value: Array, part: Integers, side: float) -> "_Blocks":
        """Average values (N,) at places (N, 2+), each of a part (N,), in blocks of a side (m)."""
        groups = Groups.by(blocks_of(places, side), part)
        centre = np.stack([groups.mean(places[:, k]) for k in (0, 1)], axis=1)
        return cls(centre, groups.mean(value), groups.count, part[groups.first])


@dataclass(frozen=True, slots=True, eq=False)
class _Rough:
    """The factor that follows the roughness."""

    blocks: _Blocks
    """Variances about local planes (`_local_variance`)."""
    width: float
    """1-sigma of the Gaussian weights that these are smoothed with, m."""
    usual: float = 1.0
    """r0²."""
    log_factor: float = 0.0
    power: float = 1.0
    least: float = 0.0

    def roughness(self, places: Array, without: Integers | None = None) -> Array:
        """Return (P,) r² at places (P, 2+), each without the readings of some part (P,)."""
        from scipy.spatial import cKDTree

        blocks = self.blocks
        tree, most = cKDTree(blocks.centre), min(_NEAR_BLOCKS, len(blocks.count))
        out = np.empty(len(places))
        for rows in _pieces(len(places), 20_000):
            distance, near = (one.reshape(-1, most) for one in tree.query(places[rows, :2], most))
            if without is not None:
                distance = np.where(blocks.part[near] == without[rows, None], np.inf, distance)
            nearest = distance.min(axis=1, keepdims=True)
            nearest[~np.isfinite(nearest)] = 0.0
            # relative to the nearest block, so that places far from all have a value as well
            weight = np.exp(-0.5 * (distance**2 - nearest**2) / self.width**2)
            weight = blocks.count[near] * weight + 1e-12
            out[rows] = (weight * blocks.value[near]).sum(axis=1) / weight.sum(axis=1)
        return out

    def at(self, places: Array, without: Integers | None = None) -> Array:
        """Return (P,) the factor of the variance, as `Amplitude.at` does."""
        ratio = self.roughness(places, without) / self.usual
        return np.asarray(np.exp(self.log_factor) * (self.least + ratio) ** self.power)


@dataclass(frozen=True, slots=True, eq=False)
class _Smooth:
    """What is left, place by place."""

    blocks: _Blocks
    """Squared errors over the variances that were expected."""
    side: float
    """Of a block, m."""
    width: float
    """1-sigma of the weights, m."""
    count: float = math.inf
    """n; infinite = no place differs from another."""

    def at(self, places: Array, without: Integers | None = None) -> Array:
        """Return (P,) the factor of the variance, as `Amplitude.at` does."""
        out = np.ones(len(places))
        if not math.isfinite(self.count):
            return out
        for rows in _pieces(len(places), 4096):
            square = _square_distances(places[rows], self.blocks.centre)
            weight = np.exp(-0.5 * square / self.width**2)
            if without is not None:
                weight[self.together(square, without[rows])] = 0.0
            total = self.count + weight.sum(axis=1)
            out[rows] = (self.count + weight @ self.blocks.value) / total
        return out

    def together(self, square: Array, part: Integers) -> Booleans:
        """Return (P, B) whether blocks were left out with places of a part (P,), and lie next to
        them by their squared distance (P, B)."""
        near = square < (_TOGETHER * self.side) ** 2
        return np.asarray((part[:, None] == self.blocks.part) & near)


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
        local = _local_variance(places, value)
        rows, part = left_out
        there, own = places[rows], part[rows]
        choices = []
        for width in (times * length for times in _SMOOTHING):
            blocks = _Blocks.of(places, local, part, 0.5 * width)
            choices.append(_fitted_rough(_Rough(blocks, width), there, own, errors))
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
            "roughness_width_m": self.rough.width,
            "roughness_power": self.rough.power,
            "smoothing_width_m": self.smooth.width if math.isfinite(self.smooth.count) else 0.0,
        }


def _fitted_rough(
    rough: _Rough, there: Array, part: Integers, errors: Array
) -> tuple[_Rough, float]:
    """Return the most likely factor with one smoothing, and minus its mean log-likelihood."""
    from scipy.optimize import minimize

    square, field, noise = errors
    roughness = rough.roughness(there, part)
    usual = float(np.median(roughness)) or 1.0

    def cost(p: Array) -> float:
        factor = np.exp(np.clip(p[0], -20, 20)) * (np.exp(p[2]) + roughness / usual) ** p[1]
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
    return replace(
        rough, usual=usual, log_factor=log_factor, power=power, least=math.exp(least)
    ), float(found.fun)


def _fitted_smooth(places: Array, ratio: Array, part: Integers, side: float) -> _Smooth:
    """Return the smoothed ratio of squared errors to their variances (M,) that predicts each block
    best from the others."""
    while len((blocks := _Blocks.of(places, ratio, part, side)).value) > _MOST_BLOCKS:
        side *= 1.25
    best, block = _Smooth(blocks, side, side), blocks.value
    least = 0.5 * float(block.mean())
    square = _square_distances(blocks.centre, blocks.centre)
    together = best.together(square, blocks.part)
    for width in side * np.array(_WIDTHS):
        weight = np.where(together, 0.0, np.exp(-0.5 * square / width**2))
        near, total = weight @ block, weight.sum(axis=1)
        for own in _COUNTS:
            there = (own + near) / (own + total)
            cost = 0.5 * float(np.mean(np.log(there) + block / there))
            if cost < least:
                best, least = replace(best, width=float(width), count=own), cost
    return best


def _local_variance(places: Array, value: Array) -> Array:
    """Return (N,) the mean squared distance of each reading's neighbours from the plane through
    them."""
    from scipy.spatial import cKDTree

    most = min(_NEIGHBOURS, len(value))
    tree = cKDTree(places[:, :2])
    out = np.empty(len(value))
    for rows in _pieces(len(value), 20_000):
        distance, near = tree.query(places[rows, :2], most)
        scale = distance.mean(axis=1)[:, None] + 1e-9
        apart = (places[near, :2] - places[rows, None, :2]) / scale[..., None]
        basis = np.concatenate([np.ones((*apart.shape[:2], 1)), apart], axis=2)
        # neighbours on one line leave the slope across it open: a little ridge
        normal = np.einsum("nki,nkj->nij", basis, basis) + 1e-3 * np.eye(3)
        right = np.einsum("nki,nk->ni", basis, value[near])
        plane = np.linalg.solve(normal, right[..., None])[..., 0]
        left = value[near] - np.einsum("nki,ni->nk", basis, plane)
        out[rows] = (left**2).mean(axis=1)
    return out


def _square_distances(here: Array, there: Array) -> Array:
    """Return (N, M) m² between places (N, 2+) and (M, 2+)."""
    square = (here[:, 0, None] - there[:, 0]) ** 2
    return np.asarray(square + (here[:, 1, None] - there[:, 1]) ** 2)


def _pieces(count: int, size: int) -> Iterator[slice]:
    """Yield slices of at most so many of some rows, which together are all."""
    return (slice(first, first + size) for first in range(0, count, size))
