"""The solution of an INS as messages, and what is found wrong with it.

An Odometry holds all of it, in the frame ``map`` (`isogal_ros.messages.frames`), which is exact
however far the vehicle is from its origin, and with the child ``base_link``. Where there is no
attitude, a NavSatFix and a TwistWithCovarianceStamped of the same stamp, both of frame
``base_link``, hold the rest: whose position and velocity they are; the velocity is east, north,
up."""

import numpy as np
from geometry_msgs.msg import TwistWithCovarianceStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import NavSatFix

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame, horizontal_difference
from isogal.inertial.rotations import (
    from_matrix,
    from_rotation_vector,
    multiply,
    to_rotation_vector,
)
from isogal.scenario import Assumed, Ins
from isogal_ros import topics
from isogal_ros.messages.aids import fill_twist
from isogal_ros.messages.aids import read_velocity as read_twist
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import BASE, NED_ENU, framed, map_frame
from isogal_ros.messages.odometry import (
    FASTEST,
    empty_odometry,
    fill_odom,
    read_odometry,
    read_velocity,
)
from isogal_ros.messages.position import fill_fix, read_point, read_position
from isogal_ros.messages.prepared import Prepared, write
from isogal_ros.topics import Message, Topic

ENU = "enu"
"""Axes east, north, up at the vehicle."""
HIGHEST = 1e5
"""m: no vehicle is above the air."""
_POSE = [0, 1, 2, 6, 7, 8]


def inertial_topics(ins: Ins) -> tuple[Topic, ...]:
    """Return the topics that the filter has its inertial data from, the one that moves it on
    last."""
    if not ins.gives_solution:
        return (topics.IMU,)
    if ins.attitude:
        return (topics.INS_SOLUTION,)
    return topics.INS_SOLUTION_VELOCITY, topics.INS_SOLUTION_FIX


class SolutionMessages:
    """What a solution is said with, on the topics of `inertial_topics`.

    Parameters
    ----------
    assumed : Assumed
    """

    def __init__(self, assumed: Assumed) -> None:
        self.topics = inertial_topics(assumed.ins)
        self._whole, self._frame = assumed.ins.attitude, map_frame(assumed)
        self._messages = (
            [empty_odometry(topics.INS_SOLUTION)]
            if self._whole
            else [framed(topic, BASE) for topic in self.topics]
        )

    def of(self, ns: int, solution: Array, turn_rate: Array) -> list[Message | Prepared]:
        """Return the messages, one for each topic, of a solution (10,) as `read_solution` has it,
        with the angular rate (3,) relative to the Earth, FRD, rad/s; they are overwritten by the
        next."""
        if self._whole:
            fill_odom(self._messages[0], ns, self._frame, solution, turn_rate)
        else:
            fill_twist(self._messages[0], ns, NED_ENU @ solution[3:6])
            fill_fix(self._messages[1], ns, *solution[:3].tolist())
        return self._messages


def read_solution(data: bytes, frame: LocalFrame) -> Array:
    """Return (10,) latitude rad, longitude rad, height m, velocity NED m/s, quaternion FRD to
    NED, of a serialised Odometry.

    Raises
    ------
    BadMessageError
        The message is of other frames or not finite, of no place on the Earth, or its orientation
        is not a unit quaternion.
    """
    said = read_odometry(data)
    latitude, longitude, height = read_point(said.place, frame).tolist()
    velocity, _, attitude = read_velocity(said, frame, latitude, longitude)
    if abs(height) > HIGHEST:
        raise BadMessageError(f"height of {height:.0f} m: is the pose in the frame 'map'?")
    return np.array([latitude, longitude, height, *velocity, *from_matrix(attitude)])


def read_position_and_velocity(
    fix: NavSatFix, twist: TwistWithCovarianceStamped
) -> tuple[Array, Array]:
    """Return (3,) latitude rad, longitude rad, height m, and (3,) velocity NED, m/s; raises
    BadMessageError where one is of another frame, not finite, or impossible."""
    place = read_position(fix)
    velocity, _ = read_twist(twist, turn=NED_ENU)
    if not np.isfinite(velocity).all() or np.abs(velocity).max() > FASTEST:
        raise BadMessageError(f"velocity is not finite, or above {FASTEST:g} m/s")
    return np.array(place), velocity


def fill_error(
    message: Odometry, ns: int, solution: Array, state: Array, covariance: Array
) -> None:
    """Write what is wrong with a solution: solution less state, the attitude as the rotation from
    the state's to the solution's, all on axes east, north, up.

    Parameters
    ----------
    ns : int
        Stamp of both.
    solution, state : (10,) arrays
        As `read_solution` returns it; the state is where the vehicle is taken to be.
    covariance : (9+, 9+) array
        Of the state: position, velocity, attitude, NED.
    """
    message.header.frame_id = message.child_frame_id = ENU
    north, east = horizontal_difference(*solution[:2], *state[:2])
    place = east, north, solution[2] - state[2]
    velocity = NED_ENU @ (solution[3:6] - state[3:6])
    w, x, y, z = state[6:]
    turn = NED_ENU @ np.array(to_rotation_vector(*multiply(*solution[6:], w, -x, -y, -z)))
    orientation = np.roll(from_rotation_vector(*turn), -1)  # w last
    axes, twist = np.zeros((6, 6)), np.zeros((6, 6))
    axes[:3, :3] = axes[3:, 3:] = NED_ENU
    twist[:3, :3] = NED_ENU @ covariance[3:6, 3:6] @ NED_ENU
    pose = axes @ covariance[np.ix_(_POSE, _POSE)] @ axes
    write(message, ns, place, orientation, pose, velocity, np.zeros(3), twist)
