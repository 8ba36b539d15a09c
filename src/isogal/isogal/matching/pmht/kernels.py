"""Compiled loops over hypotheses: linearisation, Kalman update, and which are one place.

A hypothesis k has the model ``which[k]`` and a Gaussian of the augmented state: the navigator's
error (7), the map error of each channel in units of its 1-sigma, and the instrument's states
(`rows.States`). A model need not have all of them: its own are ``used[m, :count[m]]``, and loops
go over these only. docs/mathematics.md, section 6.
"""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.compiled import kernel
from isogal.inertial.error_state import BATCH_STATES, HEADING
from isogal.inertial.rotations import INLINE
from isogal.maps.interpolation import Grid, bilinear, value_and_gradient
from isogal.matching.pmht.late import Late, earlier, late_by, low_passed, sensed, taken_in
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


@kernel(error_model="numpy")
def _larger(
    sigmas: Grid, lat: float, lon: float, north: float, east: float, channel: int
) -> float:
    """Return by what factor the map says its error is larger where a reading was taken by a
    navigator that is `north` and `east` (rad) of the truth than where that believes to be
    (`Rows.load`); `sigmas` at its nodes, or one that does not count where it is the same
    everywhere."""
    if sigmas.values.shape[1] < 2:
        return 1.0
    believed = bilinear(sigmas, lat, lon, channel)
    ratio = bilinear(sigmas, lat - north, lon - east, channel) / believed
    return ratio if believed > 0.0 and math.isfinite(ratio) else 1.0


@kernel(**INLINE)
def _axes(
    place: Array, covariance: Array, used: Integers, c: int, across: Array
) -> tuple[float, float, float, float]:
    """Return direction (cosine, sine) of the longer axis and the 1-sigmas of both, m, of where a
    row was taken, `place` (2, N) per unit of the states, and write into `across` (2, N) how each
    of the c states `used` moves with either axis, 1-sigma."""
    p = q = r = 0.0
    for i in range(c):
        a = b = 0.0
        for j in range(c):
            a += covariance[used[i], used[j]] * place[0, used[j]]
            b += covariance[used[i], used[j]] * place[1, used[j]]
        across[0, i], across[1, i] = a, b
        p += place[0, used[i]] * a
        q += place[0, used[i]] * b
        r += place[1, used[i]] * b
    # of the covariance [[p, q], [q, r]]
    angle = 0.5 * math.atan2(2.0 * q, p - r)
    cos, sin = math.cos(angle), math.sin(angle)
    first = math.sqrt(0.5 * (p + r) + math.hypot(0.5 * (p - r), q))
    second = math.sqrt(max(p * r - q * q, 0.0)) / first
    for i in range(c):
        a, b = across[0, i], across[1, i]
        across[0, i] = (cos * a + sin * b) / first
        across[1, i] = (cos * b - sin * a) / second if second > 0.0 else 0.0
    return cos, sin, first, second


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
    size, n, last = mean.shape[1], rows.level.shape[0], rows.level.shape[0] - 1
    worst, across = np.zeros(which.shape[0]), np.empty((2, size))
    bend, change = np.empty(2), np.empty(2)
    for k in range(which.shape[0]):
        if not asked[k]:
            continue
        m = which[k]
        c, used, sigma, shape = models.sizes[m], models.used[m], models.sigma[m], models.shape[m]
        cos, sin, first, second = _axes(rows.place[last], covariance[k], used, c, across)
        bend[:], change[:] = 0.0, 0.0
        for t in range(n):
            lat, lon, channel = rows.latitude[t], rows.longitude[t], rows.channel[t]
            to_lat, to_lon = rows.radian[t, 0], rows.radian[t, 1]
            R, north, east = rows.noise[t] * models.noise[m], 0.0, 0.0
            for i in range(c):
                north += rows.place[t, 0, used[i]] * mean[k, used[i]]
                east += rows.place[t, 1, used[i]] * mean[k, used[i]]
            if sigma > 0.0:
                error = sigma
                if not models.rough[m] > 0.0:
                    error *= _larger(sigmas, lat, lon, north * to_lat, east * to_lon, channel)
                for u in range(rows.load.shape[2]):
                    load = error * rows.load[shape, t, u]
                    R += load * load * rows.joined[shape, t, u, u]
            to_older = earlier(rows.past, t, models.lag[m])
            lat += to_older[0] - north * to_lat
            lon += to_older[1] - east * to_lon
            middle = value_and_gradient(grid, lat, lon, channel)[0]
            for axis in range(2):
                a, b = (first * cos, first * sin) if axis == 0 else (-second * sin, second * cos)
                a, b = reach * a * to_lat, reach * b * to_lon
                one = value_and_gradient(grid, lat + a, lon + b, channel)[0]
                other = value_and_gradient(grid, lat - a, lon - b, channel)[0]
                less = middle
                for of_velocity in range(2):
                    root = 0.0
                    for i in range(BATCH_STATES):
                        root += rows.swift[t, of_velocity, i] * across[axis, i]
                    less += (reach * root) ** 2
                bend[axis] += (0.5 * (one + other) - less) ** 2 / R
                change[axis] += (0.5 * (one - other)) ** 2 / R
        departure = np.sqrt(bend) / np.maximum(np.sqrt(change), 1.0)
        worse = 1 if departure[1] > departure[0] and second > 0.0 else 0
        worst[k] = departure[worse]
        for i in range(c):
            along[k, used[i]] = across[worse, i]
    return worst


