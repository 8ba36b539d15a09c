"""Where a navigator begins: at a pose that was given, its checkpoint, the solution of an INS, the
scenario's start, or with an alignment."""

import math
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.errors import InputError
from isogal.fusion.alignment import Alignment
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.model import FilterModel
from isogal.fusion.outage import UnknownMotion
from isogal.fusion.state import FilterState
from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_angles, from_matrix, matrix, to_angles
from isogal.scenario import Truth
from isogal.sensors.initial import draw_initial_state
from isogal.sensors.trajectory import build_trajectory
from isogal_ros.messages.checks import BadMessageError, require_covariance, unit_quaternion
from isogal_ros.messages.frames import FRD_FLU
from isogal_ros.messages.ins_solution import HIGHEST
from isogal_ros.messages.position import read_pose
from isogal_ros.messages.stamps import from_seconds, to_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.checkpoint import Checkpoint
from isogal_ros.nodes.health import ERROR, OK, WARN
from isogal_ros.topics import INITIAL_POSE
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
    state = Estimate(*(part.copy() for part in state))
    for name, part in zip(("position", "velocity", "attitude"), state, strict=True):
        value = np.array(getattr(settings, f"start_{name}"), dtype=float)
        if np.isnan(value).all():
            continue
        if not np.isfinite(value).all():
            raise InputError(f"start_{name}: give all three numbers, or none")
        if name == "position":
            if abs(value[0]) > 89.9 or abs(value[1]) > 360.0:
                raise InputError(f"start_position: no such place: {value[0]}, {value[1]} deg")
            value[:2] = np.radians(value[:2])
        part[:] = from_angles(*np.radians(value)) if name == "attitude" else value
    return state


LARGEST_SIGMA = 1e6
"""m. Sigma points of a wider Gaussian do not lie on one side of the Earth."""
LOWEST = -12e3
"""m, below the deepest sea."""


def placed(
    state: FilterState, message: PoseWithCovarianceStamped, frame: LocalFrame, turns: bool
) -> FilterState:
    """Return a state at a pose, with the biases of another state.

    Of z, of roll and pitch, and of yaw what has a variance of zero stands as the other state has
    it: RViz has one of yaw only, and a place in the plane of the map says no height. A state that
    is not turned keeps its velocity; of one that is turned, which a pose does not say, it is the
    other's speed straight ahead.

    Parameters
    ----------
    state : FilterState
        The other.
    message : PoseWithCovarianceStamped
    frame : LocalFrame
        The frame ``map``.
    turns : bool
        Whether the orientation counts; that of a yaw without variance with the other's.

    Raises
    ------
    BadMessageError
        The pose is of another frame, not finite, of no height of a vehicle, without the variance
        of a position, or with one that the filter cannot compute with; or its orientation is not
        a unit quaternion.
    """
    place, covariance, to_ned = read_pose(message, frame)
    turn = unit_quaternion(message.pose.pose.orientation)
    _require_usable(covariance)
    new = state.copy()
    P, has_height = new.covariance, covariance[2, 2] > 0.0
    if not has_height:
        place[2] = state.position[2]
    if not LOWEST <= place[2] <= HIGHEST:
        raise BadMessageError(
            f"height is {place[2]:.0f} m, must be {LOWEST:g} to {HIGHEST:g}; the"
            " filter's own with variance 0 of z"
        )
    new.position[:] = place
    local = to_ned @ covariance[:3, :3] @ to_ned.T
    _write(P, slice(0, 2), local[:2, :2])
    _write(P, slice(2, 3), local[2:, 2:] if has_height else P[2:3, 2:3].copy())
    if turns:
        rotation = to_ned @ matrix(turn) * FRD_FLU
        _turn(new, rotation, to_ned @ covariance[3:, 3:] @ to_ned.T, np.diag(covariance)[3:])
        _go_ahead(new)
    try:
        np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        raise BadMessageError("covariance is not positive definite") from None
    return new


