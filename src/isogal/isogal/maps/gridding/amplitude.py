"""How much more, or less, a map is wrong in some places than the covariance says.

Readings that were left out show it: their squared errors over the variance v that was expected of
them. It is described in two steps. First it follows the roughness r² of the field around, the
variance of readings about the plane through their neighbours, smoothed, and the share of the
field's own variance s² that is left between readings,

    a²(x) = c (d + r²(x) / r0²)^b (v(x) / s²)^g,

with c, b, d, g and the width of the smoothing that make the errors most likely. Then what is left
is averaged in blocks, and the averages q smoothed with Gaussian weights about each place,

    a²(x) -> a²(x) (n + Σ w q) / (n + Σ w),

with the width of the weights and the n, how many blocks 1 counts for, with which each block is
predicted best from the others (not from those next to it that were left out with it, as errors
hold together). Last, c is such that the mean squared normalised error of readings is 1 with all
parameters learnt from other lines (or blocks): those learnt from a reading itself fit it too well.
Variances of the field's errors are multiplied by a²; the noise of readings is not."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.groups import Groups
from isogal.maps.gridding.survey import blocks_of
from isogal.maps.gridding.validation import LeftOut, folds

_NEIGHBOURS = 16
_NEAR_BLOCKS = 60
"""Blocks next to a place that the roughness is smoothed over."""
_SMOOTHING = (0.5, 1.0, 2.0, 4.0)
"""Widths over which the roughness is smoothed, in lengths."""
_WIDTHS = (1.0, 1.5, 2.5, 4.0, 6.0, 10.0)
"""In sides of a block."""
_COUNTS = (4.0, 8.0, 16.0, 64.0)
_MOST_BLOCKS = 1500
_GAIN = 3.0
"""Of the log-likelihood, that smoothing must bring."""
_LEAST_SHARE = 1e-6
"""Of the field's variance, of what is left between readings."""
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


Factor = Callable[[Array, Array, Integers | None], Array]
"""Gives the factor of the variance (P,) at places (P, 2+), where a share (P,) of the field's
variance is left between readings; each as if the readings of some part (P,) had been left out."""
_Learner = Callable[[Array, LeftOut], Factor]
"""Learns a factor from errors whose roughness (M,) is known."""


def learn_amplitude(places: Array, value: Array, errors: LeftOut) -> tuple[Factor, Array]:
    """Learn the factor; return also that of each error (M,) as it is learnt without the lines (or
    blocks) of a set that the error is of.

    Parameters
    ----------
    places, value : (N, 2+) m, (N,)
        Of all readings.
    errors : LeftOut
    """
    local, tried = _local_variance(places, value), []
    for width in (times * errors.length for times in _SMOOTHING):
        blocks = _Blocks.of(places, local, errors.parts, 0.5 * width)
        rough = partial(_roughness, blocks, width)
        tried.append((rough, rough(errors.places, errors.part)))
    rough, known = min(tried, key=lambda one: _validated(one[1], errors))

    def unscaled(roughness: Array, errors: LeftOut) -> Factor:
        of_rough = _fitted_rough(roughness, errors)
        ratio = errors.scaled(of_rough(roughness, errors.share)).ratio
        of_rest = _fitted_smooth(errors.places, ratio, errors.part, errors.length)
        return lambda places, share, without: (
            of_rough(rough(places, without), share) * of_rest(places, without)
        )

    def scaled(roughness: Array, errors: LeftOut) -> Factor:
        factor, apart = _by_others(unscaled, roughness, errors)
        scale = math.exp(errors.scale(apart))
        return lambda places, share, without: scale * factor(places, share, without)

    return _by_others(scaled, known, errors)


def _by_others(learner: _Learner, roughness: Array, errors: LeftOut) -> tuple[Factor, Array]:
    """Return the factor learnt from errors, and that of each (M,) as it is learnt from the other
    sets of lines (or blocks)."""
    factor = learner(roughness, errors)
    apart = factor(errors.places, errors.share, errors.part)
    for out in folds(errors.part):
        others, own = learner(roughness[~out], errors[~out]), errors[out]
        apart[out] = others(own.places, own.share, own.part)
    return factor, apart


def _validated(roughness: Array, errors: LeftOut) -> float:
    """Return minus the mean log-likelihood of errors, each set of parts by what is learnt from
    the others."""
    factor = np.ones(len(roughness))
    for out in folds(errors.part):
        fitted = _fitted_rough(roughness[~out], errors[~out])
        factor[out] = fitted(roughness[out], errors.share[out])
    return errors.cost(factor)