@kernel(**INLINE)
def _turned(cos: float, sin: float, north: float, east: float) -> tuple[float, float]:
    """Return a vector turned by an angle to the left, seen from above."""
    return cos * north + sin * east, cos * east - sin * north


@kernel(**INLINE)
def _turn_path(
    forward: Array, velocity: Array, cos: float, sin: float, less: float, turned: Array
) -> None:
    """Write the rows of the position of `forward` (n, n) to `turned` for a path that is turned by
    an angle, with `less` the mean of the cosine of what is not known of that; see `passed`."""
    n = forward.shape[0]
    for j in range(n):
        if 2 <= j < 4 or j >= BATCH_STATES:
            turned[0, j], turned[1, j] = _turned(cos, sin, forward[0, j], forward[1, j])
    north, east = _per_heading(forward, velocity)
    along = _turned(cos, sin, less * north, less * east)
    for i in range(2):
        turned[i, HEADING] = along[i] + velocity[1] * turned[i, 2] - velocity[0] * turned[i, 3]


@kernel(**INLINE)
def _per_heading(forward: Array, velocity: Array) -> tuple[float, float]:
    """Return what a heading error of 1 rad does to the position at the end, with a velocity that
    is wrong as the heading is, e_v = psi x v."""
    north = forward[0, HEADING] - velocity[1] * forward[0, 2] + velocity[0] * forward[0, 3]
    east = forward[1, HEADING] - velocity[1] * forward[1, 2] + velocity[0] * forward[1, 3]
    return north, east


@kernel
def passed(
    mean: Array,
    covariance: Array,
    moving: Integers,
    forward: Array,
    growth: Array,
    faster: Array,
    velocity: Array,
) -> None:
    """Carry hypotheses, means (K, N) and covariances (K, N, N), in place: of the states `moving`
    (n,) the error is `forward` (n, n) times what it was, and `growth` (n, n), `faster` (K,) times
    as much, has joined the covariance.

    Of a hypothesis of another heading the path D that the navigator has gone, from a `velocity`
    (2,) on, about which that is linear, is turned by as much: its error at the end is
    E[D - R(-psi) D] more than at the beginning, not psi x D."""
    n, size = len(moving), mean.shape[1]
    old, block, F = np.empty((n, size)), np.empty((n, n)), forward.copy()
    north, east = _per_heading(forward, velocity)
    for k in range(mean.shape[0]):
        P, psi = covariance[k], mean[k, moving[HEADING]]
        less = math.exp(-0.5 * P[moving[HEADING], moving[HEADING]])
        c, s = math.cos(psi), math.sin(psi)
        _turn_path(forward, velocity, c, s, less, F)
        for i in range(n):
            old[i, 0] = mean[k, moving[i]]
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += F[i, j] * old[j, 0]
            mean[k, moving[i]] = total
        # what is linear in the heading there is an arc
        by_north, by_east = _turned(c, s, east + psi * north, psi * east - north)
        mean[k, moving[0]] += east - less * by_north
        mean[k, moving[1]] -= north + less * by_east
        for i in range(n):
            for j in range(size):
                old[i, j] = 0.0
            for h in range(n):
                share, row = F[i, h], moving[h]
                for j in range(size):
                    old[i, j] += share * P[row, j]
        for i in range(n):
            for j in range(n):
                block[i, j] = faster[k] * growth[i, j]
        for j in range(n):
            block[0, j], block[1, j] = _turned(c, s, block[0, j], block[1, j])
        for i in range(n):
            block[i, 0], block[i, 1] = _turned(c, s, block[i, 0], block[i, 1])
        for i in range(n):
            for j in range(n):
                for h in range(n):
                    block[i, j] += old[i, moving[h]] * F[j, h]
        for i in range(n):
            for j in range(size):
                P[moving[i], j] = old[i, j]
                P[j, moving[i]] = old[i, j]
        for i in range(n):
            for j in range(n):
                P[moving[i], moving[j]] = 0.5 * (block[i, j] + block[j, i])


