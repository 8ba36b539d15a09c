"""The paper's matcher to the letter: probabilistic multiple hypotheses map matching (paper section
3.2).

Per batch: the map lookup function at each scan (`lookup`), then up to 15 expectation-maximisation
iterations of association (`pda`) and of a constant-velocity Kalman smoother (`kalman`) from the
navigator's state at the first scan. The fix is x_T, its covariance P_{T|T} weighted by the map
feature variability; where that is too small, aiding stops.

What the paper leaves open, and the choice here (each an option of `matcher.options`, see
`PaperOptions`):

- R_i(sigma): isotropic, from the local gradient and the spacing of the map points (`pda`).
- x_{t|t-1} of eq. s32-1: the filter's prediction of the last iteration; before the first, the
  navigator's position. `association: smoothed` takes the smoothed state instead, as PMHT does
  (Streit & Luginbuhl 1994).
- Sigma_1^(i): the navigator's, in every iteration; the paper's backward process gives states only.
  x_1^(i) moves as the paper says.
- The weight: P_{T|T} times `covariance_factor` times (C / C_ref)^-`variability_exponent`, C the
  mean of eq. CV over the batch, C_ref its mean over a fixed lattice of 100 places of the map. The
  factor is T unless given: with P_{T|T} alone, aiding diverges.
- A scan counts only where the map has a value at the navigator's position: a window cut off at the
  edge would pull inwards.

Known faults, kept because they are the paper's: the candidates' spread about their mean is in no
covariance; the navigator's prior is in P_{T|T} and is used again when the navigator takes the fix;
x_1 of one iteration is the smoothed, no longer independent, x_1 of the last; no error of the map,
no unknown bias (`map_sigma` and `bias_sigma` do nothing); the first scan's reading is never used
(eq. forward)."""

import math
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array, Integers
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.maps.variability import feature_variability
from isogal.matching.interfaces import Batch, Candidates, Fix, declined
from isogal.matching.local import LocalPlane, too_few, unusable
from isogal.matching.paper.kalman import (
    backward_smoother,
    constant_velocity,
    forward_filter,
    multiply,
    multiply_transposed,
)
from isogal.matching.paper.map_lookup import lattice_spacing, lookup, search_window
from isogal.matching.paper.pda import association_weights, candidate_variance, combine
from isogal.matching.registry import check_options
from isogal.scenario import Matcher as MatcherSettings

REFERENCE_SIDE = 10
"""C_ref is the mean of C over this many places along each side of the map."""


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
    min_scans: int | None = Field(
        None, ge=1, description="scans with candidates that a fix needs; null = half the batch"
    )