def _roughness(
    blocks: _Blocks, width: float, places: Array, without: Integers | None = None
) -> Array:
    """Return (P,) r² at places (P, 2+), each without the readings of some part (P,).

    Parameters
    ----------
    blocks : _Blocks
        Variances about local planes (`_local_variance`).
    width : float
        1-sigma of the Gaussian weights that these are smoothed with, m.
    places, without
    """
    from scipy.spatial import cKDTree

    tree, most = cKDTree(blocks.centre), min(_NEAR_BLOCKS, len(blocks.count))
    out = np.empty(len(places))
    for rows in _pieces(len(places), 20_000):
        distance, near = (one.reshape(-1, most) for one in tree.query(places[rows, :2], most))
        if without is not None:
            distance = np.where(blocks.part[near] == without[rows, None], np.inf, distance)
        nearest = distance.min(axis=1, keepdims=True)
        nearest[~np.isfinite(nearest)] = 0.0
        # relative to the nearest block, so that places far from all have a value as well
        weight = np.exp(-0.5 * (distance**2 - nearest**2) / width**2)
        weight = blocks.count[near] * weight + 1e-12
        out[rows] = (weight * blocks.value[near]).sum(axis=1) / weight.sum(axis=1)
    return out


def _fitted_rough(roughness: Array, errors: LeftOut) -> Callable[[Array, Array], Array]:
    """Return what gives the most likely factor (P,) from r² (P,) and the share (P,) that is left
    between readings, by errors of which r² (M,) is known."""
    from scipy.optimize import minimize

    usual = float(np.median(roughness)) or 1.0
    ratio = roughness / usual
    log_share = np.log(np.maximum(errors.share, _LEAST_SHARE))
    # 1-sigmas of the prior, which counts as one error of as many as are independent
    independent = len(Groups.by(blocks_of(errors.places, errors.length), errors.part).first)
    width = math.sqrt(independent) * np.array([2.0, 0.4, 2.0, 0.3])
    middle = np.array([0.0, 0.5, 0.0, 0.0])

    def cost(p: Array) -> tuple[float, Array]:
        least = math.exp(p[2])
        log_rough = np.log(least + ratio)
        factor = np.exp(np.clip(p[0] + p[1] * log_rough + p[3] * log_share, -30.0, 30.0))
        own = errors.field * factor
        variance = own + errors.noise
        total = 0.5 * float(np.mean(np.log(variance) + errors.error**2 / variance))
        slope = 0.5 * (1.0 - errors.error**2 / variance) * own / variance
        by = (1.0, log_rough, p[1] * least / (least + ratio), log_share)
        slopes = np.array([float(np.mean(slope * one)) for one in by])
        off = (p - middle) / width
        return total + 0.5 * float(off @ off), slopes + off / width

    found = minimize(
        cost,
        [0.0, 0.5, -1.0, 0.0],
        jac=True,
        method="L-BFGS-B",
        bounds=[(-10.0, 10.0), (0.0, 1.5), (-5.0, 3.0), (-0.7, 0.7)],
    )
    log_factor, power, log_least, share_power = found.x.tolist()

    def factor(roughness: Array, share: Array) -> Array:
        log_share = np.log(np.maximum(share, _LEAST_SHARE))
        of_rough = log_factor + power * np.log(math.exp(log_least) + roughness / usual)
        return np.asarray(np.exp(np.clip(of_rough + share_power * log_share, -30.0, 30.0)))

    return factor


def _fitted_smooth(
    places: Array, ratio: Array, part: Integers, side: float
) -> Callable[[Array, Integers | None], Array]:
    """Return what gives the smoothed ratio of squared errors to their variances (M,) at places
    (P, 2+), each without the readings of some part (P,): with the weights that predict each block
    best from the others."""
    while len((blocks := _Blocks.of(places, ratio, part, side)).value) > _MOST_BLOCKS:
        side *= 1.25

    def together(square: Array, part: Integers) -> Booleans:
        """Return (P, B) whether blocks were left out with places of a part (P,), and lie next to
        them by their squared distance (P, B)."""
        near = square < (_TOGETHER * side) ** 2
        return np.asarray((part[:, None] == blocks.part) & near)

    best, value = (side, math.inf), blocks.value
    # not by chance alone
    least = 0.5 * float(value.mean()) - _GAIN / len(value)
    square = _square_distances(blocks.centre, blocks.centre)
    apart = ~together(square, blocks.part)
    for width in (side * np.array(_WIDTHS)).tolist():
        weight = np.where(apart, np.exp(-0.5 * square / width**2), 0.0)
        near, total = weight @ value, weight.sum(axis=1)
        for count in _COUNTS:
            there = (count + near) / (count + total)
            cost = 0.5 * float(np.mean(np.log(there) + value / there))
            if cost < least:
                best, least = (width, count), cost
    width, count = best

    def smoothed(places: Array, without: Integers | None) -> Array:
        out = np.ones(len(places))
        if not math.isfinite(count):  # no place differs from another
            return out
        for rows in _pieces(len(places), 4096):
            square = _square_distances(places[rows], blocks.centre)
            weight = np.exp(-0.5 * square / width**2)
            if without is not None:
                weight[together(square, without[rows])] = 0.0
            out[rows] = (count + weight @ value) / (count + weight.sum(axis=1))
        return out

    return smoothed


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
