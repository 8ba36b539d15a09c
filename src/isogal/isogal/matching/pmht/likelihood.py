"""The exact likelihood of a batch given the navigator's error, with the map's error correlated
along the track.

With xi the navigator's error at the batch end, the residual of scan t is

    r_t(xi) = reading_t - offset_t - reading_jacobian_t xi - map(p_t - transition_t xi)

and r = e + G d: e ~ N(0, R), R = diag(sigma_t² + q²/12) + sigma_map² exp(-|x_i - x_j| / L) +
sigma_bias² (SCIENCE 3), that is white noise of sensor and map quantisation q, map error with an
exponential covariance, an unknown constant; and d ~ N(0, 1) the navigator's drift within the batch
that xi does not explain, through the map's gradient and the reduction.

Where a map says how wrong it is from place to place, R is taken with the mean of sigma_map² over
where the readings may have been taken (the belief): the same R for every candidate. With an R of
its own for each, the determinants would decide between candidates, and they know the map's error
far less well than an exponential covariance of dense readings pretends.

Rows that an earlier batch has used come first (context). By the chain rule the new rows count
given the old: with R = L L' and w = L⁻¹ r, the last components of w are the innovations of the new
readings once the map error seen in the old ones is known, and D = (L⁻¹ G)_new what the drift does
to them; the navigator's prior of d already knows the old readings. So log p = -½ (|w|² - |C⁻¹ D'
w|²), C C' = 1 + D' D (Woodbury), and no reading counts twice."""

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.compiled import kernel
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.channels import ChannelMap, channels_of
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid, value_and_gradient
from isogal.matching.interfaces import Batch
from isogal.matching.pmht.noise_model import (
    NoiseModel,
    correlation_lengths,
    map_sigmas,
    residual_covariance,
)


