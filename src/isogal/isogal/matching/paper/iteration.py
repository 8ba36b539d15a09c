"""Candidates and iterations of the paper's matcher, compiled (paper section 3.2).

Positions are metres north and east on the plane about the navigator's last position."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching.interfaces import Batch
from isogal.matching.local_plane import LocalPlane
from isogal.matching.paper.kalman import (
    backward_smoother,
    constant_velocity,
    forward_filter,
    multiply_transposed,
)
from isogal.matching.paper.map_lookup import lattice_spacing, lookup, search_window
from isogal.matching.paper.pda import association_weights, candidate_variance, combine
from isogal.matrices import product


class Scans(NamedTuple):
    """T scans of a batch."""

    latitude: Array
    """(T,) rad, the navigator's."""
    longitude: Array
    """(T,) rad."""
    navigator: Array
    """(T, 4) m and m/s, its position on the plane and its velocity."""
    reading: Array
    """(T,) less the known offset; NaN = none."""
    sigma: Array
    """(T,) 1-sigma of the readings."""
    transition: Array
    """(T, 2, 4) position error per unit of xi."""
    jacobian: Array
    """(T, 4) d(reading)/d(xi) by the reduction."""

    @classmethod
    def of(cls, batch: Batch, plane: LocalPlane) -> "Scans":
        """Collect them from a batch."""
        position = plane.metres(batch.latitude, batch.longitude)
        return cls(
            latitude=batch.latitude,
            longitude=batch.longitude,
            navigator=np.concatenate([position, batch.velocity], axis=1),
            reading=batch.reading,
            sigma=batch.sigma,
            transition=batch.transition,
            jacobian=batch.reading_jacobian,
        )


class Search(NamedTuple):
    """How candidates are searched for; see the options of these names."""

    gamma: float
    rectangle: bool
    minimum: float
    """m, least half-width of the window."""
    spacing: float
    """m, of the lattice; infinite = the map's cells."""
    wanted: int
    """Candidates of a scan."""


class ScanCandidates(NamedTuple):
    """Candidates of T scans, in arrays as wide as the number wanted."""

    position: Array
    """(T, wanted, 2) m."""
    variance: Array
    """(T, wanted) m², R_i per axis."""
    found: Integers
    """(T,) how many there are."""


class Process(NamedTuple):
    """How the iteration proceeds; see the options of these names."""

    acceleration_density: float
    most: int
    """Iterations."""
    epsilon: float
    predicted: bool
    """Whether candidates are weighed by the predicted state."""


class Estimate(NamedTuple):
    """Where the iteration ends."""

    state: Array
    """(T, 4) smoothed position and velocity."""
    covariance: Array
    """(T, 4, 4)."""
    weight: Array
    """(T, wanted) of the candidates."""
    iterations: int
    spread: float
    """m, RMS distance of the candidates from their mean."""


@kernel
def find_candidates(
    grid: Grid, scans: Scans, prior: Array, metres: tuple[float, float], search: Search
) -> ScanCandidates:
    """Look up all scans."""
    count = scans.reading.shape[0]
    candidates = ScanCandidates(
        np.zeros((count, search.wanted, 2)),
        np.ones((count, search.wanted)),
        np.zeros(count, np.int64),
    )
    step = lattice_spacing(grid, metres, search.spacing)
    for t in range(count):
        place, reading = (scans.latitude[t], scans.longitude[t]), scans.reading[t]
        here = value_and_gradient(grid, place[0], place[1])[0]
        if np.isnan(reading) or np.isnan(here):
            continue
        transition = scans.transition[t]
        uncertainty = multiply_transposed(product(transition, prior), transition)
        window = search_window(uncertainty, search.gamma, search.minimum, search.rectangle)
        # the velocity error expected at a candidate is the navigator's: zero
        slope = (scans.jacobian[t, 0], scans.jacobian[t, 1])
        offset, gradient = lookup(
            grid, place, metres, window, reading, slope, search.spacing, search.wanted
        )
        half = window.half_width
        limit = 0.5 * (half[0] * half[0] + half[1] * half[1])
        spread = candidate_variance(scans.sigma[t], gradient, step, limit)
        candidates.found[t] = offset.shape[0]
        for i in range(offset.shape[0]):
            candidates.position[t, i, 0] = offset[i, 0] + scans.navigator[t, 0]
            candidates.position[t, i, 1] = offset[i, 1] + scans.navigator[t, 1]
            candidates.variance[t, i] = spread[i]
    return candidates


@kernel
def maximise(
    navigator: Array,
    first_covariance: Array,
    interval: Array,
    candidates: ScanCandidates,
    process: Process,
) -> Estimate:
    """Iterate steps 1 and 2 of section 3.2, from the navigator's states (T, 4), their covariance
    (4, 4) at the first scan, and the times (T - 1,) s between scans."""
    position, variance, count = candidates
    scans = navigator.shape[0]
    F, Q = constant_velocity(interval, process.acceleration_density)
    H = np.zeros((2, 4))
    H[0, 0] = H[1, 1] = 1.0
    state = navigator.copy()
    centre = navigator[:, :2].copy()
    covariance = np.zeros((scans, 4, 4))
    weight = np.zeros(variance.shape)
    z = np.full((scans, 2), np.nan)
    combined = np.zeros(scans)
    R = np.zeros((scans, 2, 2))
    done = 0
    for iteration in range(process.most):
        for t in range(scans):
            n = count[t]
            if n == 0:
                continue
            # eq. s3-01 with the R_i at first, eq. s32-1 with R-bar of the scan after that
            used = variance[t, :n].copy()
            for i in range(n if iteration > 0 else 0):
                used[i] = combined[t]
            association = association_weights(position[t, :n], centre[t], used)
            for i in range(n):  # not by a slice, which takes seconds to compile
                weight[t, i] = association[i]
            z[t, 0], z[t, 1], combined[t] = combine(
                position[t, :n], weight[t, :n], variance[t, :n]
            )
            R[t, 0, 0] = R[t, 1, 1] = combined[t]
        x, P, x_predicted, P_predicted = forward_filter(state[0], first_covariance, F, Q, H, z, R)
        smoothed, covariance = backward_smoother(x, P, x_predicted, P_predicted, F)
        moved = 0.0
        for t in range(scans):
            for i in range(4):
                moved += (smoothed[t, i] - state[t, i]) ** 2
            for i in range(2):
                centre[t, i] = x_predicted[t, i] if process.predicted else smoothed[t, i]
        state = smoothed
        done = iteration + 1
        if moved <= process.epsilon * process.epsilon:
            break
    return Estimate(state, covariance, weight, done, _spread(candidates, weight, z))


@kernel
def _spread(candidates: ScanCandidates, weight: Array, mean: Array) -> float:
    """RMS distance (m) of the candidates from their weighted means (T, 2), over all scans."""
    position, _, count = candidates
    total = 0.0
    matched = 0
    for t in range(count.shape[0]):
        matched += count[t] > 0
        for i in range(count[t]):
            north, east = position[t, i, 0] - mean[t, 0], position[t, i, 1] - mean[t, 1]
            total += weight[t, i] * (north * north + east * east)
    return math.sqrt(total / max(1, matched))
