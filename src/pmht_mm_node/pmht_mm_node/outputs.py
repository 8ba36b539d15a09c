"""What map matching publishes about a batch: candidates, and the fix with what belongs to it."""

import numpy as np
from sensor_msgs.msg import NavSatStatus

from isogal.arrays import Array
from isogal.matching.interfaces import Batch, Fix, Information
from isogal_ros import topics
from isogal_ros.messages.candidates import candidates_cloud
from isogal_ros.messages.frames import BASE
from isogal_ros.messages.position import NOT_MEASURED, fill_fix
from isogal_ros.messages.stamped_numbers import fill_information
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode


class Outputs:
    """Publishers and messages."""

    def __init__(self, node: GraphNode) -> None:
        self.fixes = 0
        """Messages on pmht_mm/fix published."""
        self._retrodict = node.scenario.matcher.mode == "retrodiction"
        self._candidates, self._fix = node.advertise(topics.CANDIDATES), node.advertise(topics.FIX)
        self._information = node.advertise(topics.INFORMATION)
        self._m_fix, self._m_information = topics.FIX.type(), topics.INFORMATION.type()
        self._m_fix.header.frame_id = BASE

    def publish(self, ns: int, batch: Batch, fix: Fix, height: float) -> None:
        """Publish what a batch has given; a fix's height is the navigator's (m)."""
        self._candidates.publish(candidates_cloud(ns, fix.candidates))
        each_scan = fix.published and self._retrodict and not fix.reset
        if each_scan and fix.scan_position is not None and fix.scan_covariance is not None:
            # a fix for each scan that no earlier batch has used; the last one is that of the batch
            # end
            for stamp, position, covariance in zip(
                batch.scan_time, fix.scan_position, fix.scan_covariance, strict=True
            ):
                if np.isfinite(covariance).all():
                    self._send(from_seconds(stamp), (*position, height), covariance)
        else:
            position = fix.latitude, fix.longitude, height
            self._send(
                ns, position, fix.covariance if fix.published else None, fix.information, fix.reset
            )

    def _send(
        self,
        ns: int,
        position: tuple[float, float, float],
        covariance: Array | None,
        information: Information | None = None,
        reset: bool = False,
    ) -> None:
        """Publish a fix, or that there is none, after what belongs to it."""
        code, full = NavSatStatus.STATUS_NO_FIX, None
        if covariance is not None:
            code, full = NavSatStatus.STATUS_FIX, np.diag([0.0, 0.0, NOT_MEASURED])
            full[:2, :2] = covariance
        fill_information(self._m_information, ns, reset, information)
        self._information.publish(self._m_information)
        fill_fix(self._m_fix, ns, *position, full, code)
        self._fix.publish(self._m_fix)
        self.fixes += 1
