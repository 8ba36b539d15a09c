"""What the simulated vehicle publishes at a step."""

import math
import time

from rclpy.serialization import deserialize_message

from ins_sim_node.simulation import Simulation
from isogal_ros import topics
from isogal_ros.messages.convert import BASE, MAP, fill_fix, fill_imu, fill_odom, map_frame
from isogal_ros.messages.stamps import set_stamp
from isogal_ros.nodes.base import GraphNode

COMPARE_EVERY = 0.1
"""s of wall time between looks at the navigator's error."""


class Outputs:
    """Publishers and messages; the messages are made once and overwritten."""

    def __init__(self, node: GraphNode, simulation: Simulation) -> None:
        self.simulation = simulation
        self.error = math.nan
        """m, horizontal, of the navigator when it was last looked at."""
        self._compared = 0.0
        self._frame = map_frame(node.scenario)
        self._clock, self._imu = node.advertise(topics.CLOCK), node.advertise(topics.IMU)
        self._truth_fix, self._truth_odom = (
            node.advertise(topics.TRUTH_FIX),
            node.advertise(topics.TRUTH_ODOM),
        )
        self._ins_fix = node.advertise(topics.INS_FIX)
        self._m_clock, self._m_imu = topics.CLOCK.type(), topics.IMU.type()
        self._m_truth, self._m_ins = topics.TRUTH_FIX.type(), topics.INS_FIX.type()
        self._m_odom = topics.TRUTH_ODOM.type(child_frame_id=BASE)
        self._m_odom.header.frame_id = MAP
        for message in (self._m_imu, self._m_truth, self._m_ins):
            message.header.frame_id = BASE
        self._m_imu.orientation_covariance[0] = -1.0  # no orientation

    def publish(self, k: int, ns: int) -> None:
        """Publish step k: the clock, then the IMU, so that the filter works while the rest is
        made. The start (k = 0) has no sample."""
        run = self.simulation
        set_stamp(self._m_clock.clock, ns)
        self._clock.publish(self._m_clock)
        if k > 0:
            fill_imu(
                self._m_imu, ns, run.imu.specific_force[0, k - 1], run.imu.angular_rate[0, k - 1]
            )
            self._imu.publish(self._m_imu)
        latitude, longitude, height = run.states[k, :3].tolist()
        fill_fix(self._m_truth, ns, latitude, longitude, height)
        fill_fix(self._m_ins, ns, run.unaided[k, 0], run.unaided[k, 1], height)
        fill_odom(self._m_odom, ns, self._frame, run.states[k], run.turn_rate[k])
        self._truth_odom.publish(self._m_odom)
        self._ins_fix.publish(self._m_ins)
        self._truth_fix.publish(self._m_truth)

    def compare(self, odometry: bytes) -> None:
        """Bring `error` up to date, the distance of a serialised nav/odom from the truth last
        published.

        It is only for display: not worth decoding every message of a fast run.
        """
        if (now := time.monotonic()) - self._compared < COMPARE_EVERY:
            return
        self._compared = now
        point, truth = (
            deserialize_message(odometry, topics.NAV_ODOM.type).pose.pose.position,
            self._m_odom.pose.pose.position,
        )
        self.error = math.hypot(point.x - truth.x, point.y - truth.y)