@dataclass(frozen=True)
class PmhtPaper:
    """Settings of the matcher; `match` keeps the map's mean variability in its memory and nothing
    else."""

    options: PaperOptions = field(default_factory=PaperOptions)
    name: str = "pmht-paper"
    context: int = 0

    @classmethod
    def from_settings(cls, settings: MatcherSettings) -> "PmhtPaper":
        """Build it from the scenario; raises InputError on unknown or impossible options."""
        return cls(check_options("pmht-paper", settings.options, PaperOptions))

    def match(self, batch: Batch, field_map: FieldMap, memory: Any) -> tuple[Fix, Any]:
        """Match one batch (see `interfaces.Matcher`)."""
        options = self.options
        if reason := unusable(batch):
            return declined(batch, reason), memory
        reference = memory if isinstance(memory, float) else self._reference(field_map)
        local = feature_variability(
            field_map, batch.latitude, batch.longitude, options.variability_window
        )
        known = local[np.isfinite(local)]
        if not known.size:
            return declined(batch, "the track is outside the map"), reference
        variability = float(known.mean()) / reference if reference > 0.0 else 0.0
        if variability < options.min_variability or variability == 0.0:
            reason = (
                f"map feature variability {variability:.2g} of the map's mean is below"
                f" {options.min_variability:g}"
            )
            return declined(batch, reason, feature_variability=variability), reference

        plane = LocalPlane.of(batch)
        navigator = np.concatenate(
            [plane.metres(batch.latitude, batch.longitude), batch.velocity], axis=1
        )
        position, variance, count = _candidates(
            field_map.grid, batch.latitude, batch.longitude, navigator, (plane.north, plane.east),
            batch.transition, batch.prior, batch.reading - batch.offset, batch.sigma, batch.reading_jacobian,
            options.gamma, options.window == "rectangle", options.min_half_width, options.candidates,
            np.inf if options.spacing is None else options.spacing,
        )  # fmt: skip
        usable = int((count > 0).sum())
        if reason := too_few(batch, usable, options.min_scans or max(1, len(batch) // 2)):
            return declined(batch, reason, feature_variability=variability), reference

        state, covariance, weight, iterations, spread = _maximise(
            navigator, _first_scan(batch), np.diff(batch.time), position, variance, count,
            options.acceleration_density, options.iterations, options.epsilon, options.association == "predicted",
        )  # fmt: skip
        factor = (
            options.covariance_factor or len(batch)
        ) * variability**-options.variability_exponent
        # where batches overlap each reading serves in T / new of them
        out = covariance[-1, :2, :2] * factor * (len(batch) / max(batch.new, 1))
        scan_covariance = np.full((len(batch), 2, 2), np.nan)
        scan_covariance[len(batch) - batch.new :] = (
            batch.new * out
        )  # so many fixes hold the information once
        latitude, longitude = plane.radians(state[:, :2])
        fix = Fix(
            time=float(batch.time[-1]),
            latitude=float(latitude[-1]),
            longitude=float(longitude[-1]),
            covariance=out,
            candidates=_listed(plane, position, weight, count),
            diagnostics={
                "feature_variability": variability,
                "iterations": float(iterations),
                "spread": spread,
            },
            scan_position=np.stack([latitude, longitude], axis=-1),
            scan_covariance=scan_covariance,
        )
        return fix, reference

    def _reference(self, field_map: FieldMap) -> float:
        """Return C_ref, the mean of eq. CV over a lattice of the map, the fixed number of samples
        that the paper normalises by."""
        inside = np.arange(1, REFERENCE_SIDE + 1) / (REFERENCE_SIDE + 1)
        extent = field_map.extent
        latitude = extent.south + inside * (extent.north - extent.south)
        longitude = extent.west + inside * (extent.east - extent.west)
        sample = feature_variability(
            field_map, latitude[:, None], longitude[None, :], self.options.variability_window
        )
        sample = sample[np.isfinite(sample)]
        return float(sample.mean()) if sample.size else 0.0


def _first_scan(batch: Batch) -> Array:
    """Sigma_1: covariance (4, 4) of the navigator's position and velocity error at the first
    scan."""
    to_first = np.concatenate(
        [
            batch.transition[0],
            (batch.transition[1] - batch.transition[0]) / (batch.time[1] - batch.time[0]),
        ]
    )
    return to_first @ batch.prior @ to_first.T


def _listed(plane: LocalPlane, position: Array, weight: Array, count: Integers) -> Candidates:
    kept = np.arange(weight.shape[1])[None, :] < count[:, None]
    latitude, longitude = plane.radians(position[kept])
    return Candidates(latitude, longitude, weight[kept], np.nonzero(kept)[0])


@kernel
def _candidates(
    grid: Grid,
    latitude: Array,
    longitude: Array,
    navigator: Array,
    metres: tuple[float, float],
    transition: Array,
    prior: Array,
    reading: Array,
    sigma: Array,
    jacobian: Array,
    gamma: float,
    rectangle: bool,
    minimum: float,
    wanted: int,
    spacing: float,
) -> tuple[Array, Array, Integers]:
    """Look up all scans: candidates' positions (T, wanted, 2) m, variances R_i (T, wanted) m², and
    how many there are (T,)."""
    scans = reading.shape[0]
    position = np.zeros((scans, wanted, 2))
    variance = np.ones((scans, wanted))
    count = np.zeros(scans, np.int64)
    step = lattice_spacing(grid, metres, spacing)
    for t in range(scans):
        here = value_and_gradient(grid, latitude[t], longitude[t])[0]
        if np.isnan(reading[t]) or np.isnan(here):
            continue
        uncertainty = multiply_transposed(multiply(transition[t], prior), transition[t])
        shape, half_width = search_window(uncertainty, gamma, minimum, rectangle)
        # as seen from a candidate, the vehicle has no other velocity error than the navigator
        # expects: none
        offset, _, gradient = lookup(
            grid, latitude[t], longitude[t], metres, shape, half_width,
            reading[t], (jacobian[t, 0], jacobian[t, 1]), spacing, wanted,
        )  # fmt: skip
        n = offset.shape[0]
        count[t] = n
        limit = 0.5 * (half_width[0] * half_width[0] + half_width[1] * half_width[1])
        spread = candidate_variance(sigma[t], gradient, step, limit)
        for i in range(n):
            position[t, i, 0] = offset[i, 0] + navigator[t, 0]
            position[t, i, 1] = offset[i, 1] + navigator[t, 1]
            variance[t, i] = spread[i]
    return position, variance, count


@kernel
def _maximise(
    navigator: Array,
    first_covariance: Array,
    interval: Array,
    position: Array,
    variance: Array,
    count: Integers,
    acceleration_density: float,
    most: int,
    epsilon: float,
    predicted: bool,
) -> tuple[Array, Array, Array, int, float]:
    """Iterate steps 1 and 2 of section 3.2: states (T, 4), covariances (T, 4, 4), weights,
    iterations, spread of candidates (m)."""
    scans = navigator.shape[0]
    F, Q = constant_velocity(interval, acceleration_density)
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
    for iteration in range(most):
        for t in range(scans):
            n = count[t]
            if n == 0:
                continue
            # eq. s3-01 with the R_i at first, eq. s32-1 with R-bar of the scan after that
            used = variance[t, :n].copy()
            if iteration > 0:
                for i in range(n):
                    used[i] = combined[t]
            w = association_weights(position[t, :n], centre[t], used)
            for i in range(n):
                weight[t, i] = w[i]
            z[t, 0], z[t, 1], combined[t] = combine(position[t, :n], w, variance[t, :n])
            R[t, 0, 0] = R[t, 1, 1] = combined[t]
        x, P, x_predicted, P_predicted = forward_filter(state[0], first_covariance, F, Q, H, z, R)
        smoothed, covariance = backward_smoother(x, P, x_predicted, P_predicted, F)
        moved = 0.0
        for t in range(scans):
            for i in range(4):
                moved += (smoothed[t, i] - state[t, i]) ** 2
            for i in range(2):
                centre[t, i] = x_predicted[t, i] if predicted else smoothed[t, i]
        state = smoothed
        done = iteration + 1
        if moved <= epsilon * epsilon:
            break
    total = 0.0
    matched = 0
    for t in range(scans):
        matched += count[t] > 0
        for i in range(count[t]):
            north, east = position[t, i, 0] - z[t, 0], position[t, i, 1] - z[t, 1]
            total += weight[t, i] * (north * north + east * east)
    return state, covariance, weight, done, math.sqrt(total / max(1, matched))
