"""What the baseline matchers share: the readings of a batch as arrays, and how a posterior or a
measured position becomes a fix.

The baselines follow their sources, which know no correlated map error: the map's error is white
noise added to the sensor's. With xi the navigator's error at the batch end (docs/mathematics.md,
section 4.1), the residual of a reading is

    r_t(xi) = level_t - jacobian_t xi - map(p_t - transition_t xi).
"""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Booleans, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid, values_and_gradients
from isogal.matching.information import likelihood_information, measurement_only
from isogal.matching.interfaces import (
    Batch,
    Candidates,
    Fix,
    Information,
    declined,
    located,
    with_scans,
)


@dataclass(frozen=True, slots=True, eq=False)
class UsableReadings:
    """The N readings of a batch that can be used: there is a reading, and the map around it."""

    grid: Grid
    latitude: Array
    """(N,) rad, the navigator's."""
    longitude: Array
    """(N,) rad."""
    radian: Array
    """(N, 2) radians of latitude and longitude per metre north and east."""
    level: Array
    """(N,) reading less its known offset."""
    sigma: Array
    """(N,) 1-sigma of sensor, map, quantisation and of what tilt and heading put into the
    reduction, all as white noise."""
    transition: Array
    """(N, 2, 4) position error (m) per unit of xi."""
    jacobian: Array
    """(N, 4) d(reading)/d(xi) by the reduction."""
    row: Integers
    """(N,) index of each in the batch."""

    @classmethod
    def of(
        cls, batch: Batch, field_map: FieldMap, map_sigma: float = 0.0, whole: bool = True
    ) -> "UsableReadings":
        """Collect readings.

        Parameters
        ----------
        batch : Batch
        field_map : FieldMap
        map_sigma : float
            White 1-sigma of the map's error; where the map states a larger one, that counts.
        whole : bool
            Whether those that an earlier batch has used count as well.
        """
        usable = np.isfinite(batch.reading) & field_map.covers(batch.latitude, batch.longitude)
        if not whole:
            usable[: len(batch) - batch.new] = False
        row = np.flatnonzero(usable)
        latitude, longitude = batch.latitude[row], batch.longitude[row]
        stated = np.nan_to_num(field_map.sigma_at(latitude, longitude))
        of_map = np.maximum(map_sigma, stated)
        variance = batch.sigma[row] ** 2 + of_map**2 + field_map.quantisation**2 / 12.0
        variance = variance + (batch.nuisance[row, 2] ** 2).sum(axis=1)
        north, east = metres_per_radian(latitude)
        return cls(
            grid=field_map.grid,
            latitude=latitude,
            longitude=longitude,
            radian=np.stack([1.0 / north, 1.0 / east], axis=-1),
            level=batch.reading[row],
            sigma=np.sqrt(variance),
            transition=np.ascontiguousarray(batch.transition[row]),
            jacobian=np.ascontiguousarray(batch.reading_jacobian[row]),
            row=row,
        )

    def __len__(self) -> int:
        return self.row.shape[0]

    def places(self, moved: Array, which: Booleans | slice = slice(None)) -> Candidates:
        """Return where some of the readings were taken if the navigator was off, (n, 2) m; see
        `compared`."""
        north, east = moved.T
        return Candidates(
            latitude=self.latitude[which] - north * self.radian[which, 0],
            longitude=self.longitude[which] - east * self.radian[which, 1],
            weight=np.ones(len(moved)),
            scan=self.row[which],
        )

    def compared(self, moved: Array, which: slice = slice(None)) -> tuple[Array, Array, Array]:
        """Compare readings with the map where they were taken if the navigator was off.

        Parameters
        ----------
        moved : (n, ..., 2) array
            Position errors of the navigator at some of the readings, m north and east.
        which : slice
            Which of the N readings these n are.

        Returns
        -------
        (n, ...) arrays
            Readings less the map, what a reduction adds to them not taken off, and the map's
            slopes to north and to east, unit/m; NaN off the map.
        """
        shape = (-1,) + (1,) * (moved.ndim - 2)
        north, east = (self.radian[which, k].reshape(shape) for k in range(2))
        latitude = self.latitude[which].reshape(shape) - moved[..., 0] * north
        longitude = self.longitude[which].reshape(shape) - moved[..., 1] * east
        value, by_latitude, by_longitude = (
            found.reshape(latitude.shape)
            for found in values_and_gradients(self.grid, latitude.ravel(), longitude.ravel())
        )
        level = self.level[which].reshape(shape)
        return level - value, by_latitude * north, by_longitude * east

    def linearise(self, field_map: FieldMap, xi: Array) -> tuple[Array, Array]:
        """Return residuals (N, ...) at errors xi (..., 4) and their derivatives by xi
        (N, ..., 4); NaN off the map."""
        shape = (-1,) + (1,) * (xi.ndim - 1)
        difference, north, east = self.compared(np.einsum("tij,...j->t...i", self.transition, xi))
        by_north, by_east, jacobian = (
            column.reshape(*shape, 4)
            for column in (self.transition[:, 0], self.transition[:, 1], self.jacobian)
        )
        slope = north[..., None] * by_north + east[..., None] * by_east - jacobian
        return difference - np.einsum("tj,...j->t...", self.jacobian, xi), slope

    def velocity_variance(self, velocity: Array) -> Array:
        """Return the variance (N,) that a velocity error of covariance (2, 2) adds to the readings
        by their reduction."""
        by_velocity = self.jacobian[:, 2:]
        return np.einsum("ti,ij,tj->t", by_velocity, velocity, by_velocity)


