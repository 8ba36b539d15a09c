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
from isogal.compiled import kernel
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching.baselines.baseline import Baseline
from isogal.matching.baselines.readings import ReadingArrays, UsableReadings, publish_posterior
from isogal.matching.failures import UNEXPLAINED
from isogal.matching.interfaces import Batch, Fix, declined


class SitanOptions(BaseModel):
    """Options of `sitan`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    region: float = Field(
        1.5,
        ge=0.0,
        description="half-width of the fitted plane in 1-sigma of the position; 0 = gradient",
    )
    gate: float | None = Field(
        None, gt=0.0, description="innovations beyond so many 1-sigma are left out; null = none"
    )


class Sitan(Baseline[SitanOptions]):
    """Settings of the matcher; it carries nothing from batch to batch: the estimate is the
    navigator's."""

    name = "sitan"
    options_model = SitanOptions

    def solve(self, batch: Batch, field_map: FieldMap, readings: UsableReadings) -> Fix:
        """Return the fix of a batch (see `Baseline`)."""
        start = np.zeros((5, 5))
        start[:4, :4] = batch.prior
        start[4, 4] = self.noise.bias_sigma**2
        gate = np.inf if self.options.gate is None else self.options.gate
        mean, covariance, used, misfit = _filter(readings.arrays, start, self.options.region, gate)
        figures = {"readings_used": float(used), "misfit": misfit / max(used, 1)}
        if used == 0:
            figures[UNEXPLAINED] = 1.0
            return declined(batch, "no reading agrees with the map within the gate", **figures)
        return publish_posterior(batch, mean[:4], covariance[:4, :4], figures)


@kernel
def plane(
    grid: Grid,
    latitude: float,
    longitude: float,
    half: tuple[float, float],
    metres: tuple[float, float],
) -> tuple[float, float, float, float]:
    """Fit a plane to the map over a box: value and slopes (unit/m) at its centre, and variance of
    what the plane leaves.

    Least squares on a lattice of 5 x 5 points. Half-widths north and east in m, metres per radian
    of latitude and longitude. All NaN where the map is missing."""
    total = by_north = by_east = square = 0.0
    for i in range(-2, 3):
        for j in range(-2, 3):
            value = value_and_gradient(
                grid,
                latitude + 0.5 * i * half[0] / metres[0],
                longitude + 0.5 * j * half[1] / metres[1],
            )[0]
            total += value
            square += value * value
            by_north += 0.5 * i * value
            by_east += 0.5 * j * value
    mean = total / 25.0
    # sum of (i/2)² over the lattice: 5 (1 + 1/4 + 0 + 1/4 + 1)
    slope_north, slope_east = by_north / 12.5, by_east / 12.5
    left = (
        square - 25.0 * mean * mean - 12.5 * (slope_north * slope_north + slope_east * slope_east)
    ) / 25.0
    return mean, slope_north / half[0], slope_east / half[1], max(left, 0.0)


@kernel
def _map_at(
    readings: ReadingArrays, t: int, mean: Array, P: Array, region: float
) -> tuple[float, float, float, float]:
    """Return the map's value at the estimate of scan t, its slopes north and east (unit/m), and
    the variance that the plane leaves."""
    transition, radian = readings.transition, readings.radian
    north = east = spread_north = spread_east = 0.0
    for i in range(4):
        north += transition[t, 0, i] * mean[i]
        east += transition[t, 1, i] * mean[i]
        for j in range(4):
            spread_north += transition[t, 0, i] * P[i, j] * transition[t, 0, j]
            spread_east += transition[t, 1, i] * P[i, j] * transition[t, 1, j]
    latitude = readings.latitude[t] - north * radian[t, 0]
    longitude = readings.longitude[t] - east * radian[t, 1]
    half = (region * np.sqrt(spread_north), region * np.sqrt(spread_east))
    if half[0] > 1.0 and half[1] > 1.0:
        metres = (1.0 / radian[t, 0], 1.0 / radian[t, 1])
        return plane(readings.grid, latitude, longitude, half, metres)
    # below a metre a plane is the gradient
    value, by_lat, by_lon = value_and_gradient(readings.grid, latitude, longitude)
    return value, by_lat * radian[t, 0], by_lon * radian[t, 1], 0.0


@kernel
def _filter(
    readings: ReadingArrays, start: Array, region: float, gate: float
) -> tuple[Array, Array, int, float]:
    """Run all scans: mean (5,) and covariance (5, 5) of (xi, bias), readings used, sum of their
    squared normalised innovations."""
    transition, jacobian = readings.transition, readings.jacobian
    mean = np.zeros(5)
    P = start.copy()
    h = np.zeros(5)
    Ph = np.zeros(5)
    used = 0
    misfit = 0.0
    for t in range(readings.level.shape[0]):
        value, slope_north, slope_east, left = _map_at(readings, t, mean, P, region)
        if np.isnan(value):
            continue
        expected = 0.0
        for i in range(4):
            expected += jacobian[t, i] * mean[i]
            h[i] = (
                jacobian[t, i]
                - slope_north * transition[t, 0, i]
                - slope_east * transition[t, 1, i]
            )
        h[4] = 1.0
        S = readings.sigma[t] * readings.sigma[t] + left
        for i in range(5):
            Ph[i] = 0.0
            for j in range(5):
                Ph[i] += P[i, j] * h[j]
            S += h[i] * Ph[i]
        innovation = readings.level[t] - value - expected - mean[4]
        if innovation * innovation > gate * gate * S:
            continue
        used += 1
        misfit += innovation * innovation / S
        for i in range(5):
            mean[i] += Ph[i] * innovation / S
            for j in range(5):
                P[i, j] -= Ph[i] * Ph[j] / S
    return mean, P, used, misfit
