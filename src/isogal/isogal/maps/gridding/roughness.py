"""How rough a field is round a place: the variance of readings about the plane through their
neighbours, smoothed."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers

_NEIGHBOURS = 16
_BLOCKS = 60
"""Blocks next to a place that are smoothed over."""


@dataclass(frozen=True, slots=True, eq=False)
class Roughness:
    """Variance in blocks."""

    centre: Array
    """(B, 2) m."""
    variance: Array
    """(B,)"""
    count: Array
    """(B,) readings."""
    part: Integers
    """(B,) line or set of blocks that the readings are left out with."""
    width: float
    """1-sigma of the Gaussian weights, m."""

    @classmethod
    def of(cls, places: Array, variance: Array, part: Integers, width: float) -> "Roughness":
        """Average variances about local planes (`local_variance`) in blocks of half a width."""
        return cls(*block_means(places, variance, part, 0.5 * width), width)

    def at(self, places: Array, without: Integers | None = None) -> Array:
        """Return (P,) the smoothed variance at places (P, 2+), each without the readings of some
        part (P,)."""
        from scipy.spatial import cKDTree

        tree, most = cKDTree(self.centre), min(_BLOCKS, len(self.count))
        out = np.empty(len(places))
        for first in range(0, len(places), 20_000):
            part = slice(first, first + 20_000)
            distance, near = tree.query(places[part, :2], most)
            distance, near = distance.reshape(-1, most), near.reshape(-1, most)
            if without is not None:
                distance = np.where(self.part[near] == without[part, None], np.inf, distance)
            first_one = distance.min(axis=1, keepdims=True)
            first_one[~np.isfinite(first_one)] = 0.0
            # relative to the nearest block, so that places far from all have a value as well
            weight = np.exp(-0.5 * (distance**2 - first_one**2) / self.width**2)
            weight = self.count[near] * weight + 1e-12
            out[part] = (weight * self.variance[near]).sum(axis=1) / weight.sum(axis=1)
        return out


def local_variance(places: Array, value: Array) -> Array:
    """Return (N,) the mean squared distance of each reading's neighbours from the plane through
    them."""
    from scipy.spatial import cKDTree

    most = min(_NEIGHBOURS, len(value))
    tree = cKDTree(places[:, :2])
    out = np.empty(len(value))
    for first in range(0, len(value), 20_000):
        part = slice(first, first + 20_000)
        distance, near = tree.query(places[part, :2], most)
        scale = distance.mean(axis=1)[:, None] + 1e-9
        apart = (places[near, :2] - places[part, None, :2]) / scale[..., None]
        basis = np.concatenate([np.ones((*apart.shape[:2], 1)), apart], axis=2)
        # neighbours on one line leave the slope across it open: a little ridge
        normal = np.einsum("nki,nkj->nij", basis, basis) + 1e-3 * np.eye(3)
        right = np.einsum("nki,nk->ni", basis, value[near])
        plane = np.linalg.solve(normal, right[..., None])[..., 0]
        left = value[near] - np.einsum("nki,ni->nk", basis, plane)
        out[part] = (left**2).mean(axis=1)
    return out


def block_means(
    places: Array, value: Array, part: Integers, side: float
) -> tuple[Array, Array, Array, Integers]:
    """Return centres (B, 2), mean values, numbers and parts (B,) of the readings in each square
    block of the plane and each part in it."""
    cell = np.floor((places[:, :2] - places[:, :2].min(axis=0)) / side).astype(np.int64)
    _, first, group = np.unique(
        np.column_stack([cell, part]), axis=0, return_index=True, return_inverse=True
    )
    group = group.reshape(-1)
    count = np.bincount(group).astype(np.float64)
    centre = np.stack([np.bincount(group, places[:, k]) / count for k in (0, 1)], axis=1)
    return centre, np.bincount(group, value) / count, count, part[first]
