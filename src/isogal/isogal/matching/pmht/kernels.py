"""Compiled loops over hypotheses: linearisation, Kalman update, and which are one place.

A hypothesis k has the model ``which[k]`` and a Gaussian of the augmented state: the navigator's
error (7), the map error of each channel in units of its 1-sigma, and the instrument's states
(`rows.States`). A model need not have all of them: its own are ``used[m, :count[m]]``, and loops
go over these only. docs/mathematics.md, section 6.
"""

import math

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.compiled import kernel
from isogal.inertial.error_state import BATCH_STATES
from isogal.maps.interpolation import Grid, bilinear, value_and_gradient
from isogal.matching.pmht.models import Models
from isogal.matching.pmht.rows import Rows

ITERATIONS = 8
"""Linearisations at most; from the fourth on steps are halved, since a step that has not
converged by then swings about the mode."""
SETTLED = 0.1
"""A mode is found where the last step was shorter than this share of its 1-sigma."""
OUTLIER = (0.003, 1000.0)
"""Probability of an outlier, and the variance, in units of the noise's, of the normal density
whose peak is that of outliers."""
SUSPECT = 9.0
"""Normalised innovation squared below which a reading is taken to be no outlier: its probability
to be one is then below 1 %."""
AGES = np.stack(np.polynomial.laguerre.laggauss(12), axis=1)[:6]
AGES /= 1.0, AGES[:, 1].sum()
"""(6, 2) ages, in units of its time constant, and weights of what of the path a first-order
low-pass filter has a mean over: a Gauss-Laguerre rule without the 0.02 % that is older than seven
time constants. With a rule of order 3, at 30 s and 22 m/s, fixes were 100 m off."""


@kernel(error_model="numpy", inline="always")
def predicted(
    grid: Grid, rows: Rows, t: int, north: float, east: float, lag: float
) -> tuple[float, float, float]:
    """Return the map's value and its derivatives to north and east (per m) for row t of a
    navigator that is `north` and `east` (m) of the truth; a mean over the path where the
    instrument's filter is specified or has a time constant `lag` (s)."""
    lat = rows.latitude[t] - north * rows.radian[t, 0]
    lon = rows.longitude[t] - east * rows.radian[t, 1]
    value = by_north = by_east = 0.0
    for q in range(AGES.shape[0] if lag > 0.0 else rows.nodes.shape[1]):
        if lag > 0.0:
            weight, back = AGES[q, 1], AGES[q, 0] * lag
            to_north = -back * rows.velocity[t, 0] * rows.radian[t, 0]
            to_east = -back * rows.velocity[t, 1] * rows.radian[t, 1]
        else:
            to_north, to_east = rows.nodes[t, q, 0], rows.nodes[t, q, 1]
            weight = rows.nodes[t, q, 2]
        v, a, b = value_and_gradient(grid, lat + to_north, lon + to_east, rows.channel[t])
        value += weight * v
        by_north += weight * a
        by_east += weight * b
    return value, by_north * rows.radian[t, 0], by_east * rows.radian[t, 1]


@kernel(error_model="numpy", inline="always")
def _place(rows: Rows, t: int, used: Integers, x: Array, count: int) -> tuple[float, float]:
    """Return how far from the truth (m north and east) a navigator has row t, in a state x (c,) of
    `used` (c,)."""
    north = east = 0.0
    for i in range(count):
        north += rows.place[t, 0, used[i]] * x[i]
        east += rows.place[t, 1, used[i]] * x[i]
    return north, east


@kernel(error_model="numpy", inline="always")
def _larger(sigmas: Grid, rows: Rows, t: int, north: float, east: float) -> float:
    """Return by what factor the map says its error is larger where row t was taken by a navigator
    that is `north` and `east` (m) of the truth than where that believes to be (`Rows.load`);
    `sigmas` as `rows.sigmas_of` has it."""
    if sigmas.values.shape[1] < 2:
        return 1.0
    lat, lon, c = rows.latitude[t], rows.longitude[t], rows.channel[t]
    believed = bilinear(sigmas, lat, lon, c)
    lat, lon = lat - north * rows.radian[t, 0], lon - east * rows.radian[t, 1]
    ratio = bilinear(sigmas, lat, lon, c) / believed
    return ratio if believed > 0.0 and math.isfinite(ratio) else 1.0


