"""From weighted samples to Gaussians: one for each separate mode, or several for one mode that is
not Gaussian (docs/mathematics.md, sections 6.4 and 6.8).
"""

import math

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.matching.pmht.constants import CONSTANTS
from isogal.matching.pmht.gaussian_mixture import Mixture
from isogal.matrices import eigen

SEPARATION = CONSTANTS.mode_separation  # kernels take constants of their module
CUT_EFFECTIVE = CONSTANTS.cut_effective_samples


def fit(x: Array, weight: Array, most: int, floor: Array) -> tuple[Mixture, Integers]:
    """Split weighted samples into well separated groups and return a Gaussian for each, heaviest
    first, and the samples' groups.

    Parameters
    ----------
    x : (S, n) array
        The first two coordinates (position) decide what is separate.
    weight : (S,) array
        Sums to 1.
    most : int
        Groups at most.
    floor : (n,) array
        Smallest 1-sigma of a Gaussian.
    """
    labels = _split(x, weight, most)
    means, covariances, weights = [], [], []
    for group in range(labels.max() + 1):
        total, mean, covariance, effective = _moments(x, weight, np.flatnonzero(labels == group))
        # unbiased, and on the safe side where samples are few
        few = 1.0 + 1.0 / effective + 100.0 / effective**2
        means.append(mean)
        covariances.append(covariance * few + np.diag(floor**2))
        weights.append(total)
    order = np.argsort(-np.array(weights), kind="stable")
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    mixture = Mixture(
        np.array(weights)[order], np.array(means)[order], np.array(covariances)[order]
    )
    return mixture, rank[labels]


def pieces(x: Array, weight: Array, scale: Array, cuts: int) -> Mixture:
    """Describe samples by up to 2**cuts Gaussians: cut in halves of equal weight across the
    longest axis, and these again.

    Parameters
    ----------
    x, weight : (S, n), (S,) arrays
    scale : (n,) array
        Unit of each coordinate, in which axes are compared; a piece is at least a thousandth of it
        wide.
    cuts : int
        Times; a piece whose samples would be too few is not cut.
    """
    total, mean, covariance = _pieces(x, weight, x / scale, cuts)
    return Mixture(total / total.sum(), mean, covariance + np.diag((1e-3 * scale) ** 2))


def moments(x: Array, weight: Array) -> tuple[Array, Array]:
    """Return mean (n,) and covariance (n, n) of weighted samples (S, n), (S,)."""
    _, mean, covariance, _ = _moments(x, weight, np.arange(len(x)))
    return mean, covariance


@kernel
def _moments(x, weight, part):  # type: ignore[no-untyped-def]
    """Return total weight, mean (n,), covariance (n, n) and effective number of some samples."""
    n = x.shape[1]
    total = square = 0.0
    mean, covariance = np.zeros(n), np.zeros((n, n))
    for s in part:
        total += weight[s]
        square += weight[s] * weight[s]
        for i in range(n):
            mean[i] += weight[s] * x[s, i]
    for i in range(n):
        mean[i] /= total
    for s in part:
        for i in range(n):
            off = weight[s] * (x[s, i] - mean[i])
            for j in range(i + 1):
                covariance[i, j] += off * (x[s, j] - mean[j])
    for i in range(n):
        for j in range(i + 1):
            covariance[i, j] /= total
            covariance[j, i] = covariance[i, j]
    return total, mean, covariance, total * total / square


