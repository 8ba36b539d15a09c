"""Sensors beside the IMU as messages: pressures, positions, velocities and headings."""

import math
import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, Quaternion, TwistWithCovarianceStamped
from numpy.typing import ArrayLike
from sensor_msgs.msg import FluidPressure, Imu, NavSatFix, NavSatStatus

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.inertial.rotations import matrix
from isogal.scenario import AnyAid, Gnss, HeadingAid, Height, PositionAid, Settings, Velocity
from isogal.scenario.aids import VERTICAL, SatellitePosition
from isogal.sensors.barometer import height_of, height_slope, pressure_of
from isogal_ros import topics
from isogal_ros.messages.checks import (
    ABSENT,
    BadMessageError,
    require_covariance,
    require_frame,
    require_reading,
    unit_quaternion,
)
from isogal_ros.messages.frames import BASE, FRD_FLU, NED_ENU
from isogal_ros.messages.position import fill_fix, read_covariance, read_place, read_pose
from isogal_ros.messages.prepared import write
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.topics import Message, Topic

_YAW = 8
"""Place of the yaw's variance in the covariance of an orientation."""
_STEEPEST = 0.1
"""Horizontal part of the bow below which it has no heading."""
_TO_FRD = np.diag(FRD_FLU)
OTHER_DATUMS = (
    "nad27", "nad83", "ed50", "osgb", "pz90", "gcj02", "bd09", "sk42", "pulkovo", "tokyo", "agd",
    "epsg",
)  # fmt: skip
"""What names of datums begin with that are metres to hundreds of metres off WGS 84, in lower case
and without signs. ITRF, ETRS89 and GDA are within two metres of it (plate motion): taken as it is.
"""


class Aid(NamedTuple):
    """A sensor beside the IMU that the filter of a scenario takes."""

    topic: Topic
    settings: AnyAid
    instead: tuple[Topic, ...] = ()
    """On which the same aid may publish instead."""


def each_aid(scenario: Settings) -> Iterator[Aid]:
    """Yield the sensors beside the IMU that the filter of a scenario takes."""
    every = (*((scenario.height,) if scenario.height.measured else ()), *scenario.aids)
    return (aid for one in every if (aid := aid_of(one)) is not None)


def aid_of(settings: AnyAid) -> Aid | None:
    """Return an aid with its topics; None of the velocity of satellites where there is none."""
    match settings:
        case Gnss():
            measured = settings.velocity_sigma is not None
            return Aid(topics.GNSS_VELOCITY, settings) if measured else None
        case SatellitePosition():
            return Aid(topics.GNSS_FIX, settings)
    topic, *instead = topics.aid_topics(settings.stem, getattr(settings, "name", None))
    return Aid(topic, settings, tuple(instead))


def fill_aid(message: Message, ns: int, value: Array, aid: AnyAid, really: AnyAid) -> None:
    """Write what an aid measures into its message: what it believes of its errors, and a pressure
    as it really is.

    Parameters
    ----------
    ns : int
        Stamp.
    value : array
        Height (m), velocity (3,) FRD or of satellites NED (m/s), latitude, longitude (rad) and
        height (m) as (3,), or heading (rad); NaN = not measured.
    aid, really : scenario sections
        As it is assumed, and as it is.
    """
    match aid, really:
        case Height(), Height():
            fill_pressure(message, ns, float(value), really)
        case Gnss(), _:
            sigma = np.array([1.0, 1.0, VERTICAL]) * (aid.velocity_sigma or 0.0)
            fill_twist(message, ns, NED_ENU @ value, sigma**2)
        case PositionAid(), _ if np.isnan(value).any():  # no satellites
            fill_fix(message, ns, 0.0, 0.0, 0.0, status=NavSatStatus.STATUS_NO_FIX)
        case PositionAid(), _:
            of_axes = np.square(aid.unequal) * (aid.sigma**2 + aid.correlated_sigma**2)
            latitude, longitude, height = value.tolist()
            fill_fix(message, ns, latitude, longitude, height, np.diag(of_axes))
        case HeadingAid(), _:  # of a level vehicle; errors of its mounting are not in the variance
            half = 0.5 * (0.5 * math.pi - float(value))
            variance = aid.number("sigma") ** 2 + aid.number("correlated_sigma") ** 2
            set_stamp(message.header.stamp, ns)
            message.orientation = Quaternion(w=math.cos(half), z=math.sin(half))
            message.orientation_covariance[_YAW] = variance
            message.angular_velocity_covariance[0] = ABSENT
            message.linear_acceleration_covariance[0] = ABSENT
        case _:
            fill_twist(message, ns, value * FRD_FLU)


Reading = tuple[ArrayLike, ArrayLike | None]
"""What `isogal.fusion.measurements.reading_of` takes: a value, and its (co)variance as stated."""


def read_aid(
    message: Message, settings: AnyAid, frame: LocalFrame, velocity_frame: str
) -> Reading | None:
    """Return what a message of an aid says; None where the aid has no fix.

    Parameters
    ----------
    message : Message
    settings : scenario section
        Of the aid.
    frame : LocalFrame
        The frame ``map``.
    velocity_frame : str
        Of velocities in body axes; empty = any.

    Raises
    ------
    BadMessageError
        It cannot be used.
    """
    match settings:
        case Height():
            return read_pressure(message, settings)
        case Velocity():
            velocity, covariance = read_velocity(message, velocity_frame)
            velocity[[axis for axis in range(3) if axis not in settings.axes]] = np.nan
            return velocity, covariance
        case Gnss():
            return read_velocity(message, "", NED_ENU)
        case HeadingAid():
            return read_heading(message)
    if isinstance(message, NavSatFix):
        return read_position_fix(message)
    return read_pose_position(message, frame)