def shift_covariance(slope: Array, sigma: Array, velocity: Array, limit: float) -> Array:
    """Covariance of the position shift that least squares on one batch gives, from the curvature
    of the sum of squared residuals.

    Parameters
    ----------
    slope : (N, 4) array
        d(residual)/d(xi).
    sigma : (N,) array
        1-sigma of each residual.
    velocity : (2, 2) array
        Covariance of the navigator's velocity error: the shift does not contain it, and it moves
        the scans within the batch.
    limit : float
        Largest 1-sigma, m: of a direction of which the readings say nothing.

    Returns
    -------
    (2, 2) array
        m².
    """
    weighted = slope[:, :2] / sigma[:, None] ** 2
    values, vectors = np.linalg.eigh(slope[:, :2].T @ weighted)
    inverse = (vectors / np.maximum(values, limit**-2)) @ vectors.T
    leak = inverse @ weighted.T @ slope[:, 2:]
    return inverse + leak @ velocity @ leak.T


def publish_posterior(
    batch: Batch,
    mean: Array,
    covariance: Array,
    diagnostics: dict[str, float],
    candidates: Candidates | None = None,
    position_only: bool = False,
    least_gain: float = 1e-4,
) -> Fix:
    """Turn the posterior N(mean, covariance) of xi into a fix of the measurements alone
    (docs/mathematics.md, sections 7.1 and 7.4).

    Parameters
    ----------
    batch : Batch
    mean, covariance : (4,), (4, 4) arrays
        m and m/s.
    diagnostics : dict
        Figures of the fix, by name.
    candidates : Candidates, optional
        Places that are shown.
    position_only : bool
        Whether the fix says nothing of the velocity.
    least_gain : float
        Share by which the variance of some direction must have fallen, else there is no fix;
        larger for posteriors that are not exact.
    """
    prior = batch.prior
    information = likelihood_information(mean, covariance, prior)
    whitener = np.linalg.inv(np.linalg.cholesky(prior[:2, :2]))
    if np.linalg.eigvalsh(whitener @ covariance[:2, :2] @ whitener.T)[0] > 1.0 - least_gain:
        return declined(
            batch, "the readings tell nothing that the navigator does not know", **diagnostics
        )
    position, uncertainty = measurement_only(mean, covariance, prior)
    known = None if position_only else information
    return _fix(batch, position, uncertainty, mean, diagnostics, candidates, known)


def publish_measured(
    batch: Batch,
    position: Array,
    covariance: Array,
    diagnostics: dict[str, float],
    candidates: Candidates | None = None,
) -> Fix:
    """Turn a measured position error of the navigator at the batch end into a fix.

    Parameters
    ----------
    batch : Batch
    position, covariance : (2,), (2, 2) arrays
        m north and east. Where batches overlap each reading is used in len(batch) / new of them,
        so the covariance grows by that factor.
    diagnostics : dict
        Figures of the fix, by name.
    candidates : Candidates, optional
        Places that are shown.
    """
    xi = np.concatenate([position, [0.0, 0.0]])
    out = covariance * (len(batch) / max(batch.new, 1))
    return _fix(batch, position, out, xi, diagnostics, candidates, None)


def _fix(
    batch: Batch,
    position: Array,
    covariance: Array,
    xi: Array,
    diagnostics: dict[str, float],
    candidates: Candidates | None,
    information: Information | None,
) -> Fix:
    shown = None if candidates is None else lambda: candidates
    more = {"shown": shown, "diagnostics": diagnostics, "information": information}
    return with_scans(located(batch, position, covariance, **more), batch, batch.transition @ xi)