@kernel(error_model="numpy")
def departures(
    grid: Grid,
    sigmas: Grid,
    rows: Rows,
    models: Models,
    which: Integers,
    mean: Array,
    covariance: Array,
    asked: Booleans,
    reach: float,
    along: Array,
) -> Array:
    """Return (K,) how far readings depart from linear in where they were taken (of the last row),
    along the worse axis of that, for hypotheses that are asked for, a mask (K,), and write into
    `along` (K, N) how all states move with that axis, 1-sigma, by regression.

    In 1-sigmas of what is new in the readings and, where that is more, in units of their change,
    between both ends of the axis, `reach` 1-sigmas away. Where a model's filter has a time
    constant, of the map at the one point that is older by it."""
    size, last = mean.shape[1], rows.level.shape[0] - 1
    worst, x = np.zeros(which.shape[0]), np.empty(size)
    across, bend, change = np.empty((2, size)), np.empty(2), np.empty(2)
    for k in range(which.shape[0]):
        if not asked[k]:
            continue
        m = which[k]
        c, used, sigma, shape = models.sizes[m], models.used[m], models.sigma[m], models.shape[m]
        p = q = r = 0.0
        for i in range(c):
            x[i] = mean[k, used[i]]
            north = east = 0.0
            for j in range(c):
                north += covariance[k, used[i], used[j]] * rows.place[last, 0, used[j]]
                east += covariance[k, used[i], used[j]] * rows.place[last, 1, used[j]]
            across[0, i], across[1, i] = north, east
            p += rows.place[last, 0, used[i]] * north
            q += rows.place[last, 0, used[i]] * east
            r += rows.place[last, 1, used[i]] * east
        # both axes of the covariance [[p, q], [q, r]] of the place
        angle = 0.5 * math.atan2(2.0 * q, p - r)
        cos, sin = math.cos(angle), math.sin(angle)
        first = math.sqrt(0.5 * (p + r) + math.hypot(0.5 * (p - r), q))
        second = math.sqrt(max(p * r - q * q, 0.0)) / first
        bend[:], change[:] = 0.0, 0.0
        for t in range(last + 1):
            north, east = _place(rows, t, used, x, c)
            R = rows.noise[t] * models.noise[m]
            if sigma > 0.0:
                rough = models.rough[m] > 0.0
                error = sigma * (1.0 if rough else _larger(sigmas, rows, t, north, east))
                for u in range(rows.load.shape[2]):
                    load = error * rows.load[shape, t, u]
                    R += load * load * rows.joined[shape, t, u, u]
            north += models.lag[m] * rows.velocity[t, 0]
            east += models.lag[m] * rows.velocity[t, 1]
            middle = predicted(grid, rows, t, north, east, 0.0)[0]
            for axis in range(2):
                n, e = (first * cos, first * sin) if axis == 0 else (-second * sin, second * cos)
                one = predicted(grid, rows, t, north - reach * n, east - reach * e, 0.0)[0]
                other = predicted(grid, rows, t, north + reach * n, east + reach * e, 0.0)[0]
                bend[axis] += (0.5 * (one + other) - middle) ** 2 / R
                change[axis] += (0.5 * (one - other)) ** 2 / R
        departure = np.sqrt(bend) / np.maximum(np.sqrt(change), 1.0)
        worse = 1 if departure[1] > departure[0] and second > 0.0 else 0
        worst[k] = departure[worse]
        for i in range(c):
            to_first = cos * across[0, i] + sin * across[1, i]
            to_second = cos * across[1, i] - sin * across[0, i]
            along[k, used[i]] = to_first / first if worse == 0 else to_second / second
    return worst


@kernel(error_model="numpy")
def _linearised(
    grid: Grid, rows: Rows, errors: Array, models: Models, m: int, at: Array, z: Array, H: Array
) -> bool:
    """Write z (n,) = H (n, c) x + noise of the rows, with map errors larger by `errors` (n,),
    linearised at a state (c,) of a model; say whether all of them are on the map."""
    n, used, lag, load = BATCH_STATES, models.used[m], models.lag[m], rows.load[models.shape[m]]
    for t in range(rows.level.shape[0]):
        north, east = _place(rows, t, used, at, models.sizes[m])
        value, by_north, by_east = predicted(grid, rows, t, north, east, lag)
        if not math.isfinite(value):
            return False
        z[t] = rows.level[t] - value - lag * rows.rate[t]
        for i in range(models.sizes[m]):
            s = used[i]
            slope = by_north * rows.place[t, 0, s] + by_east * rows.place[t, 1, s]
            H[t, i] = rows.reading[t, s] - slope
            if n <= s < n + load.shape[1]:
                H[t, i] += models.sigma[m] * errors[t] * load[t, s - n]
            z[t] -= slope * at[i]  # z - J x = z - (J - G) x - G x
    return True