class Own(NamedTuple):
    """Rows as a model has them, whose c states come first.

    Inner loops take its arrays, not itself: numba counts the references to each array of a tuple
    at every call, and with `Rows` in them an update took four times as long."""

    place: Array
    """(n, 2, N) rad of latitude and longitude per unit of the states."""
    reading: Array
    """(n, N)."""
    level: Array
    """(n,)."""
    noise: Array
    """(n,)."""
    keep: Array
    """(n, N) of all states, and `fresh`; of one map error alone, too, where several are
    `_stepped`."""
    fresh: Array
    """(n, N)."""
    past: Array
    """(n, Q, 3)."""
    elapsed: Array
    """(n,)."""


class Update(NamedTuple):
    """What an update of one hypothesis works with."""

    x: Array
    """(N,) its state, and `P` its covariance, which become those after the readings."""
    P: Array
    """(N, N)."""
    before: Array
    """(N,) its state before, and `prior` its covariance."""
    prior: Array
    """(N, N)."""
    at: Array
    """(N,) where the readings are linearised."""
    z: Array
    """(n,), and H (n, N): the readings, linearised."""
    H: Array
    g: Array
    """(n,), and G (n, N): what a filter takes in, linearised: g + G x."""
    G: Array
    by_age: Array
    """(n,) how what is sensed changes with its age, map's unit per s."""
    PH: Array
    """(N,)."""


@kernel(error_model="numpy")
def _own(rows: Rows, size: int) -> Own:
    """Return room for those of models of at most so many states."""
    n = rows.level.shape[0]
    place, reading = np.empty((n, 2, size)), np.empty((n, size))
    level, noise = np.empty(n), np.empty(n)
    keep, fresh = np.empty((n, size)), np.empty((n, size))
    return Own(place, reading, level, noise, keep, fresh, rows.past, rows.elapsed)


@kernel(error_model="numpy")
def _several(used: Integers, c: int, errors: int) -> bool:
    """Whether a model of the c states `used` has several of so many map errors, or one and its
    slope; then it has all of them."""
    second = BATCH_STATES + 1
    return errors > 1 and c > second and used[second] == second


@kernel(error_model="numpy")
def _of_model(
    rows: Rows, used: Integers, c: int, shape: int, lag: float, noise: float, own: Own
) -> Late:
    """Write the rows of a model of the c states `used`, of whose noise the variance is so many
    times as large, and return by what its readings are late."""
    n, late = BATCH_STATES, late_by(used, c, own.reading.shape[1], lag, rows.past)
    alone = not _several(used, c, rows.load.shape[2])
    for t in range(rows.level.shape[0]):
        own.level[t] = rows.level[t] - (rows.added[t] if late.value >= 0 else 0.0)
        own.noise[t] = noise * rows.noise[t]
        for i in range(c):
            s, keep, fresh = used[i], 1.0, 0.0
            if s >= n:
                keep, fresh = rows.keep[t, s - n], rows.fresh[t, s - n]
            if s == n and alone and rows.joined[shape, t, 0, 0] > 0.0:
                keep, fresh = rows.step[shape, t, 0, 0], rows.joined[shape, t, 0, 0]
            own.keep[t, i], own.fresh[t, i] = keep, fresh
            own.reading[t, i] = 0.0 if i == late.delay else rows.reading[t, s]
            for axis in range(2):
                moved = rows.place[t, axis, s] * rows.radian[t, axis]
                own.place[t, axis, i] = 0.0 if i == late.delay else moved
    return late


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
def _changed(x: Array, P: Array, keep: Array, fresh: Array, t: int, c: int) -> None:
    """Carry states beside the navigator's to row t, in place; see `Own`."""
    for i in range(BATCH_STATES, c):
        f = keep[t, i]
        if f != 1.0:
            x[i] *= f
            for j in range(c):
                P[i, j] *= f
                P[j, i] *= f
        P[i, i] += fresh[t, i]