@dataclass(frozen=True, slots=True, eq=False)
class BatchLikelihood:
    """A batch and a map as arrays for the kernel. T rows that have a reading."""

    grid: Grid
    latitude: Array
    """(T,) rad."""
    longitude: Array
    """(T,) rad."""
    radian: Array
    """(T, 2) radians of latitude and longitude per metre north and east."""
    level: Array
    """(T,) reading - offset."""
    transition: Array
    """(T, 2, 4)."""
    jacobian: Array
    """(T, 4)."""
    nuisance_position: Array
    """(T, 2, M)."""
    nuisance_reading: Array
    """(T, M)."""
    covariance: Array
    """(T, T) R: covariance of sensor, map and bias."""
    factor: Array
    """(T, T) lower Cholesky factor L of it."""
    projection: Array
    """(new, M) D C'⁻¹, what the drift explains of the whitened residuals."""
    first_new: int
    """Row of the first reading that no earlier batch has used."""
    rows: Integers
    """(T,) index of each row in the batch."""
    channel: Integers
    """(T,) index of each row's map."""

    @classmethod
    def of(
        cls,
        batch: Batch,
        field_map: FieldMap | ChannelMap,
        noise: NoiseModel,
        extra_variance: Array | None = None,
        belief: tuple[Array, Array] | None = None,
    ) -> "BatchLikelihood":
        """Prepare a batch; scans without a reading are left out.

        Parameters
        ----------
        extra_variance : (len(batch),) array, optional
            Added to the white variance of each scan (inf = leave the scan out), for readings that
            are not trusted.
        belief : ((4,), (4, 4)) arrays, optional
            Mean and covariance of xi over which a map error that differs from place to place is
            averaged; default: the batch's prior.
        """
        extra = np.zeros(len(batch)) if extra_variance is None else extra_variance
        rows = np.flatnonzero(np.isfinite(batch.reading) & np.isfinite(extra))
        latitude, longitude = batch.latitude[rows], batch.longitude[rows]
        maps = channels_of(field_map)
        channel = (
            np.zeros(len(rows), dtype=np.int64) if batch.channel is None else batch.channel[rows]
        )
        belief = belief or (np.zeros(4), batch.prior)
        own_sigma = map_sigmas(
            field_map, channel, latitude, longitude, batch.transition[rows], *belief
        )
        map_sigma = np.maximum(noise.map_sigma, own_sigma)
        rounding = np.array([one.quantisation**2 / 12.0 for one in maps])[channel]
        sensor = batch.sigma[rows] ** 2
        white = sensor + extra[rows] + rounding
        covariance = residual_covariance(
            latitude,
            longitude,
            white,
            map_sigma,
            correlation_lengths(field_map, channel, noise),
            noise.bias_sigma,
            channel if len(maps) > 1 else None,
        )
        if batch.reading_covariance is not None:
            covariance += batch.reading_covariance[np.ix_(rows, rows)] - np.diag(sensor)
        north, east = metres_per_radian(latitude)
        likelihood = cls(
            grid=field_map.grid,
            latitude=latitude,
            longitude=longitude,
            radian=np.stack([1.0 / north, 1.0 / east], axis=-1),
            level=batch.reading[rows] - batch.offset[rows],
            transition=np.ascontiguousarray(batch.transition[rows]),
            jacobian=np.ascontiguousarray(batch.reading_jacobian[rows]),
            nuisance_position=batch.nuisance_position[rows],
            nuisance_reading=batch.nuisance_reading[rows],
            covariance=covariance,
            factor=np.asarray(np.linalg.cholesky(covariance), dtype=np.float64),
            projection=np.empty((0, 0)),
            first_new=int(np.searchsorted(rows, len(batch) - batch.new)),
            rows=rows,
            channel=channel,
        )
        return likelihood.with_nuisance_at(np.zeros(4))

    def log(self, xi: Array) -> Array:
        """Return (S,) log-likelihood (without its constant) of the new readings at errors xi (S,
        4); -inf off the map."""
        return _log_likelihood(
            self.grid, self.channel, self.latitude, self.longitude, self.radian, self.level, self.transition, self.jacobian,
            self.factor, self.projection, self.first_new, np.ascontiguousarray(xi),
        )  # fmt: skip

    def residual(self, xi: Array) -> Array:
        """Return (T,) residuals at one error xi (4,); NaN off the map."""
        return self.linearise(xi)[0]

    def linearise(self, xi: Array) -> tuple[Array, Array]:
        """Return residuals (T,) and their derivative by xi (T, 4) at one error xi (4,)."""
        return _linearise(
            self.grid, self.channel, self.latitude, self.longitude, self.radian, self.level, self.transition, self.jacobian, xi
        )  # fmt: skip

    def nuisance_at(self, xi: Array) -> Array:
        """Return G (T, M), the residuals per unit of drift at the error xi (4,); zero where the
        map has no gradient."""
        position = xi @ self.transition.transpose(0, 2, 1)
        by_lat, by_lon = _slopes(
            self.grid,
            self.channel,
            self.latitude - position[:, 0] * self.radian[:, 0],
            self.longitude - position[:, 1] * self.radian[:, 1],
        )
        gradient = np.nan_to_num(np.stack([by_lat, by_lon], axis=-1) * self.radian)
        return np.einsum("ti,tij->tj", gradient, self.nuisance_position) - self.nuisance_reading

    def with_nuisance_at(self, xi: Array) -> "BatchLikelihood":
        """Return the likelihood with the map's gradient for the drift taken at the error xi
        (4,)."""
        drift = np.linalg.solve(self.factor, self.nuisance_at(xi))[self.first_new :]
        inner = np.linalg.cholesky(np.eye(drift.shape[1]) + drift.T @ drift)
        return replace(self, projection=np.ascontiguousarray(np.linalg.solve(inner, drift.T).T))

    def nuisance_given(self, xi: Array) -> tuple[Array, Array, Array]:
        """Return mean (M,), derivative by xi (M, 4) and covariance (M, M) of the drift d given the
        new readings and an error near xi (4,).

        The whitened new residuals are w = e - D d, with e and d ~ N(0, 1).
        """
        residual, slope = self.linearise(xi)
        white = np.linalg.solve(
            self.factor, np.column_stack([residual, slope, self.nuisance_at(xi)])
        )[self.first_new :]
        drift = white[:, 5:]
        covariance = np.asarray(np.linalg.inv(np.eye(drift.shape[1]) + drift.T @ drift))
        by = -covariance @ drift.T @ white[:, :5]
        return by[:, 0], by[:, 1:], covariance

    def scaled(self, variance: float) -> "BatchLikelihood":
        """Return the likelihood with R times a factor."""
        likelihood = replace(
            self, covariance=self.covariance * variance, factor=self.factor * np.sqrt(variance)
        )
        return likelihood.with_nuisance_at(np.zeros(4))

    def without(self, bad: Booleans) -> "BatchLikelihood":
        """Return the likelihood without some of its rows (T,)."""
        if not bad.any():
            return self
        good = ~bad
        covariance = self.covariance[np.ix_(good, good)]
        rows = (
            "latitude",
            "longitude",
            "radian",
            "level",
            "transition",
            "jacobian",
            "nuisance_position",
            "nuisance_reading",
            "rows",
            "channel",
        )
        kept: dict[str, Any] = {
            name: np.ascontiguousarray(getattr(self, name)[good]) for name in rows
        }
        likelihood = replace(
            self,
            **kept,
            covariance=covariance,
            factor=np.asarray(np.linalg.cholesky(covariance), dtype=np.float64),
            first_new=int(good[: self.first_new].sum()),
        )
        return likelihood.with_nuisance_at(np.zeros(4))

    def blurred(self, sigma: float, velocity: Array) -> "BatchLikelihood":
        """Return the likelihood for a position known to a cell only and a velocity error that is
        integrated out.

        Parameters
        ----------
        sigma : float
            1-sigma of another white noise on every row, for what the map changes within the cell.
        velocity : (2, 2) array
            Covariance of the velocity error, m²/s²; it enters by the reduction of the readings.
        """
        reduction = self.jacobian[:, 2:]
        covariance = (
            self.covariance
            + sigma**2 * np.eye(len(self.level))
            + reduction @ velocity @ reduction.T
        )
        likelihood = replace(
            self,
            covariance=covariance,
            factor=np.asarray(np.linalg.cholesky(covariance), dtype=np.float64),
        )
        return likelihood.with_nuisance_at(np.zeros(4))

    def misfit(self, xi: Array) -> float:
        """Return the chi-square of the new readings at xi (4,): -2 `log`."""
        return -2.0 * float(self.log(xi[None])[0])

    @property
    def new_count(self) -> int:
        """How many new readings there are."""
        return len(self.level) - self.first_new

    @property
    def log_normaliser(self) -> float:
        """Log of the constant that `log` leaves out, for comparing noise models."""
        white = float(np.log(np.diag(self.factor)[self.first_new :]).sum())
        # det(1 + D D') = 1 / det(1 - projection' projection)
        drift = np.linalg.slogdet(
            np.eye(self.projection.shape[1]) - self.projection.T @ self.projection
        )[1]
        return -white + 0.5 * float(drift) - 0.5 * math.log(2.0 * math.pi) * self.new_count