def _require_usable(covariance: Array) -> None:
    """Raise BadMessageError where a filter cannot begin with the covariance (6, 6) of a pose."""
    require_covariance(covariance)
    variances = np.diag(covariance)
    if not 0.0 < variances[:2].min() <= variances[:2].max() <= LARGEST_SIGMA**2:
        most = f"at most {LARGEST_SIGMA**2:g} m²"
        raise BadMessageError(f"the variances of x and y must be positive, and {most}")
    if variances[3:].max() > math.pi**2:
        raise BadMessageError(
            "the variances of the orientation must be at most π² rad², or 0 for the filter's own"
        )


def _turn(state: FilterState, rotation: Array, covariance: Array, variances: Array) -> None:
    """Turn a state to a rotation (3, 3) FRD to NED with the covariance (3, 3) of its error; only
    the heading unless there are variances (3,) of roll, pitch and yaw."""
    P = state.covariance
    if variances.min() > 0.0:
        state.attitude[:] = from_matrix(rotation)
        _write(P, slice(6, 9), covariance)
        return
    roll, pitch, _ = to_angles(matrix(state.attitude))
    state.attitude[:] = from_angles(roll, pitch, to_angles(rotation)[2])
    heading = covariance if variances[2] > 0.0 else P[6:9, 6:9].copy()
    _write(P, slice(8, 9), heading[2:, 2:])


def _go_ahead(state: FilterState) -> None:
    """Turn a state's velocity to straight ahead; how far off that is, its speed says."""
    speed = math.hypot(*state.velocity[:2])
    forward = matrix(state.attitude)[:2, 0]
    state.velocity[:2] = speed * forward / max(math.hypot(*forward), 1e-9)
    state.velocity[2] = 0.0
    P = state.covariance
    _write(P, slice(3, 5), max(SPEED_SHARE * speed, 0.1) ** 2 * np.eye(2))
    _write(P, slice(5, 6), P[5:6, 5:6].copy())


def _write(covariance: Array, which: slice, new: Array) -> None:
    """Write the covariance of some states, which have nothing to do with all others."""
    covariance[which, :], covariance[:, which] = 0.0, 0.0
    covariance[which, which] = new


REACH = 1.2
"""Lags that the history goes back where states are smoothed, which is done by a tenth of it."""


class Begun(NamedTuple):
    """A navigator that has begun."""

    ns: int
    """Stamp of its state."""
    navigator: InertialNavigator
    fresh: bool = False
    """Whether it has begun at the start itself, which is then to be published."""


