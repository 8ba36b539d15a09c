"""Height and velocity sensors as messages: FluidPressure and TwistWithCovarianceStamped."""

import math

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from sensor_msgs.msg import FluidPressure

from isogal.arrays import Array
from isogal.scenario import Height
from isogal.sensors.barometer import height_of, height_slope, pressure_of
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    require_reading,
)
from isogal_ros.messages.frames import BASE, FRD_FLU
from isogal_ros.messages.stamps import set_stamp

_SIX_FLU = np.concatenate([FRD_FLU, FRD_FLU])
_NOT_MEASURED = -1.0
"""Variance of an axis that a sensor does not measure."""


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
    linear = message.twist.twist.linear
    velocity = np.array([linear.x, linear.y, linear.z]) * FRD_FLU
    if not np.isfinite(velocity).all():
        raise BadMessageError("velocity is not finite")
    whole = np.array(message.twist.covariance).reshape(6, 6) * np.outer(_SIX_FLU, _SIX_FLU)
    covariance = whole[:3, :3]
    absent = np.diag(covariance) == _NOT_MEASURED
    velocity[absent] = np.nan
    covariance[absent], covariance[:, absent] = 0.0, 0.0
    require_covariance(covariance)
    return velocity, covariance
