"""Candidates and iterations of the paper's matcher (paper section 3.2).

Positions are metres north and east on the plane about the navigator's last position."""

import math
from typing import Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array, Booleans
from isogal.earth.plane import Plane
from isogal.maps.field_map import FieldMap
from isogal.matching.interfaces import Batch
from isogal.matching.paper.kalman import backward_smoother, constant_velocity, forward_filter
from isogal.matching.paper.map_lookup import lattice_spacing, lookup, search_window
from isogal.matching.paper.pda import association_weights, candidate_variance, combine


class PaperOptions(BaseModel):
    """Options of `pmht-paper`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    gamma: float = Field(9.0, gt=0.0, description="threshold of the search window, eq. s2-02")
    window: Literal["ellipse", "rectangle"] = Field(
        "rectangle", description="shape of the search window"
    )
    min_half_width: float = Field(
        1500.0, gt=0.0, description="least half-width of the search window, m"
    )
    candidates: int = Field(20, ge=1, le=1000, description="map points kept of each scan")
    spacing: float | None = Field(
        250.0,
        gt=0.0,
        description="coarser maps are interpolated to points this far apart, m; null = never",
    )
    iterations: int = Field(15, ge=1, le=1000, description="most iterations")
    epsilon: float = Field(
        0.0, ge=0.0, description="stop when the batch state moves by no more than this; 0 = never"
    )
    acceleration_density: float = Field(
        1e-5, gt=0.0, description="q of the constant-velocity model, m²/s³"
    )
    association: Literal["predicted", "smoothed"] = Field(
        "predicted", description="state that candidates are weighed by"
    )
    covariance_factor: float | None = Field(None, gt=0.0, description="factor on P_T|T; null = T")
    variability_exponent: float = Field(
        1.0, ge=0.0, le=4.0, description="0 = covariance not weighted by variability"
    )
    variability_window: float = Field(
        2000.0, gt=0.0, description="half-width of the variability template, m"
    )
    min_variability: float = Field(
        2e-4, ge=0.0, description="normalised variability below which aiding stops"
    )
    largest_residual: float | None = Field(
        None,
        gt=0.0,
        description="mean square distance of z-bar from the track, in R-bar, above which aiding"
        " stops; null = never, as in the paper",
    )
    min_scans: int | None = Field(
        None, ge=1, description="scans with candidates that a fix needs; null = half the batch"
    )


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
    residual: float
    """Mean square distance, per axis, of the weighted means z-bar from the smoothed track, in
    R-bar: below 1 where the track is that of the candidates."""


def find_candidates(
    batch: Batch, plane: Plane, field_map: FieldMap, options: PaperOptions
) -> ScanCandidates:
    """Look up all scans that have a reading, and the map at the navigator's position.

    Parameters
    ----------
    batch : Batch
    plane : Plane
        In whose metres the candidates are.
    field_map : FieldMap
    options : PaperOptions
    """
    grid, metres = field_map.grid, (plane.north, plane.east)
    navigator = plane.metres(batch.latitude, batch.longitude)
    usable = np.isfinite(batch.reading) & field_map.covers(batch.latitude, batch.longitude)
    found = ScanCandidates(
        np.zeros((len(batch), options.candidates, 2)),
        np.full((len(batch), options.candidates), np.inf),
    )
    spacing = np.inf if options.spacing is None else options.spacing
    step = lattice_spacing(grid, metres, spacing)
    for t in np.flatnonzero(usable):
        transition = batch.transition[t]
        uncertainty = transition @ batch.prior @ transition.T
        window = search_window(
            uncertainty, options.gamma, options.min_half_width, options.window == "rectangle"
        )
        # the velocity error expected at a candidate is the navigator's: zero
        slope = tuple(batch.reading_jacobian[t, :2])
        place = batch.latitude[t], batch.longitude[t]
        offset, gradient = lookup(
            grid, place, metres, window, batch.reading[t], slope, spacing, options.candidates
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
    options: PaperOptions,
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
    options : PaperOptions
    """
    has = candidates.there.any(axis=1)
    position, variance = (column[has] for column in candidates)
    there = np.isfinite(variance)
    own = np.where(there, variance, 0.0)
    F, Q = constant_velocity(interval, options.acceleration_density)
    H = np.eye(2, 4)
    state, centre, used = navigator, navigator[:, :2], variance
    z, R = np.full((len(navigator), 2), np.nan), np.zeros((len(navigator), 2, 2))
    done = 0
    while done < options.iterations:
        done += 1
        weight = association_weights(position, centre[has], used)
        z[has], combined = combine(position, weight, own)
        R[has] = combined[:, None, None] * np.eye(2)
        # eq. s3-01 with the R_i at first, eq. s32-1 with R-bar of the scan after that
        used = np.where(there, combined[:, None], np.inf)
        filtered = forward_filter(state[0], first_covariance, F, Q, H, z, R)
        smoothed, covariance = backward_smoother(*filtered, F)
        centre = (filtered[2] if options.association == "predicted" else smoothed)[:, :2]
        moved, state = ((smoothed - state) ** 2).sum(), smoothed
        if moved <= options.epsilon**2:
            break
    apart = ((position - z[has][:, None]) ** 2).sum(axis=-1)
    spread = math.sqrt(float((weight * apart).sum()) / max(1, int(has.sum())))
    off = 0.5 * ((z[has] - state[has, :2]) ** 2).sum(axis=-1) / combined
    every = np.zeros(candidates.variance.shape)
    every[has] = weight
    return Estimate(state, covariance, every, done, spread, float(off.mean()))
