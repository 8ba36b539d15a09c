"""What the baseline matchers share: the readings of a batch as arrays, and how a posterior or a
measured position becomes a fix.

The baselines follow their sources, which know no correlated map error: the map's error is white
noise added to the sensor's. With xi the navigator's error at the batch end (`interfaces`), the
residual of a reading is

    r_t(xi) = level_t - jacobian_t xi - map(p_t - transition_t xi).
"""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array, Integers
from isogal.earth.ellipsoid import metres_per_radian
from isogal.maps.field_map import FieldMap
from isogal.maps.interpolation import Grid
from isogal.matching.information import likelihood_information, measurement_only
from isogal.matching.interfaces import Batch, Candidates, Fix, Information, declined
from isogal.scenario import Matcher as MatcherSettings


@dataclass(frozen=True, slots=True)
class WhiteNoise:
    """What a baseline assumes beside the sensor's noise, in the map's unit."""

    map_sigma: float = 0.0
    """White 1-sigma of the map's error; where the map says more about itself, that counts."""
    bias_sigma: float = 0.0
    """1-sigma of an unknown constant in the readings of a batch."""

    @classmethod
    def from_settings(cls, settings: MatcherSettings) -> "WhiteNoise":
        """Take what the scenario's matcher section says; `map_sigma: auto` is what the map says
        about itself."""
        return cls(
            0.0 if settings.map_sigma == "auto" else float(settings.map_sigma), settings.bias_sigma
        )


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
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
    """(N, 2, 4)."""
    jacobian: Array
    """(N, 4)."""
    row: Integers
    """(N,) index of each in the batch."""

    @classmethod
    def of(cls, batch: Batch, field_map: FieldMap, noise: WhiteNoise, whole: bool) -> "Scans":
        """Collect the readings that no earlier batch has used, or those of the whole batch."""
        usable = np.isfinite(batch.reading) & field_map.covers(batch.latitude, batch.longitude)
        if not whole:
            usable[: len(batch) - batch.new] = False
        row = np.flatnonzero(usable)
        latitude, longitude = batch.latitude[row], batch.longitude[row]
        map_sigma = np.maximum(
            noise.map_sigma, np.nan_to_num(field_map.sigma_at(latitude, longitude))
        )
        variance = batch.sigma[row] ** 2 + map_sigma**2 + field_map.quantisation**2 / 12.0
        variance = variance + (batch.nuisance_reading[row] ** 2).sum(axis=1)
        north, east = metres_per_radian(latitude)
        return cls(
            grid=field_map.grid,
            latitude=latitude,
            longitude=longitude,
            radian=np.stack([1.0 / north, 1.0 / east], axis=-1),
            level=batch.reading[row] - batch.offset[row],
            sigma=np.sqrt(variance),
            transition=np.ascontiguousarray(batch.transition[row]),
            jacobian=np.ascontiguousarray(batch.reading_jacobian[row]),
            row=row,
        )

    def __len__(self) -> int:
        return self.level.shape[0]

    def linearise(self, field_map: FieldMap, xi: Array) -> tuple[Array, Array]:
        """Return residuals (N,) at an error xi (4,) and their derivative by xi (N, 4); NaN off the
        map."""
        moved = self.transition @ xi
        latitude = self.latitude - moved[:, 0] * self.radian[:, 0]
        longitude = self.longitude - moved[:, 1] * self.radian[:, 1]
        value, north, east = field_map.value_and_gradient(latitude, longitude)
        slope = (
            north[:, None] * self.transition[:, 0]
            + east[:, None] * self.transition[:, 1]
            - self.jacobian
        )
        return self.level - value - self.jacobian @ xi, slope


def shift_covariance(slope: Array, sigma: Array, velocity: Array, limit: float) -> Array:
    """Covariance of the position shift that least squares on one batch gives, from the curvature
    of the residuals.

    Parameters
    ----------
    slope : (N, 4) array
        d(residual)/d(xi).
    sigma : (N,) array
        1-sigma of each residual.
    velocity : (2, 2) array
        Covariance of the navigator's velocity error, which the shift leaves out and which moves
        the readings meanwhile.
    limit : float
        Largest 1-sigma, m: of a direction that the readings say nothing about.

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
    """Turn the posterior N(mean, covariance) of xi into a fix of the measurements alone.

    Declines where no direction's variance has fallen by the share `least_gain`, which is for
    posteriors that are not exact."""
    prior = batch.prior
    information = likelihood_information(mean, covariance, prior)
    whitener = np.linalg.inv(np.linalg.cholesky(prior[:2, :2]))
    if np.linalg.eigvalsh(whitener @ covariance[:2, :2] @ whitener.T)[0] > 1.0 - least_gain:
        return declined(
            batch, "the readings tell nothing that the navigator does not know", **diagnostics
        )
    position, uncertainty = measurement_only(mean, covariance, prior)
    known = None if position_only else information
    return _fix(batch, position, uncertainty, mean, batch.new, diagnostics, candidates, known)


def publish_measured(
    batch: Batch,
    position: Array,
    covariance: Array,
    diagnostics: dict[str, float],
    candidates: Candidates | None = None,
) -> Fix:
    """Turn a measured position error (2,) of the navigator at the batch end into a fix.

    Where batches overlap each reading serves in len(batch) / new of them, so the covariance grows
    by that."""
    xi = np.concatenate([position, [0.0, 0.0]])
    out = covariance * (len(batch) / max(batch.new, 1))
    return _fix(batch, position, out, xi, batch.new, diagnostics, candidates, None)


def _fix(
    batch: Batch,
    position: Array,
    covariance: Array,
    xi: Array,
    new: int,
    diagnostics: dict[str, float],
    candidates: Candidates | None,
    information: Information | None,
) -> Fix:
    north, east = metres_per_radian(batch.latitude)
    moved = batch.transition @ xi
    scan_covariance = np.full((len(batch), 2, 2), np.nan)
    scan_covariance[len(batch) - new :] = (
        new * covariance
    )  # so many fixes hold the information once
    return Fix(
        time=float(batch.time[-1]),
        latitude=float(batch.latitude[-1] - position[0] / north[-1]),
        longitude=float(batch.longitude[-1] - position[1] / east[-1]),
        covariance=covariance,
        candidates=candidates,
        diagnostics=diagnostics,
        information=information,
        scan_position=np.stack(
            [batch.latitude - moved[:, 0] / north, batch.longitude - moved[:, 1] / east], axis=-1
        ),
        scan_covariance=scan_covariance,
    )
