"""`least-squares`: the shift of the whole batch for which readings and map differ least.

The mean square of the residuals, each in units of its 1-sigma, is computed on a grid of shifts
around the navigator's positions. From the best node Gauss-Newton steps lead to the minimum, where
the curvature is the inverse covariance of the shift. Where the residuals are larger than their
1-sigma, the covariance grows by their mean square."""

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import (
    UsableReadings,
    publish_measured,
    shift_covariance,
)
from isogal.matching.interfaces import Batch, Fix, declined


class LeastSquaresOptions(BaseModel):
    """Options of `least-squares` (``--set matcher.options.nodes=81``)."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    window: float = Field(
        3.0, gt=0.0, description="half-width of the search in 1-sigma of the navigator's position"
    )
    nodes: int = Field(41, ge=5, le=401, description="nodes of the search grid along a side")
    steps: int = Field(10, ge=1, description="Gauss-Newton steps")


class LeastSquares(Baseline[LeastSquaresOptions]):
    """The matcher; it carries nothing from batch to batch."""

    name = "least-squares"
    options_model = LeastSquaresOptions
    whole = True

    @property
    def fewest(self) -> int:
        """Readings that a fix needs: a shift has two components."""
        return 4

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        half = self.options.window * np.sqrt(np.diag(batch.prior)[:2])
        side = np.linspace(-1.0, 1.0, self.options.nodes)
        grid = np.stack(np.meshgrid(*(side * width for width in half), indexing="ij"), axis=-1)
        sigma = readings.sigma
        shifts = np.pad(grid.reshape(-1, 2), ((0, 0), (0, 2)))  # the velocity error is taken as 0
        residual, _ = readings.linearise(field_map, shifts)
        misfit = ((residual / sigma[:, None]) ** 2).mean(axis=0)
        if not np.isfinite(misfit).any():
            return declined(batch, "no shift in the search window lies on the map")
        xi = shifts[np.nanargmin(misfit)]
        for _ in range(self.options.steps):
            residual, slope = readings.linearise(field_map, xi)
            if not np.isfinite(residual).all():
                return declined(batch, "the best shift lies at the edge of the map")
            weighted = slope[:, :2] / sigma[:, None]
            xi[:2] -= np.linalg.lstsq(weighted, residual / sigma, rcond=None)[0]
        if (np.abs(xi[:2]) > half).any():
            return declined(batch, "no minimum in the search window")
        residual, slope = readings.linearise(field_map, xi)
        if not np.isfinite(slope).all():
            return declined(batch, "the best shift lies at the edge of the map")
        ratio = float(np.sum((residual / sigma) ** 2)) / (len(readings) - 2)
        seen = sigma * max(1.0, np.sqrt(ratio))
        covariance = shift_covariance(slope, seen, batch.prior[2:, 2:], 10.0 * float(half.max()))
        if np.linalg.eigvalsh(covariance)[0] > half.max() ** 2:
            return declined(batch, "the map is too flat for the search window")
        return publish_measured(batch, xi[:2], covariance, {"chi_square_ratio": ratio})
