"""The filter's first state, and one that a user gives: a pose on initialpose."""

import math

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.errors import InputError
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_angles, from_matrix, matrix
from isogal.scenario import Truth
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.messages.checks import BadMessageError, require_covariance, unit_quaternion
from isogal_ros.messages.frames import FRD_FLU
from isogal_ros.messages.position import read_pose
from ukf_fusion_node.settings import UkfFusionSettings

SPEED_SHARE = 0.25
"""1-sigma of the velocity that a pose leaves open, as a share of the speed."""


def initial_state(truth: Truth, settings: UkfFusionSettings) -> Estimate:
    """Return the first state: what the parameters give, and the rest as it is drawn, with errors
    as large as they really are.

    Raises
    ------
    InputError
        Only some of the numbers of a start are given, or the position is impossible.
    """
    # two steps of the route are enough to know its start
    route = truth.route.model_copy(update={"duration": 2.0 / truth.navigation_rate})
    trajectory = build_trajectory(truth.model_copy(update={"route": route}))
    drawn = draw_initial_state(truth.initial_error, trajectory, truth.seed, [settings.run])
    state = Estimate(drawn.position[0], drawn.velocity[0], drawn.attitude[0])
    return with_given(settings, state)


def with_given(settings: UkfFusionSettings, state: Estimate) -> Estimate:
    """Return a start with what the parameters give of it; raises InputError as `initial_state`."""
    parts = {
        name: np.array(getattr(settings, name), dtype=float)
        for name in ("start_position", "start_velocity", "start_attitude")
    }
    for name, value in parts.items():
        if np.isnan(value).any() and not np.isnan(value).all():
            raise InputError(f"{name}: give all three numbers, or none")
    given = {name: value for name, value in parts.items() if not np.isnan(value).any()}
    state = Estimate(*(part.copy() for part in state))
    if "start_position" in given:
        latitude, longitude, height = given["start_position"]
        if not (abs(latitude) <= 89.9 and abs(longitude) <= 360.0 and math.isfinite(height)):
            raise InputError(
                f"start_position: no such place: {latitude}, {longitude} deg, {height} m"
            )
        state.position[:] = math.radians(latitude), math.radians(longitude), height
    if "start_velocity" in given:
        state.velocity[:] = given["start_velocity"]
    if "start_attitude" in given:
        state.attitude[:] = from_angles(*np.radians(given["start_attitude"]))
    return state


def placed(
    state: FilterState, message: PoseWithCovarianceStamped, frame: LocalFrame, speed: float
) -> FilterState:
    """Return a state at a pose, with the biases of another state.

    The velocity, which a pose does not say, is a speed (m/s) straight ahead. Where the variances
    of the orientation are zero, those of the other state stand.

    Parameters
    ----------
    state : FilterState
        The other.
    message : PoseWithCovarianceStamped
    frame : LocalFrame
        The frame ``map``.
    speed : float
        m/s.

    Raises
    ------
    BadMessageError
        The pose is of another frame, not finite, without the variance of a position, or its
        orientation is not a unit quaternion.
    """
    place, covariance, to_ned = read_pose(message, frame)
    turn = unit_quaternion(message.pose.pose.orientation)
    require_covariance(covariance)
    if min(covariance[0, 0], covariance[1, 1]) <= 0.0:
        raise BadMessageError("the variances of x and y must be positive")
    attitude = to_ned @ matrix(turn) * FRD_FLU
    new = state.copy()
    new.position[:] = place
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
