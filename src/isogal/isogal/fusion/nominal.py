"""The nominal state of the filter, as kernels take it, and moving it by an error state."""

import math
from typing import NamedTuple

import numpy as np

from isogal.arrays import Array
from isogal.compiled import kernel
from isogal.earth.ellipsoid import curvature, metres_per_radian
from isogal.inertial.rotations import (
    INLINE,
    from_rotation_vector,
    multiply,
    to_rotation_vector,
)


class Nominal(NamedTuple):
    """The arrays of the mean; functions change them in place."""

    position: Array
    """(3,) latitude rad, longitude rad, height m."""
    velocity: Array
    """(3,) m/s NED."""
    attitude: Array
    """(4,) quaternion body to NED."""
    accelerometer_bias: Array
    """(3,) m/s², body."""
    gyroscope_bias: Array
    """(3,) rad/s, body."""
    auxiliary: Array
    """(M,) of the auxiliary states (`isogal.fusion.auxiliary`)."""


@kernel(**INLINE)
def move(nominal: Nominal, error: Array) -> None:
    """Add an error state (15 + M,) to a state, in place: position over the local
    radii, attitude by the quaternion of the rotation vector on the left, the rest by addition."""
    position, attitude = nominal.position, nominal.attitude
    m, n = curvature(math.sin(position[0]))
    position[1] += error[1] / ((n + position[2]) * math.cos(position[0]))
    position[0] += error[0] / (m + position[2])
    position[2] -= error[2]
    bw, bx, by, bz = from_rotation_vector(error[6], error[7], error[8])
    attitude[0], attitude[1], attitude[2], attitude[3] = multiply(
        bw, bx, by, bz, attitude[0], attitude[1], attitude[2], attitude[3]
    )
    for i in range(3):
        nominal.velocity[i] += error[3 + i]
        nominal.accelerometer_bias[i] += error[9 + i]
        nominal.gyroscope_bias[i] += error[12 + i]
    for j in range(len(nominal.auxiliary)):
        nominal.auxiliary[j] += error[15 + j]


def error_between(state: Nominal, origin: Nominal) -> Array:
    """Return the error state (15 + M,) that moves one state to another, the inverse of `move`."""
    latitude, _, height = origin.position
    metres = np.array([*metres_per_radian(latitude, height), -1.0])
    w, x, y, z = origin.attitude
    turn = to_rotation_vector(*multiply(*state.attitude, w, -x, -y, -z))
    return np.concatenate(
        [
            (state.position - origin.position) * metres,
            state.velocity - origin.velocity,
            turn,
            state.accelerometer_bias - origin.accelerometer_bias,
            state.gyroscope_bias - origin.gyroscope_bias,
            state.auxiliary - origin.auxiliary,
        ]
    )
