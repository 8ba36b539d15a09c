"""Inertial samples as Imu messages."""

import numpy as np
from sensor_msgs.msg import Imu

from isogal.arrays import Array
from isogal.scenario import ImuErrors
from isogal.sensors.imu_model import noise_density
from isogal_ros.messages.checks import BadMessageError, require_frame
from isogal_ros.messages.frames import BASE, FRD_FLU
from isogal_ros.messages.stamps import set_stamp

LARGEST_FORCE, LARGEST_RATE = 1000.0, 100.0
"""m/s² and rad/s: no vehicle of this kind reaches them, a broken sensor does."""


def fill_imu(message: Imu, ns: int, specific_force: Array, angular_rate: Array) -> None:
    """Write the means over an interval that ends at the stamp into an Imu message, which has no
    orientation (REP-145).

    Parameters
    ----------
    specific_force, angular_rate : (3,) arrays
        FRD, m/s² and rad/s.
    """
    set_stamp(message.header.stamp, ns)
    force, rate = message.linear_acceleration, message.angular_velocity
    force.x, force.y, force.z = (specific_force * FRD_FLU).tolist()
    rate.x, rate.y, rate.z = (angular_rate * FRD_FLU).tolist()


def fill_noise(message: Imu, errors: ImuErrors, interval: float) -> None:
    """Write the white noise that a data sheet says into the covariances, per sample of an interval
    (s). Biases and what else is not white have no place in them."""
    variance = noise_density(errors, interval) ** 2 / interval
    message.linear_acceleration_covariance = np.diag(variance[:3]).ravel()
    message.angular_velocity_covariance = np.diag(variance[3:]).ravel()


def declared_variance(message: Imu) -> Array | None:
    """Return the variance of the angular rate (3,), (rad/s)², that a message declares; None where
    it declares none."""
    variance = np.array(message.angular_velocity_covariance[::4])
    return variance if variance.max() > 0.0 else None


def read_imu(message: Imu, frame: str = BASE) -> tuple[Array, Array]:
    """Return (specific force m/s², angular rate rad/s), each (3,) FRD.

    Raises
    ------
    BadMessageError
        The message is of another frame, not finite, beyond any vehicle, or says that it has no
        specific force or angular rate.
    """
    require_frame(message, frame, "imu_frame")
    force, rate = message.linear_acceleration, message.angular_velocity
    values = np.array([[force.x, -force.y, -force.z], [rate.x, -rate.y, -rate.z]])
    if not np.isfinite(values).all():
        raise BadMessageError("specific force or angular rate is not finite")
    if np.abs(values[0]).max() > LARGEST_FORCE or np.abs(values[1]).max() > LARGEST_RATE:
        raise BadMessageError(
            f"specific force above {LARGEST_FORCE:g} m/s² or angular rate above {LARGEST_RATE:g}"
            " rad/s"
        )
    of_force, of_rate = message.linear_acceleration_covariance, message.angular_velocity_covariance
    if of_force[0] == -1.0 or of_rate[0] == -1.0:
        raise BadMessageError("marked as without specific force or angular rate (covariance -1)")
    if min(of_force[::4]) < 0.0 or min(of_rate[::4]) < 0.0:
        raise BadMessageError("negative variance")
    return values[0], values[1]
