"""By how much the fix of a track is less certain than its posterior (docs/mathematics.md, section
10.3).

A gridded map may be displaced (`isogal.maps.displacement`): a state of which nothing is learnt,
with a prior by the models of the map's error.

Of a map that does not say over which lengths its errors hold together, error bars do not rest on
the models alone: the fix is made again without each half of the track. Models are never quite
right: errors of a map differ from place to place, are not Gaussian, and depend on the field. How
far the fix then really moves is seen by leaving out parts of the track. One block at a time (the
usual jackknife) shows how a peak moves, but not whether the peak is the right one: with few left
out the others still outvote the truth. So d = 4 of 8 blocks are left out, in all 70 ways (delete-d
jackknife: Shao & Wu 1989, Ann. Stat. 17(3):1176-1197); with half left out, (8 - d) / d = 1, and
the variance of the fixes is that of the fix itself. Where it exceeds the posterior's covariance
the excess is added. Nothing makes a fix narrower."""

from itertools import combinations

import numpy as np
from scipy.special import logsumexp, softmax

from isogal.arrays import Array
from isogal.maps.displacement import displacement as displaced_by
from isogal.matching.information import relative
from isogal.tracks.evidence import BLOCKS, Seen
from isogal.tracks.places import Shifts

FEWEST = 16
"""Rows; with fewer the blocks are too small to say anything."""


def displacement(shifts: Shifts) -> Array:
    """Return (2, 2) m², the covariance of the shift that displaced maps pass for; of several
    fields, whose maps are displaced independently, by what each says of the place."""
    each = [np.linalg.inv(shifts.covariance_by(one)) for one in shifts.seen]
    whole, total = np.linalg.inv(sum(each)), np.zeros((2, 2))
    for one, own in zip(shifts.seen, each, strict=True):
        if one.gridded:
            sigma = displaced_by(one.length, one.map_sigma**2, one.shown(shifts.likeliest))
            total += (shifts.of_models(one) @ sigma**2) * (whole @ own @ own @ whole)
    return total


def excess(shifts: Shifts) -> Array:
    """Return (2, 2) m², what must be added to the posterior's covariance; of several fields each
    without the halves of its own readings, whose errors are independent."""
    mean, covariance = shifts.moments
    scatter = np.zeros((2, 2))
    for one in shifts.seen:
        if not one.gridded and len(one.white) - one.old_rows >= FEWEST:
            apart = _fixes(shifts, one) - mean
            scatter += apart.T @ apart / len(apart)
    factor, values, vectors = relative(scatter, covariance)
    axes = factor @ vectors
    return np.asarray((axes * np.maximum(values - 1.0, 0.0)) @ axes.T)


def _fixes(shifts: Shifts, one: Seen) -> Array:
    """Return (70, 2) the fixes without halves of a field's readings."""
    own, others = one.by_model, shifts.log_density - one.log_density
    means = []
    for left_out in combinations(np.eye(one.parts.shape[1]), BLOCKS // 2):
        rest = own - sum(left_out) @ one.parts
        means.append(softmax(logsumexp(rest, axis=0) + others) @ shifts.centres)
    return np.array(means)