@kernel(error_model="numpy")
def _stepped(x: Array, P: Array, step: Array, joined: Array, c: int, work: Array) -> None:
    """Carry the map errors, states 7 and on of c, to the next scan in place: u -> step u, with
    `joined` added to their covariance."""
    n, size = BATCH_STATES, step.shape[0]
    for j in range(c):  # rows of P, then columns, which are the same but among map errors
        for i in range(size):
            work[i] = 0.0
            for k in range(size):
                work[i] += step[i, k] * P[n + k, j]
        for i in range(size):
            P[n + i, j] = work[i]
    for j in range(c):
        among = n <= j < n + size
        for i in range(size):
            work[i] = 0.0 if among else P[n + i, j]
            for k in range(size if among else 0):
                work[i] += step[i, k] * P[j, n + k]
        for i in range(size):
            P[j, n + i] = work[i]
    for i in range(size):
        work[i] = 0.0
        for k in range(size):
            work[i] += step[i, k] * x[n + k]
    for i in range(size):
        x[n + i] = work[i]
        for k in range(size):
            P[n + i, n + k] += joined[i, k]


@kernel(error_model="numpy")
def _filtered(
    rows: Rows, models: Models, m: int, x: Array, P: Array, z: Array, H: Array, PH: Array
) -> float:
    """Kalman filter of readings one after the other, in place; return their log evidence.

    A reading is good or, with a small probability, an outlier, which says nothing and is as likely
    everywhere; the two posteriors are merged by their moments. Where a model's errors have tails,
    innovations have Student's t density instead, and one beyond a 1-sigma counts as if its
    variance were so much larger."""
    wrong, width = OUTLIER
    tails, peak = models.tails[m], 0.0
    if tails < math.inf:
        peak = (
            math.lgamma(0.5 * tails + 0.5) - math.lgamma(0.5 * tails) - 0.5 * math.log(0.5 * tails)
        )
    square, determinant, evidence = 0.0, 1.0, 0.0
    n, c, used, shape = BATCH_STATES, models.sizes[m], models.used[m], models.shape[m]
    map_errors = c > n and used[n] == n
    for t in range(z.shape[0]):
        if map_errors and rows.joined[shape, t, 0, 0] > 0.0:
            _stepped(x, P, rows.step[shape, t], rows.joined[shape, t], c, PH)
        for i in range(n, c):
            f = rows.keep[t, used[i] - n]
            if f != 1.0:
                x[i] *= f
                for j in range(c):
                    P[i, j] *= f
                    P[j, i] *= f
            P[i, i] += rows.fresh[t, used[i] - n]
        noise = rows.noise[t] * models.noise[m]
        S, innovation = noise, z[t]
        for i in range(c):
            value = 0.0
            for j in range(c):
                value += P[i, j] * H[t, j]
            PH[i] = value
            S += H[t, i] * value
            innovation -= H[t, i] * x[i]
        gain = 1.0 / S
        less, fit = gain, innovation * innovation * gain
        if tails < math.inf:
            evidence += peak - 0.5 * (math.log(S) + (tails + 1.0) * math.log1p(fit / tails))
            weight = (tails + 1.0) / (tails + fit)
            less = gain * min(1.0, weight * (tails - fit) / (tails + fit))
            gain *= min(1.0, weight)
        elif fit < SUSPECT:
            square += fit
            determinant *= S
            if not 1e-200 < determinant < 1e200:
                evidence -= 0.5 * math.log(determinant)
                determinant = 1.0
        else:
            good = -0.5 * (math.log(S) + fit) + math.log(1.0 - wrong)
            bad = -0.5 * math.log(S + width * noise) + math.log(wrong)
            both = max(good, bad) + math.log1p(math.exp(-abs(good - bad)))
            evidence += both
            p, q = math.exp(good - both), math.exp(bad - both)
            gain = p / S
            less = gain - p * q * (innovation / S) ** 2
        for i in range(c):
            x[i] += PH[i] * innovation * gain
            weighted = PH[i] * less
            for j in range(i + 1):
                P[i, j] -= weighted * PH[j]
                P[j, i] = P[i, j]
    evidence -= 0.5 * (square + math.log(determinant))
    return evidence - 0.5 * z.shape[0] * math.log(2.0 * math.pi)


