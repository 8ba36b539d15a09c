"""What the filter publishes: nav/fix, nav/odom, nav/covariance, nav/path."""

import math
from copy import deepcopy

import numpy as np
from geometry_msgs.msg import PoseStamped

from isogal.arrays import Array
from isogal.earth.ellipsoid import EARTH_RATE
from isogal.fusion.state import FilterState
from isogal.inertial.rotations import rotate
from isogal_ros import topics
from isogal_ros.messages.frames import BASE, MAP, map_frame
from isogal_ros.messages.odometry import fill_odom
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamped_numbers import fill_numbers
from isogal_ros.messages.stamps import from_ns, from_seconds, to_ns
from isogal_ros.nodes.base import GraphNode


class Answer:
    """Publishers and messages of the navigation; the messages are made once and overwritten."""

    def __init__(self, node: GraphNode) -> None:
        self._frame = map_frame(node.scenario)
        self._interval = from_seconds(node.settings.path_interval)
        self._covariance, self._fix = (
            node.advertise(topics.NAV_COVARIANCE),
            node.advertise(topics.NAV_FIX),
        )
        self._odom, self._path = node.advertise(topics.NAV_ODOM), node.advertise(topics.NAV_PATH)
        self._m_covariance, self._m_fix = topics.NAV_COVARIANCE.type(), topics.NAV_FIX.type()
        self._m_odom, self._m_path = (
            topics.NAV_ODOM.type(child_frame_id=BASE),
            topics.NAV_PATH.type(),
        )
        self._m_fix.header.frame_id = BASE
        self._m_odom.header.frame_id = self._m_path.header.frame_id = MAP

    def publish(self, ns: int, state: FilterState, angular_rate: Array) -> None:
        """Publish a state (R = 1), and the gyroscopes' angular rate (3,) FRD at it."""
        covariance = state.covariance[0]
        latitude, longitude, height = state.position[0].tolist()
        nav = np.concatenate([state.position[0], state.velocity[0], state.attitude[0]])
        # the odometry first: a lock-step simulation goes on with it while the rest is made
        fill_odom(self._m_odom, ns, self._frame, nav, _turn_rate(state, angular_rate), covariance)
        self._odom.publish(self._m_odom)
        fill_numbers(self._m_covariance, ns, state.batch_prior[0])
        self._covariance.publish(self._m_covariance)
        fill_fix(self._m_fix, ns, latitude, longitude, height, covariance[:3, :3])
        self._fix.publish(self._m_fix)
        self._extend_path(ns)

    def _extend_path(self, ns: int) -> None:
        poses = self._m_path.poses
        if poses and ns - to_ns(poses[-1].header.stamp) < self._interval:
            return
        poses.append(
            PoseStamped(
                header=deepcopy(self._m_odom.header), pose=deepcopy(self._m_odom.pose.pose)
            )
        )
        self._m_path.header.stamp = from_ns(ns)
        self._path.publish(self._m_path)


def _turn_rate(state: FilterState, angular_rate: Array) -> Array:
    """Return the angular rate relative to the Earth (3,) FRD: the gyroscopes' without their biases
    and the Earth's rotation."""
    latitude = state.position[0, 0]
    w, x, y, z = state.attitude[0]
    earth = rotate(
        w, -x, -y, -z, EARTH_RATE * math.cos(latitude), 0.0, -EARTH_RATE * math.sin(latitude)
    )
    return angular_rate - state.gyroscope_bias[0] - np.array(earth)