@kernel
def _pieces(x, weight, unit, cuts):  # type: ignore[no-untyped-def]
    """Return weights (P,), means (P, n) and covariances (P, n, n) of `pieces`; `unit` are the
    samples in the units in which axes are compared."""
    members = np.flatnonzero(weight > 0.0)
    ends = np.zeros(2**cuts + 1, np.int64)  # of the pieces, in `members`
    ends[1] = members.shape[0]
    count = 1
    along = np.empty(x.shape[0])
    for _ in range(cuts):
        for piece in range(count - 1, -1, -1):
            part = members[ends[piece] : ends[piece + 1]]
            total, mean, covariance, effective = _moments(unit, weight, part)
            if effective < CUT_EFFECTIVE:
                continue
            _, vectors = eigen(covariance)
            longest = 0.0
            for i in range(mean.shape[0]):
                if abs(vectors[i, -1]) > abs(longest):
                    longest = vectors[i, -1]
            for s in part:
                along[s] = 0.0
                for i in range(mean.shape[0]):
                    along[s] += (unit[s, i] - mean[i]) * vectors[i, -1]
                if longest < 0.0:  # the axis either way is the same
                    along[s] = -along[s]
            below = _halve(along, weight, part, 0.5 * total)
            if below < part.shape[0]:
                for later in range(count, piece, -1):
                    ends[later + 1] = ends[later]
                ends[piece + 1] = ends[piece] + below
                count += 1
    n = x.shape[1]
    weights, means, covariances = np.empty(count), np.empty((count, n)), np.empty((count, n, n))
    for piece in range(count):
        part = members[ends[piece] : ends[piece + 1]]
        weights[piece], mean, covariance, _ = _moments(x, weight, part)
        for i in range(n):  # a slice would take seconds to compile
            means[piece, i] = mean[i]
            for j in range(n):
                covariances[piece, i, j] = covariance[i, j]
    return weights, means, covariances


