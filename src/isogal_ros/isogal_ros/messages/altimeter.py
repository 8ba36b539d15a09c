"""Messages of an altimeter.

One that looks straight down publishes a Range; what is matched is a NavSatFix for the point on the
ground below. One with several beams publishes a PointCloud2, as drivers of multibeam sounders and
of the four beams of a Doppler log do, or the LaserScan of a fan across the track; what is matched
are footprints with their terrain heights: a point (`isogal_ros.messages.point`) with the fields
`terrain` (4 numbers for each beam: terrain height, and the footprint north, east and down of the
vehicle, m) and `variance` (m²)."""

import math
from functools import partial

import numpy as np
from sensor_msgs.msg import LaserScan, NavSatFix, NavSatStatus, PointCloud2, Range

from isogal.arrays import Array
from isogal.scenario import Altimeter, Assumed
from isogal.sensors.altimeter import PARTS, beam_directions, thinned
from isogal_ros import topics
from isogal_ros.messages.adapter import Adapter, Place, Reading
from isogal_ros.messages.checks import BadMessageError, require_frame, require_reading
from isogal_ros.messages.frames import BASE, FRD_FLU, framed
from isogal_ros.messages.point import (
    fill_cloud,
    fill_point,
    number,
    numbers,
    read_cloud,
    read_point,
)
from isogal_ros.messages.position import NOT_MEASURED, fill_fix

ALTIMETER, GROUND = "altimeter_link", "ground"
"""Frame names: of the instrument, and of the point below it."""
FAN = "altimeter_fan_link"
"""Frame of a scan: x down, y to port, z forward, so that angles count from straight down to
port."""
_AXES = ("x", "y", "z")


def terrain(assumed: Assumed) -> Adapter:
    """Return the adapter of the field terrain. The limits of range are those of the simulated
    instrument; a real one that looks straight down says its own in each message."""
    settings = assumed.altimeter
    if not settings.sounds:
        raw = topics.CLEARANCE, partial(_write_range, settings), read_range
        write = partial(terrain_message, topics.TERRAIN)
        return Adapter(*raw, topics.TERRAIN, write, read_terrain)
    footprints = (
        topics.FOOTPRINTS,
        partial(_write_footprints, settings.count),
        partial(_read_footprints, settings.count),
    )
    if settings.message == "points":
        points = topics.SOUNDINGS, _write_points, partial(_read_points, settings)
        return Adapter(*points, *footprints)
    scan = topics.FAN, partial(_write_scan, settings), partial(_read_scan, settings)
    return Adapter(*scan, *footprints)


def _write_range(
    settings: Altimeter, ns: int, value: Reading, variance: Reading, place: Place
) -> Range:
    """Return a message of a clearance, m; NaN becomes infinity, which REP 117 has for nothing in
    range."""
    message = framed(topics.CLEARANCE, ALTIMETER, ns)
    message.min_range, message.max_range = settings.min_range, settings.max_range
    message.range = math.inf if math.isnan(value) else float(value)
    message.variance = float(variance)
    return message


def read_range(message: Range) -> tuple[float, float | None]:
    """Return the clearance (m), NaN where it is out of range, and its variance; None = unknown
    (zero)."""
    low, high, value = message.min_range, message.max_range, message.range
    if math.isnan(value):
        raise BadMessageError("reading is not a number")
    if not low < high:
        raise BadMessageError(f"min_range {low:g} m is not below max_range {high:g} m")
    require_reading(0.0, message.variance)
    in_range = math.isfinite(value) and low <= value <= high
    return (value if in_range else math.nan), message.variance or None


def terrain_message(
    topic: topics.Topic, ns: int, value: Reading, variance: Reading, place: Place
) -> NavSatFix:
    """Return a message of a terrain height.

    Parameters
    ----------
    topic : Topic
    ns : int
        Stamp.
    value, variance : float
        m and m²; NaN = no altitude, as the definition of the message has it.
    place : (latitude rad, longitude rad), optional
        None = not known.
    """
    message, height = framed(topic, GROUND), float(value)
    code = NavSatStatus.STATUS_NO_FIX if math.isnan(height) else NavSatStatus.STATUS_FIX
    covariance = np.diag([NOT_MEASURED, NOT_MEASURED, float(variance)])
    fill_fix(message, ns, *(place or (math.nan, math.nan)), height, covariance, code)
    return message


