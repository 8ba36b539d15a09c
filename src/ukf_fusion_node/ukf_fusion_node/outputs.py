"""Messages of the filter: nav/fix, nav/odom, nav/protection_level, nav/covariance, nav/path."""

from copy import deepcopy

import numpy as np
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Float64

from isogal.arrays import Array
from isogal.fusion.protection_level import protection_level
from isogal.fusion.state import FilterState
from isogal_ros import topics
from isogal_ros.messages.frames import BASE, MAP, map_frame
from isogal_ros.messages.odometry import fill_odom
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.stamped_numbers import AidedSince, fill_nav_covariance
from isogal_ros.messages.stamps import from_ns, from_seconds, to_ns
from isogal_ros.nodes.base import GraphNode
from ukf_fusion_node.transforms import Transforms

PATH_POSES = 500
"""Of nav/path at most; then every other one is left out, and they come half as often. The whole
path goes into each message: without end it would grow, and with it what the middleware keeps for
each message that a slow listener has not taken."""


class Outputs:
    """Publishers and messages; the messages are made once and overwritten."""

    def __init__(self, node: GraphNode) -> None:
        self.reached = -1
        """Stamp of the newest state published, ns; -1 = none."""
        self._frame = map_frame(node.scenario)
        self._interval = from_seconds(node.settings.path_interval)
        self._fix, self._odom = node.advertise(topics.NAV_FIX), node.advertise(topics.NAV_ODOM)
        self._covariance = node.advertise(topics.NAV_COVARIANCE)
        self._path = node.advertise(topics.NAV_PATH)
        self._level, self._m_level = node.advertise(topics.PROTECTION_LEVEL), Float64()
        self._integrity = node.scenario.integrity
        self._m_fix, self._m_covariance = topics.NAV_FIX.type(), topics.NAV_COVARIANCE.type()
        self._m_odom = topics.NAV_ODOM.type(child_frame_id=BASE)
        self._m_path = topics.NAV_PATH.type()
        self._m_fix.header.frame_id = BASE
        self._transforms = Transforms(node)
        self._m_odom.header.frame_id = self._m_path.header.frame_id = MAP

    def publish(
        self,
        ns: int,
        state: FilterState,
        angular_rate: Array,
        aided: AidedSince | None = None,
    ) -> None:
        """Publish a state, the angular rate (3,) FRD that the gyroscopes measured, and what
        satellites have told since the last fix."""
        self.reached = ns
        covariance = state.covariance
        latitude, longitude, height = state.position.tolist()
        nav = np.concatenate(state.estimate)
        turn_rate = state.turn_rate(angular_rate)
        # odometry first: a lock-step simulation goes on with it while the rest is made
        fill_odom(self._m_odom, ns, self._frame, nav, turn_rate, covariance)
        self._odom.publish(self._m_odom)
        promise = self._integrity
        self._m_level.data = float(
            protection_level(covariance[:2, :2], promise.risk, promise.correlation_time)
        )
        self._level.publish(self._m_level)
        fill_nav_covariance(self._m_covariance, ns, state.batch_prior, aided)
        self._covariance.publish(self._m_covariance)
        fill_fix(self._m_fix, ns, latitude, longitude, height, covariance[:3, :3])
        self._fix.publish(self._m_fix)
        self._transforms.publish(ns, self._m_odom.pose.pose)
        self._extend_path(ns)

    def _extend_path(self, ns: int) -> None:
        poses = self._m_path.poses
        if poses and ns - to_ns(poses[-1].header.stamp) < self._interval:
            return
        if len(poses) == PATH_POSES:
            del poses[1::2]
            self._interval *= 2
        poses.append(
            PoseStamped(
                header=deepcopy(self._m_odom.header), pose=deepcopy(self._m_odom.pose.pose)
            )
        )
        self._m_path.header.stamp = from_ns(ns)
        self._path.publish(self._m_path)