def fill_pressure(message: FluidPressure, ns: int, height: float, settings: Height) -> None:
    """Write the pressure of a height into a FluidPressure; its variance is unknown, zero.

    Parameters
    ----------
    ns : int
        Stamp.
    height : float
        m.
    settings : scenario.Height
        Of the sensor.
    """
    set_stamp(message.header.stamp, ns)
    message.fluid_pressure = float(pressure_of(height, settings))


def read_pressure(message: FluidPressure, settings: Height) -> tuple[float, float]:
    """Return the height (m) of a pressure and its variance (m²; 0 = unknown).

    Raises
    ------
    BadMessageError
        Not finite, not positive, or of a negative variance.
    """
    pressure, variance = float(message.fluid_pressure), float(message.variance)
    require_reading(pressure, variance)
    if pressure <= 0.0:
        raise BadMessageError(f"pressure of {pressure:g} Pa")
    height = float(height_of(pressure, settings))
    return height, variance * height_slope(pressure, settings) ** 2


def fill_twist(
    message: TwistWithCovarianceStamped, ns: int, velocity: Array, variance: ArrayLike = 0.0
) -> None:
    """Write a velocity into a TwistWithCovarianceStamped.

    Parameters
    ----------
    ns : int
        Stamp.
    velocity : (3,) array
        m/s, on the message's axes; NaN = not measured, which has the variance -1.
    variance : (3,) array or float
        Of each axis, (m/s)²; 0 = unknown.
    """
    found = np.where(np.isnan(velocity), ABSENT, variance)
    covariance = np.diag([*found, 0.0, 0.0, 0.0])
    write(message, ns, np.nan_to_num(velocity), np.zeros(3), covariance)


def read_velocity(
    message: TwistWithCovarianceStamped, frame: str = BASE, turn: Array = _TO_FRD
) -> tuple[Array, Array]:
    """Return velocity (3,), m/s, NaN in axes of variance -1, and covariance (3, 3), zero where it
    is unknown.

    Parameters
    ----------
    frame : str
        Of the message; empty = any.
    turn : (3, 3) array
        From its axes to those of the result: forward, left, up to FRD, or `NED_ENU`.

    Raises
    ------
    BadMessageError
        Of another frame, not finite, or of a negative variance.
    """
    require_frame(message, frame, "velocity_frame")
    linear = message.twist.twist.linear
    velocity = turn @ np.array([linear.x, linear.y, linear.z])
    if not np.isfinite(velocity).all():
        raise BadMessageError("velocity is not finite")
    covariance = turn @ np.array(message.twist.covariance).reshape(6, 6)[:3, :3] @ turn.T
    absent = np.diag(covariance) == ABSENT
    velocity[absent] = np.nan
    covariance[absent], covariance[:, absent] = 0.0, 0.0
    require_covariance(covariance)
    return velocity, covariance


def read_position_fix(message: NavSatFix) -> tuple[Array, Array | None] | None:
    """Return latitude, longitude (rad), height (m) as (3,), and the covariance (3, 3) NED, m²,
    None where it is not known; None where the aid has no fix. A height that is not available is
    NaN, as the message has it. The frame of what is measured may have any name that is not a
    datum's.

    Raises
    ------
    BadMessageError
        Not finite, of no place on Earth, of another datum than WGS 84, or of a covariance that is
        none.
    """
    datum = re.sub(r"[^a-z0-9]", "", message.header.frame_id.lower())
    if datum.startswith(OTHER_DATUMS):
        raise BadMessageError(
            f"frame_id '{message.header.frame_id}' names a datum: a NavSatFix is of WGS 84,"
            " transform it before"
        )
    if message.status.status == NavSatStatus.STATUS_NO_FIX:
        return None
    if math.isinf(message.altitude):
        raise BadMessageError("position is not finite")
    place = np.array([*read_place(message), message.altitude])
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        return place, None
    covariance = read_covariance(message)
    return place, covariance if covariance.any() else None


def read_pose_position(
    message: PoseWithCovarianceStamped, frame: LocalFrame
) -> tuple[Array, Array | None]:
    """Return the same of a pose in the frame ``map`` (a `LocalFrame`), whose orientation is not
    used; its covariance is not known where it is zero. Raises BadMessageError as `read_pose`, and
    where the covariance is none."""
    place, covariance, to_ned = read_pose(message, frame)
    of_place = covariance[:3, :3]
    require_covariance(of_place)
    return place, to_ned @ of_place @ to_ned.T if of_place.any() else None


def read_heading(message: Imu) -> tuple[float, float | None]:
    """Return the heading (rad from north, east positive) and its variance (rad², None = unknown)
    of an orientation, of which all else is not used. The frame may have any name.

    Raises
    ------
    BadMessageError
        It is marked as without orientation, no unit quaternion, of a negative variance, or the bow
        points up or down.
    """
    variance = float(message.orientation_covariance[_YAW])
    if message.orientation_covariance[0] == ABSENT:
        raise BadMessageError("marked as without orientation (covariance -1)")
    turn = unit_quaternion(message.orientation)
    require_reading(0.0, variance)
    east, north = matrix(turn)[:2, 0].tolist()
    if math.hypot(east, north) < _STEEPEST:
        raise BadMessageError("the bow points up or down: no heading")
    return math.atan2(east, north), variance or None
