"""Positions as NavSatFix messages, and fixes as PoseWithCovarianceStamped messages of the frame
``map``, for filters such as those of robot_localization that take poses and no positions on the
Earth."""

import math

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import NavSatFix, NavSatStatus

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal_ros.messages.checks import BadMessageError, require_covariance, require_frame
from isogal_ros.messages.frames import BASE, MAP, NED_ENU
from isogal_ros.messages.prepared import Prepared, write

NOT_MEASURED = 1e6
"""Variance that stands for a direction that a sensor does not measure, in the message's unit."""
FARTHEST = 1.4e7
"""m from the origin of the frame ``map``: no place on the Earth is farther."""
HEIGHT_VARIANCE = 1e4
"""m². A fix measures no height: its height is the navigator's. Far from the origin the plane of a
fix is tilted against that of the map (by 2.7 degrees after 300 km), and a variance that means
"not at all" would spill into the plane."""


LEVEL = 0.0, 0.0, 0.0, 1.0
"""Orientation (x, y, z, w) that turns nothing."""


def fill_fix(
    message: NavSatFix | Prepared,
    ns: int,
    latitude: float,
    longitude: float,
    height: float,
    covariance: Array | None = None,
    status: int = NavSatStatus.STATUS_FIX,
) -> None:
    """Write a position.

    Parameters
    ----------
    ns : int
        Stamp.
    latitude, longitude, height : float
        rad, rad, m.
    covariance : (3, 3) array, optional
        NED, m²; None = not known.
    status : int
        Of NavSatStatus.
    """
    numbers = np.zeros(12)
    numbers[0] = math.degrees(latitude)
    numbers[1] = math.degrees(math.remainder(longitude, 2.0 * math.pi))
    numbers[2] = height
    kind = NavSatFix.COVARIANCE_TYPE_UNKNOWN
    if covariance is not None:
        numbers[3:] = (NED_ENU @ covariance @ NED_ENU).ravel()
        kind = NavSatFix.COVARIANCE_TYPE_KNOWN
    whole = message.message if isinstance(message, Prepared) else message
    if (whole.status.status, whole.position_covariance_type) != (status, kind):
        whole.status.status, whole.position_covariance_type = status, kind
        if isinstance(message, Prepared):
            message.prepare()
    write(message, ns, numbers)


def read_position(message: NavSatFix) -> tuple[float, float, float]:
    """Return (latitude rad, longitude rad, height m).

    Raises
    ------
    BadMessageError
        The message is of another frame, not finite, or of no place on Earth.
    """
    require_frame(message, BASE)
    if not math.isfinite(message.altitude):
        raise BadMessageError("position is not finite")
    return *read_place(message), message.altitude


def read_place(message: NavSatFix) -> tuple[float, float]:
    """Return (latitude rad, longitude rad); raises BadMessageError where that is no place on
    Earth."""
    if not (math.isfinite(message.latitude) and math.isfinite(message.longitude)):
        raise BadMessageError("position is not finite")
    if abs(message.latitude) > 90.0 or abs(message.longitude) > 360.0:
        raise BadMessageError(
            f"no such place: latitude {message.latitude:.4f}, longitude"
            f" {message.longitude:.4f} deg"
        )
    return math.radians(message.latitude), math.radians(message.longitude)


def read_point(local: Array, frame: LocalFrame) -> Array:
    """Return latitude, longitude (rad) and height (m) as (3,) of a point (3,) in the frame
    ``map``; raises BadMessageError where it is not finite, or at no place on the Earth."""
    if not (np.isfinite(local).all() and np.abs(local).max() <= FARTHEST):
        raise BadMessageError("position is not finite, or not on the Earth")
    return np.array([float(part) for part in frame.to_geodetic(local)])


def read_pose(message: PoseWithCovarianceStamped, frame: LocalFrame) -> tuple[Array, Array, Array]:
    """Return what a message says of the pose in the frame ``map``: latitude, longitude (rad) and
    height (m) as (3,), the covariance (6, 6) of position and orientation in that frame, which is
    not looked at, and the rotation (3, 3) from its axes to north, east, down at the place.

    Raises
    ------
    BadMessageError
        Of another frame, not finite, or too far away.
    """
    require_frame(message, MAP)
    point = message.pose.pose.position
    place = read_point(np.array([point.x, point.y, point.z]), frame)
    covariance = np.asarray(message.pose.covariance).reshape(6, 6)
    return place, covariance, to_ned(place, frame)


def to_ned(place: Array, frame: LocalFrame) -> Array:
    """Return the rotation (3, 3) from the axes of the frame ``map`` to north, east, down at a
    place (3,), latitude and longitude in rad."""
    return (frame.rotation_from(place[0], place[1]) @ NED_ENU).T


def read_covariance(message: NavSatFix) -> Array:
    """Return the (3, 3) covariance of the position, NED, m².

    Raises
    ------
    BadMessageError
        The covariance is not known, not finite, or has a negative variance.
    """
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        raise BadMessageError("covariance is not known")
    covariance = np.asarray(message.position_covariance).reshape(3, 3)
    require_covariance(covariance)
    return NED_ENU @ covariance @ NED_ENU


def fill_pose(
    message: PoseWithCovarianceStamped,
    ns: int,
    frame: LocalFrame,
    position: tuple[float, float, float],
    covariance: Array,
) -> None:
    """Write a fix; its orientation is not measured.

    Parameters
    ----------
    frame : LocalFrame
        The frame ``map``.
    position : (latitude rad, longitude rad, height m)
    covariance : (2, 2) array
        North, east, m².
    """
    local = np.diag([0.0, 0.0, HEIGHT_VARIANCE])
    local[:2, :2] = covariance
    axes = frame.rotation_from(position[0], position[1]) @ NED_ENU
    whole = np.diag([0.0, 0.0, 0.0, NOT_MEASURED, NOT_MEASURED, NOT_MEASURED])
    whole[:3, :3] = axes @ local @ axes.T
    write(message, ns, frame.from_geodetic(*position), LEVEL, whole)
