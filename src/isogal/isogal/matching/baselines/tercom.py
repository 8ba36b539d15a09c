"""`tercom`: terrain contour matching, the mean absolute difference over a grid of shifts.

Source: Golden (1980), "Terrain contour matching (TERCOM): a cruise missile guidance aid", Proc.
SPIE 238:10-18. The profile of the batch is compared with the map at every shift of the navigator's
track in a window; the fix is the shift of least mean absolute difference (MAD), refined on a ten
times finer grid. The source uses no prior but the window, gives no covariance, and takes the track
as rigid.

Added here, since a navigator needs it: the covariance is the curvature of the residuals at the fix
(`scans.shift_covariance`), their noise the larger of what is assumed and what is seen, pi/2 above
that of least squares (the efficiency of least absolute differences on Gaussian noise). Where more
than a share of the likelihood over the window lies far from the fix, the spread of that likelihood
is added, and where that is as wide as half the window there is no fix."""

import math

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import Scans, publish_measured, shift_covariance
from isogal.matching.interfaces import Batch, Fix, declined


class TercomOptions(BaseModel):
    """Options of `tercom`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    window: float = Field(
        3.5,
        gt=0.0,
        description="half-width of the search window in 1-sigma of the navigator's position",
    )
    min_half_width: float = Field(300.0, gt=0.0, description="least half-width, m")
    step: float = Field(100.0, gt=0.0, description="step of the search grid, m")
    max_points: int = Field(
        81, ge=5, le=1001, description="grid points along a side; beyond that the step grows"
    )
    remove_mean: bool | None = Field(
        None, description="compare profiles less their means; null = where bias_sigma > 0"
    )
    ambiguity: float = Field(
        0.05,
        ge=0.0,
        le=1.0,
        description="share of likelihood far from the fix that is put up with",
    )
    min_scans: int = Field(8, ge=3, description="readings that a fix needs")


class Tercom(Baseline[TercomOptions]):
    """Settings of the matcher; it carries nothing from batch to batch."""

    name = "tercom"
    options_model = TercomOptions
    whole = True

    @property
    def fewest(self) -> int:
        """Readings that a fix needs."""
        return self.options.min_scans

    def solve(self, batch: Batch, field_map: FieldMap, scans: Scans) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        half = np.maximum(
            self.options.window * np.sqrt(np.diag(batch.prior)[:2]), self.options.min_half_width
        )
        side = [self._side(width) for width in half]
        mad, square = self._search(scans, np.zeros(2), side)
        if not np.isfinite(mad).any():
            return declined(batch, "no shift in the search window lies on the map")
        at = np.unravel_index(int(np.nanargmin(mad)), mad.shape)
        coarse = np.array([side[0][at[0]], side[1][at[1]]])
        step = [line[1] - line[0] for line in side]
        fine = [np.linspace(-width, width, 21) for width in step]
        near, _ = self._search(scans, coarse, fine)
        best_at = np.unravel_index(int(np.nanargmin(near)), near.shape)
        best = coarse + np.array([fine[0][best_at[0]], fine[1][best_at[1]]])
        return self._publish(
            batch, field_map, scans, best, float(near[best_at]), side, square, half
        )

    def _side(self, half: float) -> Array:
        count = min(2 * math.ceil(half / self.options.step) + 1, self.options.max_points)
        return np.linspace(-half, half, count)

    def _search(self, scans: Scans, centre: Array, side: list[Array]) -> tuple[Array, Array]:
        remove = (
            self.noise.bias_sigma > 0.0
            if self.options.remove_mean is None
            else self.options.remove_mean
        )
        return _differences(
            scans.grid, scans.latitude, scans.longitude, scans.radian, scans.level, scans.transition, scans.jacobian,
            centre[0] + side[0], centre[1] + side[1], remove,
        )  # fmt: skip

    def _publish(
        self,
        batch: Batch,
        field_map: FieldMap,
        scans: Scans,
        best: Array,
        mad: float,
        side: list[Array],
        square: Array,
        half: Array,
    ) -> Fix:
        count = len(scans)
        # of Gaussian residuals the mean absolute value is sqrt(2/pi) sigma; two of them went into
        # the shift
        seen = mad * math.sqrt(math.pi / 2.0) * math.sqrt(count / (count - 2.0))
        sigma = np.maximum(scans.sigma, seen)
        _, slope = scans.linearise(field_map, np.concatenate([best, [0.0, 0.0]]))
        if not np.isfinite(slope).all():
            return declined(
                batch, "the best shift lies at the edge of the map", mean_absolute_difference=mad
            )
        covariance = (
            0.5
            * math.pi
            * shift_covariance(slope, sigma, batch.prior[2:, 2:], 10.0 * float(half.max()))
        )
        weight = np.exp(
            -0.5
            * count
            * np.nan_to_num(square - np.nanmin(square), nan=np.inf)
            / np.mean(sigma**2)
        )
        weight /= weight.sum()
        away = np.stack(np.meshgrid(*side, indexing="ij"), axis=-1) - best
        # a grid point stands for its cell, which may be wider than the minimum
        cell = np.diag([(line[1] - line[0]) ** 2 for line in side])
        far = np.einsum("ijk,kl,ijl->ij", away, np.linalg.inv(covariance + cell), away) > 16.0
        figures = {"mean_absolute_difference": mad, "ambiguity": float(weight[far].sum())}
        if figures["ambiguity"] > self.options.ambiguity:
            covariance = np.einsum("ij,ijk,ijl->kl", weight, away, away) + covariance
            if np.linalg.eigvalsh(covariance)[1] > (0.5 * half.max()) ** 2:
                return declined(
                    batch, "no unique shift of least difference in the search window", **figures
                )
        if np.linalg.eigvalsh(covariance)[0] > half.max() ** 2:
            return declined(batch, "the map is too flat for the search window", **figures)
        return publish_measured(batch, best, covariance, figures)


@kernel
def _differences(
    grid: Grid,
    latitude: Array,
    longitude: Array,
    radian: Array,
    level: Array,
    transition: Array,
    jacobian: Array,
    north: Array,
    east: Array,
    remove_mean: bool,
) -> tuple[Array, Array]:
    """Mean absolute and mean square difference at the shifts north[i], east[j] (position error at
    the batch end, m); NaN off the map."""
    count = level.shape[0]
    absolute = np.empty((north.shape[0], east.shape[0]))
    square = np.empty((north.shape[0], east.shape[0]))
    residual = np.empty(count)
    for i in range(north.shape[0]):
        for j in range(east.shape[0]):
            mean = 0.0
            for t in range(count):
                move_north = transition[t, 0, 0] * north[i] + transition[t, 0, 1] * east[j]
                move_east = transition[t, 1, 0] * north[i] + transition[t, 1, 1] * east[j]
                value = value_and_gradient(
                    grid,
                    latitude[t] - move_north * radian[t, 0], longitude[t] - move_east * radian[t, 1],
                )[0]  # fmt: skip
                residual[t] = (
                    level[t] - value - jacobian[t, 0] * north[i] - jacobian[t, 1] * east[j]
                )
                mean += residual[t] / count
            absolute[i, j] = square[i, j] = 0.0
            for t in range(count):
                difference = residual[t] - mean if remove_mean else residual[t]
                absolute[i, j] += abs(difference) / count
                square[i, j] += difference * difference / count
    return absolute, square