@kernel(error_model="numpy")
def _filtered(
    c: int,
    x: Array,
    P: Array,
    z: Array,
    H: Array,
    noise: Array,
    keep: Array,
    fresh: Array,
    step: Array,
    joined: Array,
    tails: float,
    late: Late,
    at: Array,
    elapsed: Array,
    g: Array,
    G: Array,
    by_age: Array,
    PH: Array,
) -> float:
    """Kalman filter of readings one after the other, in place; return their log evidence.

    A reading is good or, with a small probability, an outlier, which says nothing and is as likely
    everywhere; the two posteriors are merged by their moments. Where a model's errors have tails,
    innovations have Student's t density instead, and one beyond a 1-sigma counts as if its
    variance were so much larger. `step` and `joined` (n, U, U): of map errors that depend on each
    other, U = 0 where there are none."""
    wrong, width = OUTLIER
    peak = 0.0
    if tails < math.inf:
        peak = (
            math.lgamma(0.5 * tails + 0.5) - math.lgamma(0.5 * tails) - 0.5 * math.log(0.5 * tails)
        )
    square, determinant, evidence = 0.0, 1.0, 0.0
    for t in range(z.shape[0]):
        if step.shape[1] > 0 and joined[t, 0, 0] > 0.0:
            _stepped(x, P, step[t], joined[t], c, PH)
        _changed(x, P, keep, fresh, t, c)
        if late.value >= 0 and elapsed[t] > 0.0:
            low_passed(x, P, late, at, elapsed[t], g[t], G[t], by_age[t], c, PH)
        S, innovation = noise[t], z[t]
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
            bad = -0.5 * math.log(S + width * noise[t]) + math.log(wrong)
            both = max(good, bad) + math.log1p(math.exp(-abs(good - bad)))
            evidence += both
            p, q = math.exp(good - both), math.exp(bad - both)
            gain = p / S
            less = gain - p * q * (innovation / S) ** 2
        for i in range(c):
            x[i] += PH[i] * innovation * gain
            for j in range(c):
                P[i, j] -= less * (PH[i] * PH[j])
    evidence -= 0.5 * (square + math.log(determinant))
    return evidence - 0.5 * z.shape[0] * math.log(2.0 * math.pi)


@kernel(error_model="numpy")
def _iterated(
    grid: Grid,
    rows: Rows,
    own: Own,
    late: Late,
    errors: Array,
    step: Array,
    joined: Array,
    tails: float,
    c: int,
    update: Update,
) -> float:
    """Update a hypothesis of c states by readings that are linearised at its mode, looked for from
    `at` on, with map errors of 1-sigmas `errors` (n, U); return their log evidence, -inf off the
    map."""
    latitude, longitude, channel = rows.latitude, rows.longitude, rows.channel
    swift, curved = rows.swift, rows.swift.any()
    place, reading, level, noise, keep, fresh, past, elapsed = own
    x, P, before, prior, at, z, H, g, G, by_age, PH = update
    evidence, first = -math.inf, BATCH_STATES
    for iteration in range(ITERATIONS):
        # z = H x + noise: z - J x = z - (J - G) x - G x
        for t in range(level.shape[0]):
            lat, lon = latitude[t], longitude[t]
            for i in range(c):
                lat -= place[t, 0, i] * at[i]
                lon -= place[t, 1, i] * at[i]
            if late.value < 0 and late.delay < 0:
                value, by_lat, by_lon = value_and_gradient(grid, lat, lon, channel[t])
            else:
                value, by_lat, by_lon, by_age[t] = taken_in(
                    grid, past, t, lat, lon, channel[t], late, at, elapsed[t]
                )
            if not math.isfinite(value):
                return -math.inf
            for i in range(c):
                slope = by_lat * place[t, 0, i] + by_lon * place[t, 1, i]
                H[t, i] = reading[t, i] - slope
                value += slope * at[i]
            for i in range(first, min(c, first + errors.shape[1])):
                H[t, i] += errors[t, i - first]
            for axis in range(2 if curved else 0):
                root = 0.0
                for i in range(first):
                    root += swift[t, axis, i] * at[i]
                for i in range(first):
                    H[t, i] -= 2.0 * root * swift[t, axis, i]
                value += root * root
            if late.delay >= 0:
                H[t, late.delay] = by_age[t]
                value -= by_age[t] * at[late.delay]
            z[t] = level[t] - value
            if late.value >= 0:  # the reading is the filter's value, which takes in g + G x
                z[t], g[t] = level[t], value - rows.added[t]
                for i in range(c):
                    G[t, i], H[t, i] = H[t, i], 0.0
                H[t, late.value] = 1.0
        for i in range(c):
            x[i] = before[i]
            for j in range(c):
                P[i, j] = prior[i, j]
        evidence = _filtered(
            c, x, P, z, H, noise, keep, fresh, step, joined, tails, late, at, elapsed,
            g, G, by_age, PH,
        )  # fmt: skip
        moved = math.hypot(x[0] - at[0], x[1] - at[1])
        if not moved > SETTLED * math.sqrt(abs(min(P[0, 0], P[1, 1]))):
            break
        share = 1.0 if iteration < 3 else 0.5
        for i in range(c):
            at[i] += share * (x[i] - at[i])
    return evidence


