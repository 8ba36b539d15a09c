"""`tercom`: terrain contour matching, the mean absolute difference over a grid of shifts.

Source: Golden (1980), "Terrain contour matching (TERCOM): a cruise missile guidance aid", Proc.
SPIE 238:10-18. The profile of the batch is compared with the map at every shift of the navigator's
track in a window; the fix is the shift of least mean absolute difference (MAD), refined on a ten
times finer grid. The source uses no prior but the window, gives no covariance, and takes the track
as rigid.

Added here, since a navigator needs it: the covariance is the curvature of the residuals at the fix
(`readings.shift_covariance`), their noise the larger of what is assumed and what is seen, pi/2
above that of least squares (the efficiency of least absolute differences on Gaussian noise). Where
more than a share of the likelihood over the window lies far from the fix, the spread of that
likelihood is added, and where that is as wide as half the window there is no fix."""

import math
from typing import NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import (
    UsableReadings,
    publish_measured,
    shift_covariance,
)
from isogal.matching.interfaces import Batch, Fix, declined

LEAST_HALF_WIDTH = 300.0
"""m, of the window."""
MOST_POINTS = 81
"""Of the search grid along a side; beyond that its step grows."""
AMBIGUITY = 0.05
"""Share of likelihood far from the fix that is tolerated."""


class TercomOptions(BaseModel):
    """Options of `tercom`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    window: float = Field(
        3.5,
        gt=0.0,
        description="half-width of the search window in 1-sigma of the navigator's position",
    )
    step: float = Field(100.0, gt=0.0, description="step of the search grid, m")
    min_scans: int = Field(8, ge=3, description="readings that a fix needs")


class Tercom(Baseline[TercomOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "tercom"
    options_model = TercomOptions
    whole = True

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        half = np.maximum(
            self.options.window * np.sqrt(np.diag(batch.prior)[:2]), LEAST_HALF_WIDTH
        )
        side = [self._side(width) for width in half]
        window = _Window(half, side, *self._search(readings, side))
        if not np.isfinite(window.absolute).any():
            return declined(batch, "no shift in the search window lies on the map")
        coarse = _least(window.absolute, side)
        fine = [
            middle + np.linspace(-width, width, 21)
            for middle, width in zip(coarse, (line[1] - line[0] for line in side), strict=True)
        ]
        near, _ = self._search(readings, fine)
        best = _least(near, fine)
        return self._assess(batch, field_map, readings, window, best, float(np.nanmin(near)))

    def _side(self, half: float) -> Array:
        count = min(2 * math.ceil(half / self.options.step) + 1, MOST_POINTS)
        return np.linspace(-half, half, count)

    def _search(self, readings: UsableReadings, side: list[Array]) -> tuple[Array, Array]:
        """Return mean absolute and mean square difference (n, m) at the shifts of two sides (n,)
        north and (m,) east, m; NaN off the map."""
        found = []
        for north in side[0]:
            shift = np.stack(np.broadcast_arrays(north, side[1]), axis=-1)
            residual, *_ = readings.compared(shift @ readings.transition[:, :, :2].swapaxes(1, 2))
            residual -= readings.jacobian[:, :2] @ shift.T
            if self.bias_sigma > 0.0:  # an unknown constant takes the mean off
                residual -= residual.mean(axis=0)
            found.append((np.abs(residual).mean(axis=0), (residual**2).mean(axis=0)))
        absolute, square = np.stack(found, axis=1)
        return absolute, square

    def _assess(
        self,
        batch: Batch,
        field_map: FieldMap,
        readings: UsableReadings,
        window: "_Window",
        best: Array,
        mad: float,
    ) -> Fix:
        """Return the fix of the best shift (2,) m with its covariance, or the reason for none."""
        count = len(readings)
        widest = float(window.half.max())
        # of Gaussian residuals the mean absolute value is sqrt(2/pi) sigma; the shift has used up
        # two of them
        seen = mad * math.sqrt(math.pi / 2.0) * math.sqrt(count / (count - 2.0))
        sigma = np.maximum(readings.sigma, seen)
        _, slope = readings.linearise(field_map, np.concatenate([best, [0.0, 0.0]]))
        if not np.isfinite(slope).all():
            return declined(
                batch, "the best shift lies at the edge of the map", mean_absolute_difference=mad
            )
        curvature = shift_covariance(slope, sigma, batch.prior[2:, 2:], 10.0 * widest)
        covariance = 0.5 * math.pi * curvature
        weight = window.likelihood(count / float(np.mean(sigma**2)))
        away = np.stack(np.meshgrid(*window.side, indexing="ij"), axis=-1) - best
        # a grid point stands for its cell, which may be wider than the minimum
        cell = np.diag([(line[1] - line[0]) ** 2 for line in window.side])
        far = np.einsum("ijk,kl,ijl->ij", away, np.linalg.inv(covariance + cell), away) > 16.0
        figures = {"mean_absolute_difference": mad, "ambiguity": float(weight[far].sum())}
        if figures["ambiguity"] > AMBIGUITY:
            covariance = np.einsum("ij,ijk,ijl->kl", weight, away, away) + covariance
            if np.linalg.eigvalsh(covariance)[1] > (0.5 * widest) ** 2:
                return declined(
                    batch, "no unique shift of least difference in the search window", **figures
                )
        if np.linalg.eigvalsh(covariance)[0] > widest**2:
            return declined(batch, "the map is too flat for the search window", **figures)
        return publish_measured(batch, best, covariance, figures)


class _Window(NamedTuple):
    """The search window and the differences in it."""

    half: Array
    """(2,) m, half-widths."""
    side: list[Array]
    """Shifts north and east, m."""
    absolute: Array
    """Mean absolute difference at each shift; NaN off the map."""
    square: Array
    """Mean square difference."""

    def likelihood(self, weight: float) -> Array:
        """Return the likelihood of each shift, sum 1, where the mean square has a weight."""
        above = np.nan_to_num(self.square - np.nanmin(self.square), nan=np.inf)
        likelihood = np.exp(-0.5 * weight * above)
        return likelihood / likelihood.sum()


def _least(difference: Array, side: list[Array]) -> Array:
    """Return the shift (2,) of the least difference."""
    i, j = np.unravel_index(int(np.nanargmin(difference)), difference.shape)
    return np.array([side[0][i], side[1][j]])
