"""`sitan`: an extended Kalman filter on the map's gradient, one update a scan.

Sources: Hostetler & Andreas (1983), "Nonlinear Kalman filtering techniques for terrain-aided
navigation", IEEE Trans. Automatic Control 28(3):315-323, sections on SITAN's local linearisation:
the slope is that of a plane fitted to the map over the region where the vehicle may be, and the
residuals of the plane are noise of the measurement.

State: the navigator's error at the batch end (position and velocity; docs/mathematics.md, section
4.1) and the unknown bias of the readings; scans are taken in their order, each slope at the
estimate after the scans before it. A posterior from a wrong slope is overconfident: with an
initial error larger than about a map feature this filter diverges, as its source says of
single-filter SITAN."""

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from isogal.arrays import Array
from isogal.maps.field_map import FieldMap
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import UsableReadings, publish_posterior
from isogal.matching.interfaces import Batch, Fix, declined

_LATTICE = np.linspace(-1.0, 1.0, 5)
"""Of the points that a plane is fitted to, along a side, in half-widths of the region."""


class SitanOptions(BaseModel):
    """Options of `sitan`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    region: float = Field(
        1.5,
        ge=0.0,
        description="half-width of the fitted plane in 1-sigma of the position; 0 = gradient",
    )


class Sitan(Baseline[SitanOptions]):
    """Settings of the matcher; it carries nothing from batch to batch: the estimate is the
    navigator's."""

    name = "sitan"
    options_model = SitanOptions

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        mean, covariance = np.zeros(5), np.zeros((5, 5))
        covariance[:4, :4] = batch.prior
        covariance[4, 4] = self.bias_sigma**2
        used, misfit = 0, 0.0
        for t in range(len(readings)):
            level, h, variance = _linear(readings, t, mean, covariance, self.options.region)
            across = covariance @ h
            S = variance + h @ across
            innovation = level - h[4] * mean[4]
            if not np.isfinite(innovation):  # off the map
                continue
            used, misfit = used + 1, misfit + float(innovation**2 / S)
            mean = mean + across * innovation / S
            covariance = covariance - np.outer(across, across) / S
        figures = {"readings_used": float(used), "misfit": misfit / max(used, 1)}
        if used == 0:
            return declined(batch, "no reading has the map around it", **figures)
        return publish_posterior(batch, mean[:4], covariance[:4, :4], figures)


def plane(values: Array, half: Array) -> tuple[float, Array, float]:
    """Fit a plane by least squares.

    Parameters
    ----------
    values : (5, 5) array
        Of a map on a lattice over a box.
    half : (2,) array
        Half-widths of the box to north and to east, m.

    Returns
    -------
    value, (2,) slopes, variance
        At the middle, north and east (unit/m), and of what the plane leaves. NaN where the map is
        missing.
    """
    mean = float(values.mean())
    # sum of _LATTICE² over its 25 points: 5 (1 + 1/4 + 0 + 1/4 + 1)
    slope = np.array([_LATTICE @ values.sum(axis=1), _LATTICE @ values.sum(axis=0)]) / 12.5
    left = ((values**2).sum() - 25.0 * mean**2 - 12.5 * (slope @ slope)) / 25.0
    return mean, slope / half, max(float(left), 0.0)


def _linear(
    readings: UsableReadings, t: int, mean: Array, covariance: Array, region: float
) -> tuple[float, Array, float]:
    """Return what the estimate (5,), (5, 5) of xi and bias leaves of reading t, but for the bias,
    the reading's derivative (5,) by them, and the variance of its noise."""
    transition, jacobian = readings.transition[t], readings.jacobian[t]
    moved = transition @ mean[:4]
    spread = transition @ covariance[:4, :4] @ transition.T
    half, left = region * np.sqrt(np.diag(spread)), 0.0
    if (half > 1.0).all():
        lattice = np.stack(np.meshgrid(*np.outer(half, _LATTICE), indexing="ij"), axis=-1)
        around = readings.compared(moved - lattice[None], slice(t, t + 1))[0][0]
        level, slope, left = plane(around, half)
        slope = -slope  # of the map
    else:  # below a metre a plane is the gradient
        level, *by_place = (
            float(one[0]) for one in readings.compared(moved[None], slice(t, t + 1))
        )
        slope = np.array(by_place)
    h = np.append(jacobian - slope @ transition, 1.0)
    return level - float(jacobian @ mean[:4]), h, readings.sigma[t] ** 2 + left