@kernel(error_model="numpy")
def observed(
    grid: Grid,
    sigmas: Grid,
    rows: Rows,
    models: Models,
    which: Integers,
    mean: Array,
    covariance: Array,
    evidence: Array,
) -> None:
    """Update all hypotheses by new readings, in place, and write their log evidence (K,); -inf of
    one that leaves the map.

    The readings are linearised at the mode (iterated extended Kalman filter; Bell & Cathey 1993),
    so that the evidence is Laplace's."""
    n, size = rows.level.shape[0], mean.shape[1]
    z, H, P = np.empty(n), np.empty((n, size)), np.empty((size, size))
    x, at, PH, errors = np.empty(size), np.empty(size), np.empty(size), np.ones(n)
    shift, from_north, from_east = np.zeros(size), math.inf, math.inf
    for k in range(which.shape[0]):
        m = which[k]
        c, used = models.sizes[m], models.used[m]
        # hypotheses at one place are moved alike: what moved the last one is a good guess
        near = abs(mean[k, 0] - from_north) + abs(mean[k, 1] - from_east) < math.sqrt(
            min(covariance[k, 0, 0], covariance[k, 1, 1])
        )
        from_north, from_east = mean[k, 0], mean[k, 1]
        for i in range(c):
            at[i] = mean[k, used[i]]
        for t in range(n):
            rough = models.rough[m] > 0.0 or not models.sigma[m] > 0.0
            north, east = _place(rows, t, used, at, c)
            errors[t] = 1.0 if rough else _larger(sigmas, rows, t, north, east)
        for i in range(c if near else 0):
            at[i] += shift[used[i]]
        for iteration in range(ITERATIONS):
            if not _linearised(grid, rows, errors, models, m, at, z, H):
                evidence[k] = -math.inf
                break
            for i in range(c):
                x[i] = mean[k, used[i]]
                for j in range(c):
                    P[i, j] = covariance[k, used[i], used[j]]
            evidence[k] = _filtered(rows, models, m, x, P, z, H, PH)
            moved = math.hypot(x[0] - at[0], x[1] - at[1])
            if not moved > SETTLED * math.sqrt(abs(min(P[0, 0], P[1, 1]))):
                break
            share = 1.0 if iteration < 3 else 0.5
            for i in range(c):
                at[i] += share * (x[i] - at[i])
        for i in range(size):
            shift[i] = 0.0
        if evidence[k] > -math.inf:
            for i in range(c):
                shift[used[i]] = x[i] - mean[k, used[i]]
                mean[k, used[i]] = x[i]
                for j in range(c):
                    covariance[k, used[i], used[j]] = P[i, j]


@kernel(error_model="numpy")
def merged(
    which: Integers, log_weight: Array, mean: Array, covariance: Array, of_place: Array
) -> Integers:
    """Merge hypotheses of one model whose places are within one 1-sigma of each other by their
    moments, in place, and return the indices of those that stay.

    Parameters
    ----------
    which : (K,) array
        Sorted; within a model by falling weight.
    of_place : (2, N) array
        See `Hypotheses.merged`.
    """
    count, size = mean.shape
    kept, last = np.ones(count, np.bool_), count - 1
    for a in range(last):
        if not kept[a] or which[a + 1] != which[a]:
            continue
        p = q = r = 0.0  # the covariance [[p, q], [q, r]] of the place
        for i in range(size):
            for j in range(size):
                p += of_place[0, i] * covariance[a, i, j] * of_place[0, j]
                q += of_place[0, i] * covariance[a, i, j] * of_place[1, j]
                r += of_place[1, i] * covariance[a, i, j] * of_place[1, j]
        det = p * r - q * q
        b = a + 1
        while b < count and which[b] == which[a]:
            n = e = 0.0
            for i in range(size):
                n += of_place[0, i] * (mean[b, i] - mean[a, i])
                e += of_place[1, i] * (mean[b, i] - mean[a, i])
            if kept[b] and r * n * n - 2.0 * q * n * e + p * e * e < det:
                kept[b] = False
                total = np.logaddexp(log_weight[a], log_weight[b])
                w = math.exp(log_weight[b] - total)
                d = mean[b] - mean[a]
                for i in range(size):
                    for j in range(size):
                        apart = covariance[b, i, j] - covariance[a, i, j]
                        covariance[a, i, j] += w * (apart + (1.0 - w) * (d[i] * d[j]))
                    mean[a, i] += w * d[i]
                log_weight[a] = total
            b += 1
    return np.flatnonzero(kept)
