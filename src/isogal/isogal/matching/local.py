"""What every matcher does to a batch first: look whether it can be used, and lay a local plane
through its last scan."""

from dataclasses import dataclass

import numpy as np

from isogal.arrays import Array
from isogal.earth.ellipsoid import metres_per_radian
from isogal.matching.interfaces import Batch

_FINITE = (
    "latitude", "longitude", "velocity", "offset", "transition", "reading_jacobian", "nuisance_position", "nuisance_reading", "prior",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class LocalPlane:
    """North and east metres from a point, on a plane whose scale is that of the point's latitude.

    Over the 7 km of a batch the plane is off by 0.1 % of a distance at most, which for the offset
    of a candidate is a metre or two."""

    latitude: float
    """Origin, rad."""
    longitude: float
    """Origin, rad."""
    north: float
    """Metres per radian of latitude."""
    east: float
    """Metres per radian of longitude."""

    @classmethod
    def of(cls, batch: Batch) -> "LocalPlane":
        """Plane at the navigator's position at the last scan."""
        latitude, longitude = float(batch.latitude[-1]), float(batch.longitude[-1])
        north, east = metres_per_radian(latitude)
        return cls(latitude, longitude, float(north), float(east))

    def metres(self, latitude: Array, longitude: Array) -> Array:
        """Positions (..., 2), m, of points in rad; a track may cross the date line."""
        turn = np.remainder(longitude - self.longitude + np.pi, 2.0 * np.pi) - np.pi
        return np.stack([(latitude - self.latitude) * self.north, turn * self.east], axis=-1)

    def radians(self, position: Array) -> tuple[Array, Array]:
        """Latitude and longitude, rad, of positions (..., 2) in metres."""
        return (
            self.latitude + position[..., 0] / self.north,
            self.longitude + position[..., 1] / self.east,
        )


def unusable(batch: Batch) -> str | None:
    """Why no matcher can use a batch, in one line; None where it can."""
    if len(batch) < 2:
        return f"a batch needs at least 2 scans, has {len(batch)}"
    steps = np.diff(batch.time)
    if not (
        (steps > 0.0) if batch.channel is None else (steps >= 0.0)
    ).all():  # rows of several channels share a stamp
        return "the stamps of the scans do not increase"
    for name in _FINITE:
        if not np.isfinite(getattr(batch, name)).all():
            return f"{name} of the navigator is not finite"
    sigma = batch.sigma[np.isfinite(batch.reading)]
    if not (np.isfinite(sigma) & (sigma > 0.0)).all():
        return "sigma of a reading is not positive"
    deviation = np.sqrt(np.maximum(np.diag(batch.prior), 0.0))
    if (
        not deviation.all()
        or not np.linalg.eigvalsh(batch.prior / deviation / deviation[:, None])[0] > 0.0
    ):
        return "the navigator's covariance is not positive definite"
    return None


def too_few(batch: Batch, usable: int, minimum: int) -> str | None:
    """Why too few scans can be used, in one line; None where they are enough."""
    if usable >= minimum:
        return None
    read = int(np.isfinite(batch.reading).sum())
    if read < minimum:
        return f"only {read} of {len(batch)} scans have a reading ({minimum} needed)"
    return f"only {usable} of {read} readings have the map around them ({minimum} needed)"