class Beginning:
    """Makes navigators; says in the diagnostics why there is none yet.

    Parameters
    ----------
    node : GraphNode
        Its scenario and settings; its health is told.
    model : FilterModel
    checkpoint : Checkpoint
        Of the node.
    """

    def __init__(
        self, node: GraphNode[UkfFusionSettings], model: FilterModel, checkpoint: Checkpoint
    ) -> None:
        self._settings, self._health, self._scenario = node.settings, node.health, node.scenario
        self._log, self._model, self._checkpoint = node.get_logger(), model, checkpoint
        self._horizon = max(node.settings.horizon, REACH * node.scenario.fusion.lag)
        self._motion = UnknownMotion(
            node.settings.outage_acceleration,
            node.settings.outage_turn_rate,
            node.settings.manoeuvre_interval,
        ).of_vehicle(node.scenario.velocity_aids)
        self.start = FilterState.start(initial_state(node.scenario.true, node.settings), model)
        """The scenario's."""
        self._placed: tuple[int, FilterState] | None = None
        """Stamp (0 = none) and state of a pose."""
        self._why_not = ""
        """Why it cannot begin at the scenario's start, where it cannot."""

    def navigator(
        self, ns: int, state: FilterState, sample: tuple[Array, Array] | None = None
    ) -> InertialNavigator:
        """Return a navigator that goes on from a state at a stamp, with the sample that has led to
        it (specific force and angular rate) where that is known."""
        sigma = float(np.sqrt(np.trace(state.covariance[:2, :2])))
        self._log.info(f"navigates from {to_seconds(ns):.0f} s on; 1-sigma {sigma:.0f} m")
        self._placed = None
        return InertialNavigator(
            self._model, state, to_seconds(ns), self._horizon, self._motion, sample
        )

    def place(self, ns: int, state: FilterState) -> None:
        """Begin at a state of a stamp (0 = none), with the first sample."""
        self._placed = ns, state
        self._health.state(OK, "placed; waits for IMU samples")

    def reset(self, why_not: str = "") -> None:
        """Forget all but the scenario's start; that as well where something (`why_not`) was lost:
        begin with a pose only, or with what needs no start."""
        self._checkpoint.forget()
        self._placed, self._why_not = None, ""
        if why_not:
            self._wait_for_pose(why_not)

    def _wait_for_pose(self, why: str) -> None:
        self._why_not = f"waits for a pose on initialpose: {why}"
        self._health.state(ERROR, self._why_not)

    def find(self, ns: int, solution: Array | None = None) -> Begun | None:
        """Begin with the first sample (its stamp), or with the first solution (10,) of an INS;
        None = there is nothing to begin with."""
        first = ns if solution is not None else ns - from_seconds(1.0 / self._scenario.imu.rate)
        if self._placed is not None and self._fits_data(self._placed[0] or first, first):
            ns, state = self._placed
            if ns > first:
                return None
            if solution is not None:  # a pose says less of both, and they must be the INS's
                state.velocity[:], state.attitude[:] = solution[3:6], solution[6:]
            return Begun(ns or first, self.navigator(ns or first, state))
        if (saved := self._checkpoint.take(first)) is not None:
            return Begun(saved.time, self.navigator(saved.time, *saved.content))
        if solution is not None:
            start = with_given(self._settings, Estimate(*np.split(solution, [3, 6])))
            return Begun(ns, self.navigator(ns, FilterState.start(start, self._model)), True)
        if self._scenario.fusion.start == "align":
            alignment = Alignment(
                self._model,
                self.start.position,
                to_seconds(first),
                measured=self._scenario.gnss.used,
                aim=self._scenario.fusion.align_to,
                horizon=self._settings.horizon,
                motion=self._motion,
            )
            return Begun(first, alignment, True)
        return self._at_the_start(first)

    def _fits_data(self, ns: int, first: int) -> bool:
        """Whether a pose is of the time of the data; else it is dropped, and that is said."""
        if abs(first - ns) <= from_seconds(self._settings.max_gap):
            return True
        self._placed = None
        begin = f"the data begin at {to_seconds(first):.1f} s"
        text = f"stamp {to_seconds(ns):.1f} s, where {begin}; 0 = when they begin"
        self._health.drop(INITIAL_POSE.name, text)
        return False

    def _at_the_start(self, first: int) -> Begun | None:
        """Begin at the scenario's start if that is true at a stamp; else say what is waited
        for."""
        if self._why_not:
            self._health.state(ERROR, self._why_not)
            return None
        given = self._settings.start_time
        start = from_seconds(given) if math.isfinite(given) else first
        margin = from_seconds(min(0.5 * self._model.dt, 1.0))
        if first < start - margin:
            at = to_seconds(start)
            self._health.state(WARN, f"waits for the start at {at:.3f} s (start_time)")
            return None
        if first <= start + from_seconds(self._settings.max_gap):
            # of a sample or two less than a millisecond apart the stamps are the same
            ns = first if abs(first - start) <= margin else start
            return Begun(ns, self.navigator(ns, self.start), True)
        self._wait_for_pose(
            f"the data begin at {to_seconds(first):.3f} s, the scenario's start is true at"
            f" {to_seconds(start):.3f} s (start_time), and there is nothing to go on from"
            f" ({self._checkpoint.reason})"
        )
        return None
