"""Candidates and iterations of the paper's matcher (paper section 3.2).

Positions are metres north and east on the plane about the navigator's last position."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array, Booleans
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.local_plane import LocalPlane
from isogal.matching.paper.kalman import backward_smoother, constant_velocity, forward_filter
from isogal.matching.paper.map_lookup import lattice_spacing, lookup, search_window
from isogal.matching.paper.pda import association_weights, candidate_variance, combine


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
    """(T, wanted) m², R_i per axis; infinite = there is none."""

    @property
    def there(self) -> Booleans:
        """(T, wanted) which there are."""
        return np.isfinite(self.variance)


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


def find_candidates(
    batch: Batch, plane: LocalPlane, field_map: FieldMap, search: Search
) -> ScanCandidates:
    """Look up all scans that have a reading, and the map at the navigator's position."""
    grid, metres = field_map.grid, (plane.north, plane.east)
    navigator = plane.metres(batch.latitude, batch.longitude)
    usable = np.isfinite(batch.reading) & field_map.covers(batch.latitude, batch.longitude)
    found = ScanCandidates(
        np.zeros((len(batch), search.wanted, 2)), np.full((len(batch), search.wanted), np.inf)
    )
    step = lattice_spacing(grid, metres, search.spacing)
    for t in np.flatnonzero(usable):
        transition = batch.transition[t]
        uncertainty = transition @ batch.prior @ transition.T
        window = search_window(uncertainty, search.gamma, search.minimum, search.rectangle)
        # the velocity error expected at a candidate is the navigator's: zero
        slope = tuple(batch.reading_jacobian[t, :2])
        place = batch.latitude[t], batch.longitude[t]
        offset, gradient = lookup(
            grid, place, metres, window, batch.reading[t], slope, search.spacing, search.wanted
        )
        limit = 0.5 * float((window.half_width**2).sum())
        own = slice(len(offset))
        found.position[t, own] = offset + navigator[t]
        found.variance[t, own] = candidate_variance(batch.sigma[t], gradient, step, limit)
    return found


def maximise(
    navigator: Array,
    first_covariance: Array,
    interval: Array,
    candidates: ScanCandidates,
    process: Process,
) -> Estimate:
    """Iterate steps 1 and 2 of section 3.2.

    Parameters
    ----------
    navigator : (T, 4) array
        The navigator's states.
    first_covariance : (4, 4) array
        Their covariance at the first scan.
    interval : (T - 1,) array
        s, times between scans.
    candidates : ScanCandidates
    process : Process
    """
    has = candidates.there.any(axis=1)
    position, variance = (column[has] for column in candidates)
    there = np.isfinite(variance)
    own = np.where(there, variance, 0.0)
    F, Q = constant_velocity(interval, process.acceleration_density)
    H = np.eye(2, 4)
    state, centre, used = navigator, navigator[:, :2], variance
    z, R = np.full((len(navigator), 2), np.nan), np.zeros((len(navigator), 2, 2))
    done = 0
    while done < process.most:
        done += 1
        weight = association_weights(position, centre[has], used)
        z[has], combined = combine(position, weight, own)
        R[has] = combined[:, None, None] * np.eye(2)
        # eq. s3-01 with the R_i at first, eq. s32-1 with R-bar of the scan after that
        used = np.where(there, combined[:, None], np.inf)
        filtered = forward_filter(state[0], first_covariance, F, Q, H, z, R)
        smoothed, covariance = backward_smoother(*filtered, F)
        centre = (filtered[2] if process.predicted else smoothed)[:, :2]
        moved, state = ((smoothed - state) ** 2).sum(), smoothed
        if moved <= process.epsilon**2:
            break
    apart = ((position - z[has][:, None]) ** 2).sum(axis=-1)
    spread = math.sqrt(float((weight * apart).sum()) / max(1, int(has.sum())))
    every = np.zeros(candidates.variance.shape)
    every[has] = weight
    return Estimate(state, covariance, every, done, spread)
