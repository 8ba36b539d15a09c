"""Messages of an altimeter with several beams: PointCloud2, as drivers of multibeam sounders and
of the four beams of a Doppler log publish them, or LaserScan of a fan across the track; and the
footprints with their terrain heights."""

import math
from typing import Any

import numpy as np

from isogal.arrays import Array
from isogal.scenario import Altimeter
from isogal.sensors.beams import PARTS, thinned
from isogal_ros import topics
from isogal_ros.messages.adapter import Framed, Place
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_frame
from isogal_ros.messages.frames import BASE, FRD_FLU
from isogal_ros.messages.point import fill_cloud, fill_point, numbers, read_cloud, read_point
from isogal_ros.messages.stamps import set_stamp

FAN = "altimeter_fan_link"
"""Frame of a scan: x down, y to port, z forward, so that angles count from straight down to
port."""
_AXES = ("x", "y", "z")
_MOST = 100_000
"""Ranges of a message at most."""


class _Footprints(Framed):
    """What both have: the message of footprints, a point (`point`) with the fields `terrain` (4
    numbers for each beam: terrain height, and the footprint north, east and down of the vehicle,
    m) and `variance` (m²).

    Parameters
    ----------
    settings : scenario.Altimeter
    """

    reduced, frames = topics.FOOTPRINTS, (BASE, BASE)

    def __init__(self, settings: Altimeter) -> None:
        self._settings = settings

    def fill_reduced(
        self, message: Any, ns: int, value: Array, variance: float, place: Place
    ) -> None:
        """Write terrain heights with footprints (B, 4); NaN = none."""
        whole = value.shape == (self._settings.count, PARTS)
        found = value if whole else np.full((self._settings.count, PARTS), np.nan)
        fill_point(message, ns, {"terrain": found, "variance": variance})

    def read_reduced(self, message: Any) -> tuple[Array, float]:
        """Return terrain heights with footprints (B, 4), NaN = none, and their variance."""
        require_frame(message, BASE)
        content = read_point(message)
        terrain = numbers(content, "terrain", self._settings.count * PARTS)
        variance = numbers(content, "variance", 1)
        if np.isinf(terrain).any():
            raise BadMessageError("a terrain height is not finite")
        require_covariance(variance[:, None])
        return terrain.reshape(-1, PARTS), float(variance[0])

    def _in_range(self, vectors: Array) -> Array:
        """Return the soundings (B, 3) that are matched, of (N, 3) m forward, right, down."""
        length = np.sqrt((vectors**2).sum(axis=-1))
        low, high = self._settings.min_range, self._settings.max_range
        with np.errstate(invalid="ignore"):
            good = (length >= low) & (length <= high) & (vectors[:, 2] > 0.0)
        return thinned(np.where(good[:, None], vectors, np.nan), self._settings.count)


class PointsAdapter(_Footprints):
    """Soundings as points x forward, y left, z up of the vehicle, m."""

    raw = topics.SOUNDINGS

    def fill_raw(self, message: Any, ns: int, value: Array, variance: float) -> None:
        """Write soundings (B, 3) m, forward, right, down; NaN = none."""
        points = (value * FRD_FLU).astype(np.float32)
        fill_cloud(message, ns, dict(zip(_AXES, points.T, strict=True)))

    def read_raw(self, message: Any) -> tuple[Array, float | None]:
        """Return soundings (B, 3) m, forward, right, down, NaN = none in range; and no
        variance."""
        require_frame(message, BASE)
        found = read_cloud(message, _AXES.__contains__, ("f4", "f8"))
        if set(found) != set(_AXES):
            raise BadMessageError("must have the fields x, y and z")
        points = np.stack([found[name][:, 0] for name in _AXES], axis=-1)
        return self._in_range(points * FRD_FLU), None


class ScanAdapter(_Footprints):
    """Soundings as a scan: ranges of a fan across the track by their angle."""

    raw, frames = topics.FAN, (FAN, BASE)

    def new_raw(self) -> Any:
        """Return a message with the fan's angles."""
        message = super().new_raw()
        half = math.radians(self._settings.opening) / 2.0 if self._settings.beams > 1 else 0.0
        message.angle_min, message.angle_max = -half, half
        message.angle_increment = 2.0 * half / max(1, self._settings.beams - 1)
        message.range_min = self._settings.min_range
        message.range_max = self._settings.max_range
        return message

    def fill_raw(self, message: Any, ns: int, value: Array, variance: float) -> None:
        """Write soundings (B, 3) m, forward, right, down; NaN becomes infinity, which REP 117 has
        for nothing in range."""
        from isogal.sensors.beams import beam_directions

        set_stamp(message.header.stamp, ns)
        port = np.arctan2(-beam_directions(self._settings)[:, 1], 1.0)
        length = np.sqrt((value**2).sum(axis=-1))[np.argsort(port)]
        message.ranges = np.where(np.isnan(length), np.inf, length).astype(np.float32).tolist()

    def read_raw(self, message: Any) -> tuple[Array, float | None]:
        """Return soundings (B, 3) m, forward, right, down, NaN = none in range; and no
        variance."""
        require_frame(message, FAN)
        length = np.asarray(message.ranges, dtype=np.float64)
        low, step = message.angle_min, message.angle_increment
        if len(length) > _MOST or not (math.isfinite(low) and math.isfinite(step)):
            raise BadMessageError("too many ranges, or angles that are not finite")
        if np.isnan(length).any():
            raise BadMessageError("a range is not a number; nothing in range is infinite")
        port = low + step * np.arange(len(length))
        with np.errstate(invalid="ignore"):
            known = np.where(np.isfinite(length), length, np.nan)
        vectors = known[:, None] * np.stack(
            [np.zeros(len(port)), -np.sin(port), np.cos(port)], axis=-1
        )
        return self._in_range(vectors), None
