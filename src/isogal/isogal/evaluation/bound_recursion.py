"""The recursion of the bound (`bound`): what it takes, and its compiled loops.

Loops over elements, not slices and matrix products, which take numba three times as long to
compile."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.compiled import kernel
from isogal.evaluation.aids_model import AidsModel
from isogal.evaluation.gravimeter_states import SlowStates, fill_slow
from isogal.evaluation.ins_error_model import Segments, fill_auxiliary
from isogal.evaluation.tensor_map_error import MapSteps
from isogal.fusion.auxiliary import Auxiliary
from isogal.inertial.error_model import STATES, fill_dynamics


class Readings(NamedTuple):
    """S scans of C channels with independent noise."""

    sensitivity: Array
    """(S, C, 4) d(reading)/d(navigator's error), map included; NaN = the reading tells nothing."""
    slope: Array
    """(S,) d(reading)/d(height), map's unit per m."""
    noise: Array
    """(C,) variances of the channels' noise."""
    used: Booleans
    """(S,) whether the navigator gets, after a scan, what all readings so far say."""
    slow: SlowStates
    """Of the sensor."""
    map_share: Array
    """(S,) the map's error in a reading, in units of its 1-sigma."""
    map_variance: Array
    """(C,) of the map's error in each channel, in units of `map_error.sigma`²."""
    common: Array
    """(C,) how much of bias, drift and the navigator's height is in each channel."""
    map_steps: MapSteps
    """Of the map's errors where they do not go on independently in each channel."""

    @property
    def map_states(self) -> int:
        """How many states the map's errors have: one for each channel, or those of the steps."""
        return max(len(self.noise), self.map_steps.states)


class Ageing(NamedTuple):
    """What becomes of auxiliary states and of the map's error over S stretches."""

    states: Auxiliary
    correlation: Array
    """(S, M)."""
    half_noise: Array
    """(S, M)."""
    map_correlation: Array
    """(S,)."""


class BoundModel(NamedTuple):
    """The linear model. States: the navigator's errors (`isogal.inertial.error_model`), auxiliary
    ones, the map's error in each channel, the sensor's slow errors, its bias and drift."""

    start: Array
    """(n, n) covariance at the start."""
    segments: Segments
    density: Array
    """(6,) of the white noise of the inertial sensors."""
    aged: Ageing
    aids: AidsModel
    readings: Readings


@kernel
def riccati(  # type: ignore[no-untyped-def]
    start, segments, density, aged, aids, readings
):
    """Run the recursion; return the (scans + 1, 2, 2) position covariances.

    `P` is the covariance given all readings so far, `alone` that of the navigator: the same after
    a scan at which it gets what they say, and only propagated until the next such scan."""
    geometry, force, rotation, rate, dt, per_scan = segments
    sensitivity, _, noise, used, slow, map_share, _, common, steps = readings
    joint = steps.gain.shape[0] > 0
    n, filtered = start.shape[0], slow.filter_time > 0.0
    first = n - 2 - slow.variance.shape[0]  # of the slow states
    m = first - max(noise.shape[0], steps.gain.shape[2])
    scans = geometry.shape[0] // per_scan
    result = np.empty((scans + 1, 2, 2))
    P = start.copy()
    alone = start.copy()
    _keep(P, result[0])
    F = np.zeros((m, m))
    transition = np.zeros((n, n))
    half_noise = np.zeros((n, n))
    work = np.empty((2, n, n))
    row = np.zeros(n)
    for k in range(geometry.shape[0]):
        fill_dynamics(F, geometry[k], force[k], rotation[k])
        fill_auxiliary(F, aged.states, force[k], rotation[k], rate[k])
        discretise(transition, half_noise, F, rotation[k], density, dt)
        for j in range(STATES, m):
            transition[j, j] = aged.correlation[k, j - STATES]
            half_noise[j, j] = aged.half_noise[k, j - STATES]
        # the same trapezoid for the map's error: c² (P + q) + q keeps its stationary variance
        c = 1.0 if joint else aged.map_correlation[k]
        for j in range(m, first):
            transition[j, j] = c
            half_noise[j, j] = start[j, j] * (1.0 - c**2) / (1.0 + c**2)
        fill_slow(transition, half_noise, slow, m, dt)
        propagate(P, transition, half_noise, work)
        propagate(alone, transition, half_noise, work)
        if (k + 1) % aids.every == 0:
            for a in range(aids.velocity.shape[1]):
                for i in range(n):
                    row[i] = aids.velocity[k, a, i] if i < m else 0.0
                update(P, row, aids.noise)
                update(alone, row, aids.noise)
        if (k + 1) % per_scan == 0:
            scan = (k + 1) // per_scan - 1
            if joint:
                for each in (P, alone):
                    step_map(each, steps.gain[scan], steps.root[scan], m, work)
            for c in range(noise.shape[0]):
                told = 0.0
                for i in range(n):
                    row[i] = 0.0
                for i in range(4):
                    row[i] = sensitivity[scan, c, i]
                    told += row[i]
                if math.isnan(told):
                    continue
                for i in range(STATES, m):
                    row[i] = aids.by_height[scan, i - STATES] * common[c]
                for i in range(first, n - 2):
                    row[i] = slow.share[scan, i - first] * slow.of_channel[c, i - first]
                row[n - 3 if filtered else m + c] = map_share[scan]
                row[n - 2] = common[c]
                update(P, row, noise[c])
            if used[scan]:
                for i in range(n):
                    for j in range(n):
                        alone[i, j] = P[i, j]
            _keep(alone, result[scan + 1])
    return result


@kernel
def step_map(P, gain, root, first, work):  # type: ignore[no-untyped-def]
    """Let the map's errors go on to the next scan, in place; their states, the last scan's in
    front, begin at `first`."""
    n, count, states = P.shape[0], gain.shape[0], gain.shape[1]
    one = np.eye(n)
    none = np.zeros((n, n))
    for i in range(states):
        one[first + i, first + i] = 0.0
        if i >= count:
            one[first + i, first + i - count] = 1.0
    for i in range(count):
        for j in range(states):
            one[first + i, first + j] = gain[i, j]
    propagate(P, one, none, work)
    for i in range(count):
        for j in range(count):
            for k in range(count):
                P[first + i, first + j] += root[i, k] * root[j, k]


@kernel
def _keep(P, position):  # type: ignore[no-untyped-def]
    """Write the position's covariance (2, 2)."""
    for i in range(2):
        for j in range(2):
            position[i, j] = P[i, j]


@kernel
def propagate(P, transition, half_noise, work):  # type: ignore[no-untyped-def]
    """Let a covariance change over one stretch, in place: the trapezoid rule, by which half of the
    noise enters at either end. `work` (2, n, n); the transition's zeros cost nothing."""
    n = P.shape[0]
    turned, product = work[0], work[1]
    for i in range(n):
        for j in range(n):
            P[i, j] += half_noise[i, j]
    _multiply(transition, P, product)
    for i in range(n):
        for j in range(n):
            turned[i, j] = product[j, i]
    _multiply(transition, turned, product)
    for i in range(n):
        for j in range(i + 1):
            P[i, j] = 0.5 * (product[i, j] + product[j, i]) + half_noise[i, j]
            P[j, i] = P[i, j]


@kernel
def _multiply(sparse, b, out):  # type: ignore[no-untyped-def]
    """Write the product of two matrices, the first with many zeros."""
    n = b.shape[1]
    for i in range(sparse.shape[0]):
        for j in range(n):
            out[i, j] = 0.0
        for k in range(sparse.shape[1]):
            factor = sparse[i, k]
            if factor != 0.0:
                for j in range(n):
                    out[i, j] += factor * b[k, j]


@kernel
def discretise(transition, half_noise, F, rotation, density, dt):  # type: ignore[no-untyped-def]
    """Write transition and half of the process noise of one stretch, of the navigator's errors and
    the sensor's bias, in place."""
    m = F.shape[0]
    second = np.empty((m, m))
    _multiply(F, F, second)
    for i in range(m):
        for j in range(m):
            transition[i, j] = dt * F[i, j] + 0.5 * dt * dt * second[i, j]
        transition[i, i] += 1.0
    transition[-2, -2] = transition[-1, -1] = 1.0
    transition[-2, -1] = dt
    for i in range(3):
        for j in range(3):
            acceleration, rate = 0.0, 0.0
            for a in range(3):
                acceleration += rotation[i, a] * density[a] * rotation[j, a]
                rate += rotation[i, a] * density[3 + a] * rotation[j, a]
            if i < 2 and j < 2:
                half_noise[2 + i, 2 + j] = 0.5 * dt * acceleration
            half_noise[4 + i, 4 + j] = 0.5 * dt * rate


@kernel
def update(P, row, noise):  # type: ignore[no-untyped-def]
    """Condition on one reading, in place; `row` (n,) holds its derivatives."""
    n = P.shape[0]
    column = np.zeros(n)
    variance = noise
    for j in range(n):
        if row[j] != 0.0:
            for i in range(n):
                column[i] += P[i, j] * row[j]
    for j in range(n):
        variance += row[j] * column[j]
    for i in range(n):
        for j in range(n):
            P[i, j] -= column[i] * column[j] / variance
