"""Sensors beside the IMU as messages: FluidPressure, NavSatFix and TwistWithCovarianceStamped."""

import re
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from numpy.typing import ArrayLike
from sensor_msgs.msg import FluidPressure, NavSatFix, NavSatStatus

from isogal.arrays import Array
from isogal.scenario import Gnss, HeadingAid, Height, PositionAid, Settings, Velocity
from isogal.scenario.aids import VERTICAL
from isogal.sensors.barometer import height_of, height_slope, pressure_of
from isogal_ros import topics
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    require_reading,
)
from isogal_ros.messages.frames import BASE, FRD_FLU, NED_ENU
from isogal_ros.messages.position import fill_fix, read_covariance, read_position
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.topics import Topic

_NOT_MEASURED = -1.0
"""Variance of an axis that a sensor does not measure."""
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
    settings: Height | Velocity | PositionAid | HeadingAid | Gnss
    """Its section, or entry of a list; `Gnss` of the velocity of satellites alone."""
    instead: tuple[Topic, ...] = ()
    """On which the same aid may publish instead."""

    @property
    def delay(self) -> float:
        """By how much its messages come later than their stamps, s."""
        return float(getattr(self.settings, "delay", 0.0))


def each_aid(scenario: Settings) -> Iterator[Aid]:
    """Yield the sensors beside the IMU that the filter of a scenario takes."""
    gnss = scenario.gnss
    for sensor in scenario.height_aids:
        yield Aid(topics.height_topic(getattr(sensor, "name", None)), sensor)
    for log in scenario.velocity_aids:
        yield Aid(topics.velocity_topic(getattr(log, "name", None)), log)
    if gnss.used:
        yield Aid(topics.GNSS_FIX, gnss.positions)
        if gnss.velocity_sigma is not None:
            yield Aid(topics.GNSS_VELOCITY, gnss)
    for place in scenario.positions or ():
        fix, *poses = topics.position_topics(place.name)
        yield Aid(fix, place, tuple(poses))
    for bow in scenario.headings or ():
        yield Aid(topics.heading_topic(bow.name), bow)


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


def read_pressure(message: FluidPressure, settings: Height) -> tuple[float, float, float]:
    """Return pressure (Pa), height (m) and the height's variance (m²; 0 = unknown).

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
    return pressure, height, variance * height_slope(pressure, settings) ** 2


def fill_twist(
    message: TwistWithCovarianceStamped, ns: int, velocity: Array, variance: ArrayLike = 0.0
) -> None:
    """Write a velocity (3,), m/s, on the message's own axes into a TwistWithCovarianceStamped, and
    the variance of each axis, 0 = unknown; one that is not measured (NaN) has the variance -1."""
    set_stamp(message.header.stamp, ns)
    linear = message.twist.twist.linear
    linear.x, linear.y, linear.z = np.nan_to_num(velocity).tolist()
    found = np.where(np.isnan(velocity), _NOT_MEASURED, variance)
    for axis, value in enumerate(found.tolist()):
        message.twist.covariance[7 * axis] = value


def fill_velocity(message: TwistWithCovarianceStamped, ns: int, velocity: Array) -> None:
    """Write a velocity (3,) FRD, m/s, of unknown covariance, see `fill_twist`."""
    fill_twist(message, ns, velocity * FRD_FLU)


def read_velocity(message: TwistWithCovarianceStamped, frame: str = BASE) -> tuple[Array, Array]:
    """Return velocity (3,) FRD, m/s, NaN in axes of variance -1, and covariance (3, 3), zero where
    it is unknown.

    Raises
    ------
    BadMessageError
        Of another frame, not finite, or of a negative variance.
    """
    require_frame(message, frame, "velocity_frame")
    return _linear(message, np.diag(FRD_FLU))


def _linear(message: TwistWithCovarianceStamped, turn: Array) -> tuple[Array, Array]:
    """Return velocity (3,), NaN in axes of variance -1, and covariance (3, 3), zero where it is
    unknown, in axes that `turn` (3, 3) leads to."""
    linear = message.twist.twist.linear
    velocity = turn @ np.array([linear.x, linear.y, linear.z])
    if not np.isfinite(velocity).all():
        raise BadMessageError("velocity is not finite")
    covariance = turn @ np.array(message.twist.covariance).reshape(6, 6)[:3, :3] @ turn.T
    absent = np.diag(covariance) == _NOT_MEASURED
    velocity[absent] = np.nan
    covariance[absent], covariance[:, absent] = 0.0, 0.0
    require_covariance(covariance)
    return velocity, covariance


def fill_position(message: NavSatFix, ns: int, place: Array, aid: PositionAid) -> None:
    """Write what an aid gives of the position.

    Parameters
    ----------
    ns : int
        Stamp.
    place : (3,) array
        Latitude, longitude (rad), height (m); NaN = nothing, no satellites.
    aid : scenario.PositionAid
        What it believes of its errors.
    """
    if np.isnan(place).any():
        fill_fix(message, ns, 0.0, 0.0, 0.0, status=NavSatStatus.STATUS_NO_FIX)
        return
    covariance = np.diag(np.square(aid.unequal)) * (aid.sigma**2 + aid.correlated_sigma**2)
    latitude, longitude, height = place.tolist()
    fill_fix(message, ns, latitude, longitude, height, covariance)


def read_position_fix(message: NavSatFix) -> tuple[Array, Array | None] | None:
    """Return latitude, longitude (rad), height (m) as (3,), and the covariance (3, 3) NED, m²,
    None where it is not known; None where the aid has no fix. The frame of what is
    measured may have any name that is not a datum's.

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
    place = np.array(read_position(message, frame=""))
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        return place, None
    covariance = read_covariance(message)
    return place, covariance if covariance.any() else None


def fill_ground_velocity(
    message: TwistWithCovarianceStamped, ns: int, velocity: Array, sigma: float = 0.0
) -> None:
    """Write a velocity (3,) NED, m/s, with its horizontal 1-sigma (0 = unknown), on axes east,
    north, up, see `fill_twist`."""
    variance = np.square([sigma, sigma, VERTICAL * sigma])
    fill_twist(message, ns, NED_ENU @ velocity, variance)


def read_ground_velocity(message: TwistWithCovarianceStamped) -> tuple[Array, Array]:
    """Return velocity (3,) NED, m/s, NaN in axes of variance -1, and covariance (3, 3), zero where
    it is unknown, of a message whose axes are east, north, up.

    Raises
    ------
    BadMessageError
        Not finite, or of a negative variance.
    """
    return _linear(message, NED_ENU)
