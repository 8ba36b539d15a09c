"""All that a batch says, as one message: a PointCloud2 of one point on ``pmht_mm/information``.

Fields, all float64: `published` (1, or 0 where the batch gives no fix); `lost` (1 where the
matcher found the navigator lost); where the navigator believes itself better than it is,
`widening` (7 x 7), which its covariance is to grow by before anything else; where readings have
shown how wrong a map of gravity is, `map_error` (1-sigma, m/s², and correlation length, m):
horizontal gravity by that map is as wrong; `latitude`,
`longitude` (deg) and `covariance` (2 x 2, north, east, m²) of the fix; where there is information
in `vector` (n) and `matrix` (n x n), n = 4 or 7, and the navigator's estimate that they are
relative to: `from_position` (latitude deg, longitude deg, height m), `from_velocity` (north, east,
down, m/s), `from_attitude` (quaternion w, x, y, z; body forward, right, down to NED)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from sensor_msgs.msg import PointCloud2

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES, HORIZONTAL_STATES, Estimate
from isogal.matching.interfaces import Fix, Information
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_frame
from isogal_ros.messages.frames import BASE
from isogal_ros.messages.point import fill_point, numbers, read_point
from isogal_ros.messages.stamps import to_ns, to_seconds


@dataclass(frozen=True, slots=True, eq=False)
class WholeFix:
    """A fix and the navigator's estimate that its information is relative to."""

    fix: Fix
    relative_to: Estimate | None = None
    """None = the navigator's estimate of that stamp, as it is when the fix comes."""


def fill_whole_fix(message: PointCloud2, ns: int, whole: WholeFix) -> None:
    """Write a fix, or that there is none, into a PointCloud2."""
    fix = whole.fix
    values: dict[str, Array | float] = {
        "published": float(fix.published),
        "lost": float(fix.reset),
        "latitude": math.degrees(fix.latitude),
        "longitude": math.degrees(fix.longitude),
        "covariance": fix.covariance.ravel(),
    }
    if fix.widened is not None:
        values["widening"] = fix.widened.ravel()
    if fix.map_error is not None:
        values["map_error"] = np.array(fix.map_error)
    if fix.information is not None:
        values |= {
            "vector": fix.information.vector,
            "matrix": fix.information.matrix.ravel(),
        }
    if whole.relative_to is not None:
        position, velocity, attitude = whole.relative_to
        values |= {
            "from_position": np.array([*np.degrees(position[:2]), position[2]]),
            "from_velocity": velocity,
            "from_attitude": attitude,
        }
    message.header.frame_id = BASE
    fill_point(message, ns, values)


def read_whole_fix(message: PointCloud2) -> WholeFix:
    """Return what a message of `fill_whole_fix` says.

    Raises
    ------
    BadMessageError
        A field is missing, of another size or not finite, or a number is impossible.
    """
    require_frame(message, BASE)
    values = read_point(message)
    published, lost = (_flag(values, name) for name in ("published", "lost"))
    time = to_seconds(to_ns(message.header.stamp))
    covariance, latitude, longitude = np.full((2, 2), np.nan), math.nan, math.nan
    information = _information(values)
    if published:
        latitude, longitude = (
            math.radians(_numbers(values, name, 1)[0]) for name in ("latitude", "longitude")
        )
        if abs(latitude) > math.pi / 2.0 or abs(longitude) > 2.0 * math.pi:
            raise BadMessageError("latitude or longitude is of no place")
        if information is None:
            covariance = _numbers(values, "covariance", 4).reshape(2, 2)
            require_covariance(covariance)
    reason = None if published else "no fix"
    fix = Fix(
        time,
        latitude,
        longitude,
        covariance,
        reason,
        information=information,
        reset=lost,
        widened=_widening(values),
        map_error=_map_error(values),
    )
    return WholeFix(fix, _estimate(values) if "from_position" in values else None)


def _numbers(values: Mapping[str, Array], name: str, size: int) -> Array:
    """Return a field of a size; raises BadMessageError where it is missing or not finite."""
    found = numbers(values, name, size)
    if not np.isfinite(found).all():
        raise BadMessageError(f"field {name} is not finite")
    return found


def _flag(values: Mapping[str, Array], name: str) -> bool:
    value = _numbers(values, name, 1)[0]
    if value not in (0.0, 1.0):
        raise BadMessageError(f"field {name} must be 0 or 1, is {value:g}")
    return bool(value)


def _information(values: Mapping[str, Array]) -> Information | None:
    if "vector" not in values and "matrix" not in values:
        return None
    size = len(values.get("vector", ()))
    if size not in (HORIZONTAL_STATES, BATCH_STATES):
        raise BadMessageError(f"field vector must have 4 or 7 numbers, has {size}")
    matrix = _numbers(values, "matrix", size * size).reshape(size, size)
    return Information(_numbers(values, "vector", size), matrix)


def _map_error(values: Mapping[str, Array]) -> tuple[float, float] | None:
    """Return the field map_error, if there is one."""
    if "map_error" not in values:
        return None
    sigma, length = _numbers(values, "map_error", 2).tolist()
    if not (sigma > 0.0 and length > 0.0):
        raise BadMessageError("field map_error must be positive")
    return sigma, length


def _widening(values: Mapping[str, Array]) -> Array | None:
    """Return the field widening (7, 7), if there is one; no variance may shrink by it."""
    if "widening" not in values:
        return None
    found = _numbers(values, "widening", BATCH_STATES**2).reshape(BATCH_STATES, BATCH_STATES)
    widening = 0.5 * (found + found.T)
    scale = np.sqrt(np.maximum(np.diag(widening), 1e-30))
    if np.linalg.eigvalsh(widening / scale / scale[:, None])[0] < -1e-6:
        raise BadMessageError("field widening is not a covariance")
    return np.asarray(widening, dtype=np.float64)


def _estimate(values: Mapping[str, Array]) -> Estimate:
    position = _numbers(values, "from_position", 3)
    attitude = _numbers(values, "from_attitude", 4)
    if abs(position[0]) > 90.0 or abs(position[1]) > 360.0:
        raise BadMessageError("field from_position is of no place")
    if abs(attitude @ attitude - 1.0) > 1e-3:
        raise BadMessageError("field from_attitude is not a unit quaternion")
    place = np.array([*np.radians(position[:2]), position[2]])
    return Estimate(place, _numbers(values, "from_velocity", 3), attitude)
