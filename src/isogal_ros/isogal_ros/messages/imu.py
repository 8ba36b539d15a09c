"""Inertial samples as Imu messages."""

import math

import numpy as np
from sensor_msgs.msg import Imu

from isogal.arrays import Array
from isogal.scenario import ImuErrors
from isogal.sensors.imu_model import noise_density
from isogal_ros.messages.checks import ABSENT, BadMessageError, require_frame
from isogal_ros.messages.frames import BASE, FRD_FLU
from isogal_ros.messages.prepared import Prepared, Reader, numbers_of, write

_RATE, _FORCE = slice(13, 16), slice(25, 28)
_VARIANCES = [28, 32, 36, 16, 20, 24]
"""Among the 37 numbers of a message: orientation, angular velocity and linear acceleration, each
with its covariance. The variances are of the specific force, then of the angular rate."""
LARGEST_RATE = 100.0
"""rad/s: no vehicle of this kind reaches it, a broken sensor does."""


def fill_imu(message: Imu | Prepared, ns: int, specific_force: Array, angular_rate: Array) -> None:
    """Write the means over an interval that ends at the stamp into an Imu message, which has no
    orientation (REP-145).

    Parameters
    ----------
    specific_force, angular_rate : (3,) arrays
        FRD, m/s² and rad/s.
    """
    numbers = numbers_of(message)
    numbers[_FORCE], numbers[_RATE] = specific_force * FRD_FLU, angular_rate * FRD_FLU
    write(message, ns, numbers)


def fill_noise(message: Imu, errors: ImuErrors, interval: float) -> None:
    """Write the white noise that a data sheet says into the covariances, per sample of an interval
    (s). Biases and what else is not white have no place in them."""
    variance = noise_density(errors, interval) ** 2 / interval
    message.linear_acceleration_covariance = np.diag(variance[:3]).ravel()
    message.angular_velocity_covariance = np.diag(variance[3:]).ravel()


def read_imu(data: bytes, frame: str = BASE) -> tuple[Array, Array, Array | None]:
    """Return (specific force m/s², angular rate rad/s, the variance of the rate that is declared,
    (rad/s)², or None), each (3,) FRD, of a serialised Imu message: of hundreds a second, rclpy
    takes longer to make objects than the filter takes for what they say.

    Raises
    ------
    BadMessageError
        The message is of another frame, not finite, or says that it has no specific force or
        angular rate.
    """
    content = Reader(data)
    content.stamp()
    require_frame(content.text(), frame, "imu_frame")
    numbers = content.take("37d")
    force, rate = numbers[_FORCE], numbers[_RATE]
    if not math.isfinite(sum(force) + sum(rate)):
        raise BadMessageError("specific force or angular rate is not finite")
    variances = [numbers[k] for k in _VARIANCES]
    if ABSENT in (variances[0], variances[3]):
        raise BadMessageError("marked as without specific force or angular rate (covariance -1)")
    if min(variances) < 0.0:
        raise BadMessageError("negative variance")
    declared = np.array(variances[3:]) if any(variances[3:]) else None
    return np.array(force) * FRD_FLU, np.array(rate) * FRD_FLU, declared


def require_noise(variance: Array | None) -> Array | None:
    """Return a declared variance (3,) of the rate; raise BadMessageError where it is none that the
    filter can compute with."""
    if variance is not None and not (variance <= LARGEST_RATE**2).all():  # NaN is not below
        raise BadMessageError(
            f"variance of the angular rate is not finite, or above {LARGEST_RATE**2:g} (rad/s)²"
        )
    return variance
