"""A pose that a user gives on initialpose, as a state of the filter."""

import math

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import from_matrix, matrix
from isogal_ros.messages.checks import (
    BadMessageError,
    require_covariance,
    require_frame,
    unit_quaternion,
)
from isogal_ros.messages.frames import FRD_FLU, MAP, NED_ENU
from isogal_ros.messages.position import read_point

SPEED_SHARE = 0.25
"""1-sigma of the velocity that a pose leaves open, as a share of the speed."""


def placed(
    state: FilterState, message: PoseWithCovarianceStamped, frame: LocalFrame, speed: float
) -> FilterState:
    """Return a state at a pose, with the biases of another state.

    The velocity, which a pose does not say, is a speed (m/s) straight ahead. Where the variances
    of the orientation are zero, those of the other state stand.

    Raises
    ------
    BadMessageError
        The pose is of another frame, not finite, without the variance of a position, or its
        orientation is not a unit quaternion.
    """
    require_frame(message, MAP)
    latitude, longitude, height = read_point(message.pose.pose.position, frame).tolist()
    turn = unit_quaternion(message.pose.pose.orientation)
    covariance = np.asarray(message.pose.covariance).reshape(6, 6)
    require_covariance(covariance)
    if min(covariance[0, 0], covariance[1, 1]) <= 0.0:
        raise BadMessageError("the variances of x and y must be positive")
    to_ned = (frame.rotation_from(latitude, longitude) @ NED_ENU).T
    attitude = to_ned @ matrix(turn) * FRD_FLU
    new = state.copy()
    new.position[:] = latitude, longitude, height
    new.attitude[:] = from_matrix(attitude)
    ahead = attitude[:2, 0] / max(math.hypot(*attitude[:2, 0]), 1e-9)
    new.velocity[:] = [*(speed * ahead), 0.0]
    _set_covariance(new, covariance, to_ned, max(SPEED_SHARE * speed, 0.1))
    return new


def _set_covariance(state: FilterState, pose: Array, to_ned: Array, of_velocity: float) -> None:
    """Write a pose's covariance (6, 6; frame ``map``) and a velocity's 1-sigma (m/s)."""
    P = state.covariance
    variances = np.diag(P).copy()
    P[:9, :], P[:, :9] = 0.0, 0.0
    P[:3, :3] = to_ned @ pose[:3, :3] @ to_ned.T
    P[2, :3] = P[:3, 2] = 0.0
    P[2, 2] = variances[2]  # the height is known
    P[3:5, 3:5], P[5, 5] = of_velocity**2 * np.eye(2), variances[5]
    turned = pose[3:, 3:]
    if np.diag(turned).min() > 0.0:
        P[6:9, 6:9] = to_ned @ turned @ to_ned.T
    else:
        P[6:9, 6:9] = np.diag(variances[6:9])
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        raise BadMessageError("covariance is not positive definite") from None
