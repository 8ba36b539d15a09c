"""Messages of the filter: nav/fix, nav/odom, nav/protection_level, nav/covariance, nav/path."""

import numpy as np
from sensor_msgs.msg import NavSatStatus

from isogal.arrays import Array
from isogal.fusion.protection_level import protection_level
from isogal.fusion.state import FilterState
from isogal.passage import Passage
from isogal_ros import topics
from isogal_ros.messages.frames import BASE, framed, map_frame
from isogal_ros.messages.odometry import POSE, empty_odometry, fill_odom
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.prepared import Prepared, write
from isogal_ros.messages.stamped_numbers import AidedSince, fill_nav_covariance
from isogal_ros.nodes.base import GraphNode
from ukf_fusion_node.track import Track
from ukf_fusion_node.transforms import Transforms


class Outputs:
    """Publishers and messages; the messages are made once and overwritten."""

    def __init__(self, node: GraphNode) -> None:
        self.reached = -1
        """Stamp of the newest state published, ns; -1 = none."""
        self.newest = -1
        """Stamp of the newest odometry, which may be within a step, ns; -1 = none."""
        self._frame = map_frame(node.scenario)
        self._fix, self._odom = node.advertise(topics.NAV_FIX), node.advertise(topics.NAV_ODOM)
        self._covariance = node.advertise(topics.NAV_COVARIANCE)
        self._track = Track(node)
        self._level = node.advertise(topics.PROTECTION_LEVEL)
        self._integrity = node.scenario.integrity
        self._m_odom = empty_odometry(topics.NAV_ODOM)
        self._m_fix = Prepared(framed(topics.NAV_FIX, BASE))
        self._m_covariance = Prepared(topics.NAV_COVARIANCE.type())
        self._m_level = Prepared(topics.PROTECTION_LEVEL.type())
        self._transforms = Transforms(node)

    def publish(
        self,
        ns: int,
        state: FilterState,
        angular_rate: Array,
        since: AidedSince | Passage | None = None,
        aligned: bool = True,
    ) -> None:
        """Publish a state, the angular rate (3,) FRD that the gyroscopes measured, and what there
        is to say of the time since the last fix. One that is not aligned promises nothing: it is
        no fix, and has no protection level, path or transforms."""
        self.reached = ns
        covariance = state.covariance
        latitude, longitude, height = state.position.tolist()
        # odometry first: a lock-step simulation goes on with it while the rest is made
        self._publish_odometry(ns, state, angular_rate)
        if aligned:
            promise = self._integrity
            of_position = covariance[:2, :2]
            level = protection_level(of_position, promise.risk, promise.correlation_time)
            write(self._m_level, ns, level[None])
            self._level.publish(self._m_level)
        fill_nav_covariance(self._m_covariance, ns, state.batch_prior, since)
        self._covariance.publish(self._m_covariance)
        status = NavSatStatus.STATUS_FIX if aligned else NavSatStatus.STATUS_NO_FIX
        fill_fix(self._m_fix, ns, latitude, longitude, height, covariance[:3, :3], status)
        self._fix.publish(self._m_fix)
        if not aligned:
            return
        pose = self._m_odom.numbers[POSE]
        self._transforms.publish(ns, pose)
        self._track.extend(ns, pose)

    def publish_odometry(self, ns: int, state: FilterState, angular_rate: Array) -> None:
        """Publish a state within a step on nav/odom and /tf only."""
        self._publish_odometry(ns, state, angular_rate)
        self._transforms.publish(ns, self._m_odom.numbers[POSE])

    def _publish_odometry(self, ns: int, state: FilterState, angular_rate: Array) -> None:
        self.newest = ns
        nav, turn_rate = np.concatenate(state.estimate), state.turn_rate(angular_rate)
        fill_odom(self._m_odom, ns, self._frame, nav, turn_rate, state.covariance)
        self._odom.publish(self._m_odom)