@kernel
def _slopes(grid, channel, latitude, longitude):  # type: ignore[no-untyped-def]
    """Return (T,) the map's derivatives by latitude and longitude, each row in its channel."""
    by_lat, by_lon = np.empty(latitude.shape[0]), np.empty(latitude.shape[0])
    for t in range(latitude.shape[0]):
        _, by_lat[t], by_lon[t] = value_and_gradient(grid, latitude[t], longitude[t], channel[t])
    return by_lat, by_lon


@kernel
def _log_likelihood(  # type: ignore[no-untyped-def]
    grid,
    channel,
    latitude,
    longitude,
    radian,
    level,
    transition,
    jacobian,
    factor,
    projection,
    first_new,
    xi,
):
    samples, rows = xi.shape[0], latitude.shape[0]
    out = np.empty(samples)
    whitened = np.empty(rows)
    inverse = np.empty(rows)
    diagonal = True
    for t in range(rows):
        inverse[t] = 1.0 / factor[t, t]
        for u in range(t):
            if factor[t, u] != 0.0:
                diagonal = False
    start = (
        first_new if diagonal else 0
    )  # without correlation the older rows say nothing about the new
    for s in range(samples):
        a, b, c, d = xi[s, 0], xi[s, 1], xi[s, 2], xi[s, 3]
        total = 0.0
        for t in range(start, rows):
            f, j = transition[t], jacobian[t]
            north = f[0, 0] * a + f[0, 1] * b + f[0, 2] * c + f[0, 3] * d
            east = f[1, 0] * a + f[1, 1] * b + f[1, 2] * c + f[1, 3] * d
            lat, lon = latitude[t] - north * radian[t, 0], longitude[t] - east * radian[t, 1]
            value, _, _ = value_and_gradient(grid, lat, lon, channel[t])
            r = level[t] - value - (j[0] * a + j[1] * b + j[2] * c + j[3] * d)
            if not diagonal:
                for u in range(t):
                    r -= factor[t, u] * whitened[u]
            r *= inverse[t]
            whitened[t] = r
            if t >= first_new:
                total += r * r
        for m in range(projection.shape[1]):
            explained = 0.0
            for t in range(first_new, rows):
                explained += projection[t - first_new, m] * whitened[t]
            total -= explained * explained
        out[s] = -0.5 * total if math.isfinite(total) else -np.inf
    return out


@kernel
def _linearise(  # type: ignore[no-untyped-def]
    grid,
    channel,
    latitude,
    longitude,
    radian,
    level,
    transition,
    jacobian,
    xi,
):
    rows = latitude.shape[0]
    residual = np.empty(rows)
    slope = np.empty((rows, 4))
    for t in range(rows):
        north = 0.0
        east = 0.0
        known = level[t]
        for i in range(4):
            north += transition[t, 0, i] * xi[i]
            east += transition[t, 1, i] * xi[i]
            known -= jacobian[t, i] * xi[i]
        lat, lon = latitude[t] - north * radian[t, 0], longitude[t] - east * radian[t, 1]
        value, by_lat, by_lon = value_and_gradient(grid, lat, lon, channel[t])
        residual[t] = known - value
        for i in range(4):
            slope[t, i] = (
                by_lat * radian[t, 0] * transition[t, 0, i]
                + by_lon * radian[t, 1] * transition[t, 1, i]
                - jacobian[t, i]
            )
    return residual, slope