@kernel
def _halve(along, weight, part, half):  # type: ignore[no-untyped-def]
    """Put the indices `part` of the least of some numbers first, as few as weigh a half, and
    return how many they are: partitions about a pivot (Hoare 1961, Comm. ACM 4:321)."""
    first, last, below = 0, part.shape[0], 0.0
    while last - first > 1:
        pivot = along[part[(first + last) // 2]]
        i, j, more = first, last - 1, 0.0
        while i <= j:
            while along[part[i]] < pivot:
                i += 1
            while along[part[j]] > pivot:
                j -= 1
            if i <= j:
                part[i], part[j] = part[j], part[i]
                i += 1
                j -= 1
        for k in range(first, i):
            more += weight[part[k]]
        if i == last:  # the pivot was the largest, and is the last now
            i -= 1
            more -= weight[part[i]]
        if below + more >= half:
            last = i
        else:
            below += more
            first = i
    return last


@kernel
def _split(x, weight, most):  # type: ignore[no-untyped-def]
    """Return the group of each sample: groups are cut in two, best separated cut first, until none
    is well separated.
    """
    samples = x.shape[0]
    labels = np.zeros(samples, np.int64)
    groups = 1
    cut = np.zeros(most, np.bool_)  # groups known not to split
    while groups < most:
        best, chosen = SEPARATION, -1
        side = np.zeros(samples, np.bool_)
        for g in range(groups):
            if cut[g]:
                continue
            separation, candidate = _best_cut(x, weight, labels, g)
            if separation <= SEPARATION:
                cut[g] = True
            elif separation > best:
                best, chosen, side = separation, g, candidate
        if chosen < 0:
            break
        for s in range(samples):
            if side[s]:
                labels[s] = groups
        groups += 1
    return labels


@kernel
def _best_cut(x, weight, labels, group):  # type: ignore[no-untyped-def]
    """Return the separation of the best two-way cut of one group along its principal axes, and
    which samples it cuts off.

    Along an axis the cut is Otsu's: the one with the largest variance between the sides. Where
    neither axis separates anything, the diagonals between them are tried, by two-means: four
    places at the corners of a square overlap when seen along a diagonal.
    """
    members = np.flatnonzero((labels == group) & (weight > 0.0))
    side = np.zeros(labels.shape[0], np.bool_)
    total = 0.0
    mean = np.zeros(2)
    for s in members:
        total += weight[s]
        mean[0] += weight[s] * x[s, 0]
        mean[1] += weight[s] * x[s, 1]
    if members.shape[0] < 16 or total <= 0.0:
        return 0.0, side
    mean /= total
    a = b = c = 0.0
    for s in members:
        u, v = x[s, 0] - mean[0], x[s, 1] - mean[1]
        a += weight[s] * u * u
        b += weight[s] * u * v
        c += weight[s] * v * v
    angle = 0.5 * math.atan2(2.0 * b, a - c)
    best = 0.0
    for axis in range(2):
        cx, cy = math.cos(angle + axis * 0.5 * math.pi), math.sin(angle + axis * 0.5 * math.pi)
        along = np.empty(members.shape[0])
        for i in range(members.shape[0]):
            along[i] = (x[members[i], 0] - mean[0]) * cx + (x[members[i], 1] - mean[1]) * cy
        order = np.argsort(along)
        separation, count = _otsu(along[order], weight[members[order]], total)
        if separation > best:
            best = separation
            side[:] = False
            for i in range(count):
                side[members[order[i]]] = True
    if best <= SEPARATION:
        for axis in range(2):
            turn = angle + (0.25 + 0.5 * axis) * math.pi
            cx, cy = math.cos(turn), math.sin(turn)
            threshold = mean[0] * cx + mean[1] * cy
            separation = 0.0
            for _ in range(5):
                separation, threshold = _two_means(x, weight, members, cx, cy, threshold)
            if separation > best:
                best = separation
                side[:] = False
                for s in members:
                    side[s] = x[s, 0] * cx + x[s, 1] * cy < threshold
    return best, side


@kernel
def _otsu(along, weight, total):  # type: ignore[no-untyped-def]
    """Return the separation of the best cut of sorted numbers (m,) with the mean 0, and how many
    lie before it; 0, 0 where there is none. `total` of the weights (m,)."""
    all_square = 0.0
    for i in range(along.shape[0]):
        all_square += weight[i] * along[i] * along[i]
    w1 = s1 = q1 = 0.0
    between, count, separation = -1.0, 0, 0.0
    for i in range(along.shape[0] - 1):
        w1 += weight[i]
        s1 += weight[i] * along[i]
        q1 += weight[i] * along[i] * along[i]
        w2 = total - w1
        if w1 < 1e-4 * total or w2 < 1e-4 * total:
            continue
        m1, m2 = s1 / w1, -s1 / w2
        spread = w1 * w2 * (m1 - m2) ** 2
        if spread > between:
            between, count = spread, i + 1
            v1 = max(q1 / w1 - m1 * m1, 0.0)
            v2 = max((all_square - q1) / w2 - m2 * m2, 0.0)
            separation = math.sqrt(2.0) * abs(m1 - m2) / math.sqrt(v1 + v2 + 1e-12)
    return separation, count


@kernel
def _two_means(x, weight, members, cx, cy, threshold):  # type: ignore[no-untyped-def]
    """Return separation and middle of the means on both sides of a threshold along an axis (Ridler
    & Calvard 1978, iterated).
    """
    w1 = s1 = q1 = w2 = s2 = q2 = 0.0
    for s in members:
        value = x[s, 0] * cx + x[s, 1] * cy
        if value < threshold:
            w1 += weight[s]
            s1 += weight[s] * value
            q1 += weight[s] * value * value
        else:
            w2 += weight[s]
            s2 += weight[s] * value
            q2 += weight[s] * value * value
    if w1 <= 1e-4 * (w1 + w2) or w2 <= 1e-4 * (w1 + w2):
        return 0.0, threshold
    m1, m2 = s1 / w1, s2 / w2
    spread = max(q1 / w1 - m1 * m1, 0.0) + max(q2 / w2 - m2 * m2, 0.0)
    return math.sqrt(2.0) * (m2 - m1) / math.sqrt(spread + 1e-12), 0.5 * (m1 + m2)
