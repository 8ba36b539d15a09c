"""Sensors beside the IMU as messages: FluidPressure, NavSatFix and TwistWithCovarianceStamped."""

import math
from collections.abc import Callable, Mapping

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from sensor_msgs.msg import FluidPressure, NavSatFix, NavSatStatus

from isogal.arrays import Array
from isogal.scenario import Gnss, Height, Settings
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
AIDS: Mapping[Topic, Callable[[Settings], bool]] = {
    topics.BAROMETER: lambda scenario: scenario.height.measured,
    topics.VELOCITY: lambda scenario: scenario.velocity.kind != "none",
    topics.GNSS_FIX: lambda scenario: scenario.gnss.used,
    topics.GNSS_VELOCITY: lambda scenario: (
        scenario.gnss.used and scenario.gnss.velocity_sigma is not None
    ),
}
"""Topics of the sensors beside the IMU that the filter may have, and whether it has them."""


def aids_of(scenario: Settings) -> tuple[Topic, ...]:
    """Return which of `AIDS` the filter of a scenario takes."""
    return tuple(topic for topic, used in AIDS.items() if used(scenario))


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


def fill_velocity(message: TwistWithCovarianceStamped, ns: int, velocity: Array) -> None:
    """Write a velocity (3,) FRD, m/s, into a TwistWithCovarianceStamped; an axis that is not
    measured (NaN) has the variance -1, the others 0, unknown."""
    set_stamp(message.header.stamp, ns)
    linear = message.twist.twist.linear
    linear.x, linear.y, linear.z = np.nan_to_num(velocity * FRD_FLU).tolist()
    for axis, value in enumerate(velocity.tolist()):
        message.twist.covariance[7 * axis] = _NOT_MEASURED if math.isnan(value) else 0.0


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


def fill_satellite_fix(message: NavSatFix, ns: int, place: Array, gnss: Gnss) -> None:
    """Write what a satellite receiver gives.

    Parameters
    ----------
    ns : int
        Stamp.
    place : (3,) array
        Latitude, longitude (rad), height (m); NaN = no satellites.
    gnss : scenario.Gnss
        What the receiver believes of its errors.
    """
    if np.isnan(place).any():
        fill_fix(message, ns, 0.0, 0.0, 0.0, status=NavSatStatus.STATUS_NO_FIX)
        return
    variance = gnss.position_sigma**2 + gnss.correlated_sigma**2
    covariance = np.diag([variance, variance, VERTICAL**2 * variance])
    latitude, longitude, height = place.tolist()
    fill_fix(message, ns, latitude, longitude, height, covariance)


def read_satellite_fix(message: NavSatFix) -> tuple[Array, Array | None] | None:
    """Return latitude, longitude (rad), height (m) as (3,), and the covariance (3, 3) NED, m²,
    None where it is not known; None where the receiver has no fix. The antenna's frame may have
    any name.

    Raises
    ------
    BadMessageError
        Not finite, of no place on Earth, or of a covariance that is none.
    """
    if message.status.status == NavSatStatus.STATUS_NO_FIX:
        return None
    place = np.array(read_position(message, frame=""))
    if message.position_covariance_type == NavSatFix.COVARIANCE_TYPE_UNKNOWN:
        return place, None
    covariance = read_covariance(message)
    return place, covariance if covariance.any() else None


def fill_ground_velocity(
    message: TwistWithCovarianceStamped, ns: int, velocity: Array, gnss: Gnss
) -> None:
    """Write the velocity (3,) NED, m/s, of a satellite receiver, east-north-up in the message; an
    axis that is not measured (NaN) has the variance -1."""
    set_stamp(message.header.stamp, ns)
    linear = message.twist.twist.linear
    east_north_up = NED_ENU @ velocity
    linear.x, linear.y, linear.z = np.nan_to_num(east_north_up).tolist()
    variance = (gnss.velocity_sigma or 0.0) ** 2
    for axis, factor in enumerate((1.0, 1.0, VERTICAL**2)):
        known = math.isfinite(east_north_up[axis])
        message.twist.covariance[7 * axis] = factor * variance if known else _NOT_MEASURED


def read_ground_velocity(message: TwistWithCovarianceStamped) -> tuple[Array, Array]:
    """Return velocity (3,) NED, m/s, NaN in axes of variance -1, and covariance (3, 3), zero where
    it is unknown, of a message whose axes are east, north, up.

    Raises
    ------
    BadMessageError
        Not finite, or of a negative variance.
    """
    return _linear(message, NED_ENU)
