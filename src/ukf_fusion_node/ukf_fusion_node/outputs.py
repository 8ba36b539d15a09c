"""Messages of the filter on nav/*."""

import numpy as np
from sensor_msgs.msg import NavSatStatus

from isogal.arrays import Array
from isogal.earth.frames import LocalFrame
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal.fusion.protection_level import protection_level
from isogal.fusion.state import FilterState
from isogal.passage import Since
from isogal_ros import topics
from isogal_ros.messages.frames import BASE, framed, map_frame
from isogal_ros.messages.odometry import POSE, empty_odometry, fill_odom
from isogal_ros.messages.position import fill_fix
from isogal_ros.messages.prepared import Prepared, write
from isogal_ros.messages.stamped_numbers import fill_nav_covariance
from isogal_ros.messages.stamps import among, to_seconds
from isogal_ros.nodes.base import GraphNode
from ukf_fusion_node.track import Track
from ukf_fusion_node.transforms import Transforms

SHARE = 0.1
"""Of the lag, from one pass back over it to the next: each step of the navigator then costs as
much as the filter of eleven."""


class Outputs:
    """Publishers and messages; the messages are made once and overwritten."""

    def __init__(self, node: GraphNode) -> None:
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
        since: Since | None = None,
        aligned: bool = True,
    ) -> None:
        """Publish a state.

        Parameters
        ----------
        ns : int
            Stamp.
        state : FilterState
        angular_rate : (3,) array
            As the gyroscopes measured it, FRD, rad/s.
        since : Aided or Passage, optional
            What there is to say of the time since the last fix.
        aligned : bool
            A state that is not promises nothing: it is no fix, and has no protection level, path
            or transforms.
        """
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
        _fill(self._m_odom, ns, self._frame, state, angular_rate)
        self._odom.publish(self._m_odom)


class Smoothed:
    """Publishes the states of the past on nav/smoothed, as all data up to `fusion.lag` later have
    them: each once, between one and 1 + `SHARE` lags after its stamp."""

    def __init__(self, node: GraphNode) -> None:
        self.lag = node.scenario.fusion.lag
        """s; 0 = nothing is published."""
        self._frame, self._reached = map_frame(node.scenario), -np.inf
        self._stamps: list[int] = []
        """Of the steps after that time, ns."""
        self._message = empty_odometry(topics.SMOOTHED)
        self._publisher = node.advertise(topics.SMOOTHED) if self.lag > 0.0 else None

    def publish(self, ns: int, navigator: InertialNavigator | None) -> None:
        """Publish the states that are a lag old, if it is time to look back; a step has ended at a
        stamp (ns)."""
        if self._publisher is None:
            return
        self._stamps.append(ns)
        if navigator is None:
            return
        until = navigator.time - self.lag
        if until < self._reached + SHARE * self.lag:
            return
        stamps, rates = navigator.samples(self._reached, until)
        each_ns = among(stamps.tolist(), self._stamps)
        self._stamps = [ns for ns in self._stamps if to_seconds(ns) > until]
        self._reached = until
        if not len(stamps):
            return
        states = navigator.smoothed(stamps)
        for stamp, rate, state in zip(each_ns, rates, states, strict=True):
            _fill(self._message, stamp, self._frame, state, rate)
            self._publisher.publish(self._message)

    def begin_anew(self) -> None:
        """Publish what comes after a reset, whatever its stamps are."""
        self._reached = -np.inf
        self._stamps.clear()


def _fill(
    message: Prepared, ns: int, frame: LocalFrame, state: FilterState, angular_rate: Array
) -> None:
    """Write a state and the angular rate (3,) FRD of the gyroscopes into an Odometry."""
    nav, turn_rate = np.concatenate(state.estimate), state.turn_rate(angular_rate)
    fill_odom(message, ns, frame, nav, turn_rate, state.covariance)
