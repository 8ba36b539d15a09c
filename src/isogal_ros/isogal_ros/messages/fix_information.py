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
from numpy.typing import ArrayLike
from sensor_msgs.msg import NavSatFix, NavSatStatus, PointCloud2

from isogal.arrays import Array
from isogal.inertial.error_state import BATCH_STATES, HORIZONTAL_STATES, Estimate
from isogal.matching.interfaces import Fix, Information
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    require_unit,
)
from isogal_ros.messages.frames import BASE
from isogal_ros.messages.point import fill_point, number, numbers, read_point
from isogal_ros.messages.position import read_covariance, read_position
from isogal_ros.messages.stamps import to_ns, to_seconds


@dataclass(frozen=True, slots=True, eq=False)
class FixMessage:
    """A fix and the navigator's estimate that its information is relative to."""

    fix: Fix
    relative_to: Estimate | None = None
    """None = the navigator's estimate of that stamp, as it is when the fix comes."""


def fill_fix_information(message: PointCloud2, ns: int, content: FixMessage) -> None:
    """Write a fix, or that there is none, into a PointCloud2."""
    fix = content.fix
    values: dict[str, ArrayLike] = {
        "published": fix.published,
        "lost": fix.reset,
        "latitude": math.degrees(fix.latitude),
        "longitude": math.degrees(fix.longitude),
        "covariance": fix.covariance,
    }
    if fix.widened is not None:
        values["widening"] = fix.widened
    if fix.map_error is not None:
        values["map_error"] = fix.map_error
    if fix.information is not None:
        values |= {"vector": fix.information.vector, "matrix": fix.information.matrix}
    if content.relative_to is not None:
        position, velocity, attitude = content.relative_to
        values["from_position"] = np.array([*np.degrees(position[:2]), position[2]])
        values |= {"from_velocity": velocity, "from_attitude": attitude}
    message.header.frame_id = BASE
    fill_point(message, ns, values)


def read_fix_information(message: PointCloud2) -> FixMessage:
    """Return what a message of `fill_fix_information` says.

    Raises
    ------
    BadMessageError
        A field is missing, of another size or not finite, or a number is impossible.
    """
    require_frame(message, BASE)
    values = read_point(message)
    published, lost = (_flag(values, name) for name in ("published", "lost"))
    covariance, latitude, longitude = np.full((2, 2), np.nan), math.nan, math.nan
    information = _information(values)
    if published:
        degrees = np.array([number(values, name) for name in ("latitude", "longitude")])
        latitude, longitude = _place(degrees, "latitude or longitude")
        if information is None:
            covariance = numbers(values, "covariance", 2, 2)
            require_covariance(covariance)
    fix = Fix(
        to_seconds(to_ns(message.header.stamp)),
        latitude,
        longitude,
        covariance,
        None if published else "no fix",
        information=information,
        reset=lost,
        widened=_widening(values) if "widening" in values else None,
        map_error=_map_error(values) if "map_error" in values else None,
    )
    return FixMessage(fix, _estimate(values) if "from_position" in values else None)


def read_fix(message: NavSatFix) -> FixMessage:
    """Return the fix of a message on ``pmht_mm/fix``; raises BadMessageError where it cannot be
    used."""
    time = to_seconds(to_ns(message.header.stamp))
    if message.status.status == NavSatStatus.STATUS_NO_FIX:
        nothing = np.full((2, 2), np.nan)
        return FixMessage(Fix(time, math.nan, math.nan, nothing, reason="no fix"))
    latitude, longitude, _ = read_position(message)
    return FixMessage(Fix(time, latitude, longitude, read_covariance(message)[:2, :2]))


def _flag(values: Mapping[str, Array], name: str) -> bool:
    value = number(values, name)
    if value not in (0.0, 1.0):
        raise BadMessageError(f"field {name} must be 0 or 1, is {value:g}")
    return bool(value)


def _place(degrees: Array, what: str) -> tuple[float, float]:
    """Return latitude and longitude in rad, of (2,) deg."""
    if (np.abs(degrees) > (90.0, 360.0)).any():
        raise BadMessageError(f"{what} is of no place")
    return math.radians(degrees[0]), math.radians(degrees[1])


def _information(values: Mapping[str, Array]) -> Information | None:
    if "vector" not in values and "matrix" not in values:
        return None
    size = len(values.get("vector", ()))
    if size not in (HORIZONTAL_STATES, BATCH_STATES):
        raise BadMessageError(f"field vector must have 4 or 7 numbers, has {size}")
    matrix = numbers(values, "matrix", size, size)
    return Information(numbers(values, "vector", size), matrix)


def _map_error(values: Mapping[str, Array]) -> tuple[float, float]:
    sigma, length = numbers(values, "map_error", 2).tolist()
    if not (sigma > 0.0 and length > 0.0):
        raise BadMessageError("field map_error must be positive")
    return sigma, length


def _widening(values: Mapping[str, Array]) -> Array:
    """Return the field widening (7, 7); no variance may shrink by it."""
    found = numbers(values, "widening", BATCH_STATES, BATCH_STATES)
    widening = 0.5 * (found + found.T)
    scale = np.sqrt(np.maximum(np.diag(widening), 1e-30))
    if np.linalg.eigvalsh(widening / scale / scale[:, None])[0] < -1e-6:
        raise BadMessageError("field widening is not a covariance")
    return np.asarray(widening, dtype=np.float64)


def _estimate(values: Mapping[str, Array]) -> Estimate:
    position = numbers(values, "from_position", 3)
    attitude = numbers(values, "from_attitude", 4)
    place = _place(position[:2], "field from_position")
    require_unit(attitude, "field from_attitude")
    velocity = numbers(values, "from_velocity", 3)
    return Estimate(np.array([*place, position[2]]), velocity, attitude)