def read_terrain(message: NavSatFix) -> tuple[float, float]:
    """Return the terrain height (m), NaN where there was nothing in range, and its variance
    (m²)."""
    value, variance = message.altitude, float(message.position_covariance[8])
    nothing = message.status.status == NavSatStatus.STATUS_NO_FIX and math.isnan(value)
    require_reading(0.0 if nothing else value, variance)
    return value, variance


def _write_footprints(
    count: int, ns: int, value: Reading, variance: Reading, place: Place
) -> PointCloud2:
    """Return a message of terrain heights with footprints (count, 4); NaN = none."""
    shape = count, PARTS
    found = value if np.shape(value) == shape else np.full(shape, np.nan)
    message = framed(topics.FOOTPRINTS, BASE)
    return fill_point(message, ns, {"terrain": found, "variance": variance})


def _read_footprints(count: int, message: PointCloud2) -> tuple[Array, float]:
    """Return terrain heights with footprints (count, 4), NaN = none, and their variance."""
    require_frame(message, BASE)
    content = read_point(message)
    heights = numbers(content, "terrain", count, PARTS, finite=False)
    if np.isinf(heights).any():
        raise BadMessageError("a terrain height is not finite")
    variance = number(content, "variance")
    require_reading(0.0, variance)
    return heights, variance


def _write_points(ns: int, value: Reading, variance: Reading, place: Place) -> PointCloud2:
    """Return a message of soundings (B, 3) m, forward, right, down, NaN = none, as points x
    forward, y left, z up."""
    points = (value * FRD_FLU).astype(np.float32)
    columns = dict(zip(_AXES, points.T, strict=True))
    return fill_cloud(framed(topics.SOUNDINGS, BASE), ns, columns)


def _read_points(settings: Altimeter, message: PointCloud2) -> tuple[Array, None]:
    """Return soundings (B, 3) m, forward, right, down, NaN = none in range; and no variance."""
    require_frame(message, BASE)
    found = read_cloud(message, _AXES.__contains__, ("f4", "f8"))
    if set(found) != set(_AXES):
        raise BadMessageError("must have the fields x, y and z")
    points = np.stack([found[name][:, 0] for name in _AXES], axis=-1)
    return _in_range(points * FRD_FLU, settings), None


def _write_scan(
    settings: Altimeter, ns: int, value: Reading, variance: Reading, place: Place
) -> LaserScan:
    """Return a message of soundings (B, 3) m, forward, right, down, as ranges of the fan by their
    angle; NaN becomes infinity, which REP 117 has for nothing in range."""
    message = framed(topics.FAN, FAN, ns)
    half = math.radians(settings.opening) / 2.0 if settings.beams > 1 else 0.0
    message.angle_min, message.angle_max = -half, half
    message.angle_increment = 2.0 * half / max(1, settings.beams - 1)
    message.range_min, message.range_max = settings.min_range, settings.max_range
    port = np.arctan2(-beam_directions(settings)[:, 1], 1.0)
    length = np.sqrt(np.square(value).sum(axis=-1))[np.argsort(port)]
    message.ranges = np.where(np.isnan(length), np.inf, length).astype(np.float32).tolist()
    return message


def _read_scan(settings: Altimeter, message: LaserScan) -> tuple[Array, None]:
    """Return soundings (B, 3) m, forward, right, down, NaN = none in range; and no variance."""
    require_frame(message, FAN)
    length = np.asarray(message.ranges, dtype=np.float64)
    low, step = message.angle_min, message.angle_increment
    if not (math.isfinite(low) and math.isfinite(step)):
        raise BadMessageError("angles are not finite")
    if np.isnan(length).any():
        raise BadMessageError("a range is not a number; nothing in range is infinite")
    port = low + step * np.arange(len(length))
    known = np.where(np.isfinite(length), length, np.nan)
    axes = np.stack([np.zeros(len(port)), -np.sin(port), np.cos(port)], axis=-1)
    return _in_range(known[:, None] * axes, settings), None


def _in_range(vectors: Array, settings: Altimeter) -> Array:
    """Return the soundings (B, 3) that are matched, of (N, 3) m forward, right, down."""
    length = np.sqrt((vectors**2).sum(axis=-1))
    with np.errstate(invalid="ignore"):
        good = (length >= settings.min_range) & (length <= settings.max_range)
        good &= vectors[:, 2] > 0.0
    return thinned(np.where(good[:, None], vectors, np.nan), settings.count)