@kernel(error_model="numpy")
def _settled(grid: Grid, rows: Rows, own: Own, lag: float, x: Array, c: int) -> float:
    """Return what a filter that is known nothing of gives before the first row: what was sensed a
    time constant (s) before; 0 off the map."""
    lat, lon = rows.latitude[0], rows.longitude[0]
    for i in range(c):
        lat -= own.place[0, 0, i] * x[i]
        lon -= own.place[0, 1, i] * x[i]
    value = sensed(grid, own.past, 0, lat, lon, rows.channel[0], lag)[0]
    return value - rows.added[0] if math.isfinite(value) else 0.0


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
    n, size, several = rows.level.shape[0], mean.shape[1], rows.load.shape[2]
    own, model, late, errors = _own(rows, size), -1, Late(-1, -1, -1, 0.0), np.empty((n, several))
    x, P, before = np.empty(size), np.empty((size, size)), np.empty(size)
    prior, at, shift = np.empty((size, size)), np.empty(size), np.zeros(size)
    z, H, g, G = np.empty(n), np.empty((n, size)), np.empty(n), np.empty((n, size))
    update = Update(x, P, before, prior, at, z, H, g, G, np.empty(n), np.empty(size))
    from_north, from_east, place = math.inf, math.inf, own.place
    latitude, longitude, channel = rows.latitude, rows.longitude, rows.channel
    for k in range(which.shape[0]):
        m = which[k]
        c, used, shape, sigma = models.sizes[m], models.used[m], models.shape[m], models.sigma[m]
        if m != model:
            late, model = _of_model(rows, used, c, shape, models.lag[m], models.noise[m], own), m
        for i in range(c):
            before[i] = mean[k, used[i]]
            for j in range(c):
                prior[i, j] = covariance[k, used[i], used[j]]
        if late.value >= 0 and before[late.value] == 0.0:
            before[late.value] = _settled(grid, rows, own, late.lag, before, c)
        graded = sigma > 0.0 and not models.rough[m] > 0.0
        for t in range(n):
            error, north, east = sigma, 0.0, 0.0
            for i in range(c if graded else 0):
                north += place[t, 0, i] * before[i]
                east += place[t, 1, i] * before[i]
            if graded:
                error *= _larger(sigmas, latitude[t], longitude[t], north, east, channel[t])
            for u in range(several):
                errors[t, u] = error * rows.load[shape, t, u]
        # hypotheses at one place are moved alike: what moved the last one is a good guess
        near = abs(before[0] - from_north) + abs(before[1] - from_east) < math.sqrt(
            min(prior[0, 0], prior[1, 1])
        )
        from_north, from_east = before[0], before[1]
        for i in range(c):
            at[i] = before[i] + (shift[used[i]] if near else 0.0)
        stepped = several if _several(used, c, several) else 0
        step, joined = rows.step[shape, :, :stepped, :stepped], rows.joined[shape]
        evidence[k] = _iterated(
            grid, rows, own, late, errors, step, joined, models.tails[m], c, update
        )
        for i in range(size):
            shift[i] = 0.0
        for i in range(c if evidence[k] > -math.inf else 0):
            shift[used[i]] = x[i] - before[i]
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
            north = east = 0.0
            for j in range(size):
                north += covariance[a, i, j] * of_place[0, j]
                east += covariance[a, i, j] * of_place[1, j]
            p += of_place[0, i] * north
            q += of_place[0, i] * east
            r += of_place[1, i] * east
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
