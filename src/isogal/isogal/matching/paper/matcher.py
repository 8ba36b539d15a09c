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
- The covariance is T times P_{T|T}, as if the errors of the T associations were one: what lies
  farther off the track than that, T times R-bar, is in no covariance. `largest_residual` stops
  aiding above such a residual; as in the paper it is not used unless given. Over the paper's route
  it was 10 at most in 3,900 batches; it is above 30 where the velocity may be so wrong that the
  windows of later scans hold other tracks.
- A scan counts only where the map has a value at the navigator's position: a window cut off at the
  edge would pull inwards.

Known faults, kept because they are the paper's: the candidates' spread about their mean is in no
covariance; the navigator's prior is in P_{T|T} and is used again when the navigator takes the fix;
x_1 of one iteration is the smoothed x_1 of the last, which is not independent of the readings; no
error of the map, no unknown bias (`map_sigma` and `bias_sigma` have no effect); the first scan's
reading is never used (eq. forward). See docs/mathematics.md, section 13."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from isogal.arrays import Array
from isogal.earth.plane import Plane
from isogal.maps.channels import AnyMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.variability import feature_variability
from isogal.matching.interfaces import Batch, Candidates, Fix, declined
from isogal.matching.paper.iteration import (
    Estimate,
    PaperOptions,
    ScanCandidates,
    find_candidates,
    maximise,
)
from isogal.matching.registry import check_options
from isogal.matching.usability import too_few, unusable
from isogal.scenario import Matcher as MatcherSettings

REFERENCE_SIDE = 10
"""C_ref is the mean of C over this many places along each side of the map."""


@dataclass(frozen=True)
class PmhtPaper:
    """Settings of the matcher; `match` keeps the map's mean variability in its memory and nothing
    else."""

    options: PaperOptions = field(default_factory=PaperOptions)
    name: str = "pmht-paper"
    context: int = 0
    takes_channels: bool = False

    @classmethod
    def from_settings(cls, settings: MatcherSettings) -> "PmhtPaper":
        """Build it from the scenario; raises InputError on unknown or impossible options."""
        return cls(check_options("pmht-paper", settings.options, PaperOptions))

    def match(
        self, batch: Batch, field_map: AnyMap, memory: float | None
    ) -> tuple[Fix, float | None]:
        """Match one batch (see `interfaces.Matcher`)."""
        options, field_map = self.options, channels_of(field_map)[0]
        if reason := unusable(batch):
            return declined(batch, reason), memory
        reference = self._reference(field_map) if memory is None else memory
        variability = self._variability(batch, field_map, reference)
        if variability is None:
            return declined(batch, "the track is outside the map"), reference
        if variability < options.min_variability or variability == 0.0:
            reason = (
                f"map feature variability {variability:.2g} of the map's mean is below"
                f" {options.min_variability:g}"
            )
            return declined(batch, reason, feature_variability=variability), reference

        plane = Plane.at(batch.latitude[-1], batch.longitude[-1])
        candidates = find_candidates(batch, plane, field_map, options)
        usable = int(candidates.there.any(axis=1).sum())
        if reason := too_few(batch, usable, options.min_scans or max(1, len(batch) // 2)):
            return declined(batch, reason, feature_variability=variability), reference
        position = plane.metres(batch.latitude, batch.longitude)
        navigator = np.concatenate([position, batch.velocity], axis=1)
        result = maximise(navigator, _first_scan(batch), np.diff(batch.time), candidates, options)
        figures = {
            "feature_variability": variability,
            "iterations": float(result.iterations),
            "spread": result.spread,
            "residual": result.residual,
        }
        if options.largest_residual is not None and result.residual > options.largest_residual:
            reason = (
                f"the candidates are on no track: mean square residual {result.residual:.3g}, the"
                f" most is {options.largest_residual:g}"
            )
            return declined(batch, reason, **figures), reference
        return self._fix(batch, plane, figures, candidates, result), reference

    def _variability(self, batch: Batch, field_map: FieldMap, reference: float) -> float | None:
        """Return the mean of eq. CV over the batch, in units of C_ref; None off the map."""
        local = feature_variability(
            field_map, batch.latitude, batch.longitude, self.options.variability_window
        )
        known = local[np.isfinite(local)]
        if not known.size:
            return None
        return float(known.mean()) / reference if reference > 0.0 else 0.0

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

    def _fix(
        self,
        batch: Batch,
        plane: Plane,
        figures: Mapping[str, float],
        candidates: ScanCandidates,
        result: Estimate,
    ) -> Fix:
        """Return x_T with P_{T|T} weighted by the map feature variability, and what is said of
        the batch."""
        options, variability = self.options, figures["feature_variability"]
        factor = (
            options.covariance_factor or len(batch)
        ) * variability**-options.variability_exponent
        # where batches overlap each reading is used in T / new of them
        out = result.covariance[-1, :2, :2] * factor * (len(batch) / max(batch.new, 1))
        scan_covariance = np.full((len(batch), 2, 2), np.nan)
        # as many fixes together hold the information once
        scan_covariance[len(batch) - batch.new :] = batch.new * out
        latitude, longitude = plane.radians(result.state[:, :2])
        return Fix(
            time=float(batch.time[-1]),
            latitude=float(latitude[-1] + batch.end[0] - batch.latitude[-1]),
            longitude=float(longitude[-1] + batch.end[1] - batch.longitude[-1]),
            covariance=out,
            shown=lambda: _listed(plane, candidates, result.weight),
            diagnostics=figures,
            # late readings say where the vehicle was, not where it is at their stamps
            scan_position=None
            if batch.end_place is not None
            else np.stack([latitude, longitude], axis=-1),
            scan_covariance=scan_covariance,
        )


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


def _listed(plane: Plane, candidates: ScanCandidates, weight: Array) -> Candidates:
    """Return the candidates of all scans with their last weights."""
    kept = candidates.there
    latitude, longitude = plane.radians(candidates.position[kept])
    return Candidates(latitude, longitude, weight[kept], np.nonzero(kept)[0])
