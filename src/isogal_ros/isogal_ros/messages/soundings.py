"""Messages of an altimeter with several beams: PointCloud2, as drivers of multibeam sounders and
of the four beams of a Doppler log publish them, or LaserScan of a fan across the track; and the
footprints with their terrain heights."""

import math
from typing import Any

import numpy as np
from sensor_msgs.msg import PointField

from isogal.arrays import Array
from isogal.scenario import Altimeter
from isogal.sensors.beams import PARTS, thinned
from isogal_ros import topics
from isogal_ros.messages.adapter import Place
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_frame
from isogal_ros.messages.frames import BASE
from isogal_ros.messages.point import fill_point, read_point
from isogal_ros.messages.stamps import set_stamp

FAN = "altimeter_fan_link"
"""Frame of a scan: x down, y to port, z forward, so that angles count from straight down to
port."""
_NUMBERS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}
_AXES = ("x", "y", "z")
_MOST = 100_000
"""Points of a message at most."""


class _Footprints:
    """What both have: the message of footprints, a point (`point`) with the fields `terrain` (4
    numbers for each beam: terrain height, and the footprint north, east and down of the vehicle,
    m) and `variance` (m²).

    Parameters
    ----------
    settings : scenario.Altimeter
    """

    reduced = topics.FOOTPRINTS

    def __init__(self, settings: Altimeter) -> None:
        self._settings = settings

    def new_reduced(self) -> Any:
        """Return a message to be filled."""
        message = self.reduced.type()
        message.header.frame_id = BASE
        return message

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
        terrain, variance = content.get("terrain"), content.get("variance")
        size = self._settings.count * PARTS
        if terrain is None or variance is None or len(terrain) != size or len(variance) != 1:
            raise BadMessageError(f"fields must be terrain, {size} x float64, and variance")
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

    def new_raw(self) -> Any:
        """Return a message to be filled."""
        message = self.raw.type()
        message.header.frame_id = BASE
        message.fields = [
            PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
            for i, name in enumerate(_AXES)
        ]
        message.height, message.point_step, message.is_bigendian = 1, 12, False
        return message

    def fill_raw(self, message: Any, ns: int, value: Array, variance: float) -> None:
        """Write soundings (B, 3) m, forward, right, down; NaN = none."""
        points = (value * (1.0, -1.0, -1.0)).astype("<f4")
        set_stamp(message.header.stamp, ns)
        message.width, message.row_step = len(points), 12 * len(points)
        message.is_dense = bool(np.isfinite(points).all())
        message.data = points.tobytes()

    def read_raw(self, message: Any) -> tuple[Array, float | None]:
        """Return soundings (B, 3) m, forward, right, down, NaN = none in range; and no
        variance."""
        require_frame(message, BASE)
        count, order = message.width * message.height, ">" if message.is_bigendian else "<"
        fields = {field.name: field for field in message.fields if field.name in _AXES}
        if set(fields) != set(_AXES):
            raise BadMessageError("must have the fields x, y and z")
        if count > _MOST or message.point_step * count > len(message.data):
            raise BadMessageError(f"{count} points are too many, or more than there are data")
        for field in fields.values():
            if field.datatype not in _NUMBERS:
                raise BadMessageError(f"field {field.name} must be float32 or float64")
        kinds = [order + _NUMBERS[fields[name].datatype] for name in _AXES]
        ends = [
            fields[name].offset + int(kind[-1]) for name, kind in zip(_AXES, kinds, strict=True)
        ]
        if max(ends) > message.point_step:
            raise BadMessageError("a field lies beyond the point")
        kind = np.dtype(
            {
                "names": list(_AXES),
                "formats": kinds,
                "offsets": [fields[name].offset for name in _AXES],
                "itemsize": message.point_step,
            }
        )
        points = np.frombuffer(bytes(message.data), kind, count)
        columns = [points[name].astype(np.float64) for name in _AXES]
        return self._in_range(np.stack(columns, axis=-1) * (1.0, -1.0, -1.0)), None


class ScanAdapter(_Footprints):
    """Soundings as a scan: ranges of a fan across the track by their angle."""

    raw = topics.FAN

    def new_raw(self) -> Any:
        """Return a message with the fan's angles."""
        message = self.raw.type()
        message.header.frame_id = FAN
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
