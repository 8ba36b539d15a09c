"""What map matching publishes about a batch: candidates, and the fix with what belongs to it."""

import numpy as np
from sensor_msgs.msg import NavSatStatus

from isogal.inertial.error_state import Estimate
from isogal.inertial.rotations import from_matrix
from isogal.matching.interfaces import Batch, Fix
from isogal_ros import topics
from isogal_ros.messages.fix_information import FixMessage, fill_fix_information
from isogal_ros.messages.frames import BASE, MAP, map_frame
from isogal_ros.messages.point import candidates_cloud
from isogal_ros.messages.position import NOT_MEASURED, fill_fix, fill_pose
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.nav_queue import NavSample


class Outputs:
    """Publishers and messages."""

    def __init__(self, node: GraphNode) -> None:
        self._retrodict = node.scenario.matcher.mode == "retrodiction"
        self._candidates, self._fix = node.advertise(topics.CANDIDATES), node.advertise(topics.FIX)
        self._information = node.advertise(topics.INFORMATION)
        self._m_fix, self._m_information = topics.FIX.type(), topics.INFORMATION.type()
        self._m_fix.header.frame_id = BASE
        self._pose, self._m_pose = node.advertise(topics.POSE), topics.POSE.type()
        self._m_pose.header.frame_id, self._frame = MAP, map_frame(node.scenario)

    def publish(self, ns: int, batch: Batch, fix: Fix, nav: NavSample) -> None:
        """Publish what a batch has given.

        Parameters
        ----------
        ns : int
            Stamp of its end.
        batch, fix : Batch, Fix
        nav : NavSample
            The navigator's estimate there.
        """
        self._candidates.publish(candidates_cloud(ns, fix.candidates))
        height = nav.position[2]
        if fix.published and self._retrodict and not fix.reset and fix.scan_position is not None:
            # a fix for each scan that no earlier batch has used; the last one is that of the batch
            # end
            for index, stamp in enumerate(batch.scan_time):
                share = fix.of_scan(index)
                if share is not None:
                    self._send(from_seconds(stamp), FixMessage(share), height)
        else:
            estimate = Estimate(nav.position, nav.velocity, from_matrix(nav.attitude))
            self._send(ns, FixMessage(fix, estimate), height)

    def _send(self, ns: int, message: FixMessage, height: float) -> None:
        """Publish all of a fix, or that there is none, then its position for all others."""
        code, full, fix = NavSatStatus.STATUS_NO_FIX, None, message.fix
        if fix.published:
            code, full = NavSatStatus.STATUS_FIX, np.diag([0.0, 0.0, NOT_MEASURED])
            full[:2, :2] = fix.covariance
        fill_fix_information(self._m_information, ns, message)
        self._information.publish(self._m_information)
        fill_fix(self._m_fix, ns, fix.latitude, fix.longitude, height, full, code)
        self._fix.publish(self._m_fix)
        if fix.published:
            place = fix.latitude, fix.longitude, height
            fill_pose(self._m_pose, ns, self._frame, place, fix.covariance)
            self._pose.publish(self._m_pose)
