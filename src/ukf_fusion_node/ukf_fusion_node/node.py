"""The navigator: an unscented filter that integrates the IMU and takes fixes of any age."""

from collections import deque
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import Imu, NavSatFix, PointCloud2

from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.frames import map_frame
from isogal_ros.messages.imu import read_imu
from isogal_ros.messages.stamps import from_seconds, to_ns
from isogal_ros.messages.whole_fix import read_whole_fix
from isogal_ros.nodes.base import GraphNode, NodeSettings
from isogal_ros.nodes.health import ERROR
from isogal_ros.nodes.spin import main_of
from ukf_fusion_node.aids import Aids
from ukf_fusion_node.corrections import Corrections
from ukf_fusion_node.fixes import FixQueue
from ukf_fusion_node.navigation import Navigation
from ukf_fusion_node.outputs import Outputs
from ukf_fusion_node.pose import placed
from ukf_fusion_node.settings import UkfFusionSettings
from ukf_fusion_node.watch import Leaps, LoneSamples, StuckError, Watch


class UkfFusionNode(GraphNode):
    """Advances with each IMU sample, or with each step that the samples of a fast IMU make, and
    publishes nav/* of its newest stamp after each and after each fix."""

    sections: ClassVar[Sequence[str]] = (
        "seed", "field", "fields", "route", "imu", "initial_error", "gravimeter", "map", "gravity",
        "height", "velocity", "gnss", "matcher", "fusion", "integrity", "truth",
    )  # fmt: skip
    settings_model: ClassVar[type[NodeSettings]] = UkfFusionSettings
    settings: UkfFusionSettings

    def setup(self) -> None:
        """Start the filter and make publishers and subscriptions."""
        self.samples = 0
        """IMU samples received, those that were dropped included."""
        self.answered = 0
        """Fixes that were applied or dropped."""
        self._navigation = Navigation(self)
        self._corrections = Corrections(self.health, self.get_logger(), self._navigation.unfit)
        self._leaps = Leaps(from_seconds(self.settings.max_gap))
        limits = self.settings.max_acceleration, self.settings.max_turn_rate
        noisy = np.array(self._navigation.model.noise) > 0.0
        self._watch, self._lone = Watch(*limits, self.monotonic, noisy), LoneSamples()
        self._aids = Aids(self, self._go_on)
        self._held: deque[Imu] = deque()
        """IMU samples that wait for other sensors."""
        self.outputs = Outputs(self)
        self._frame = map_frame(self.scenario)
        self.listen(topics.IMU, self._take_imu)
        self.listen(topics.FIX, self._take_fix)
        self.listen(topics.INITIAL_POSE, self._take_pose)
        whole = self.listen(topics.INFORMATION, self._take_whole)
        ahead = from_seconds(self.settings.max_gap)
        self._fixes = FixQueue(whole.get_publisher_count, ahead, self.monotonic)
        self.offer_reset(self._navigation.reset)
        self.watch("silent", lambda: self._watch.silent, ERROR)

    def _take_imu(self, message: Imu) -> None:
        self._held.append(message)
        self._go_on()

    def _go_on(self) -> None:
        """Take the IMU samples that need not wait for other sensors."""
        self._aids.apply(self._navigation.navigator, self._navigation.ns)
        while self._held and not self._aids.are_due(to_ns(self._held[0].header.stamp)):
            self.guard(topics.IMU, self._take_sample, self._held.popleft())

    def _take_sample(self, message: Imu) -> None:
        self.samples += 1
        ns = to_ns(message.header.stamp)
        force, rate = read_imu(message, self.settings.imu_frame)
        # before anything is concluded from it: an old sample says nothing of those of now
        self._navigation.require_later(ns)
        try:
            self._watch.take(force, rate)
        except StuckError as error:
            self._navigation.back(error.samples)
            raise
        untrue = self._lone.take(force, rate)
        if untrue and self._navigation.back(1):
            self.health.drop(topics.IMU.name, untrue)
        if self._navigation.navigator is None:
            if self._navigation.begin(ns):
                self._publish()
            if self._navigation.navigator is None:
                self.health.tick(ns)
                return
        else:
            self._leaps.check(ns, self._navigation.ns)
        for _ in self._navigation.sample(ns, force, rate):
            self._aids.apply(self._navigation.navigator, self._navigation.ns)
            self._publish()
            if self._fixes:
                self._settle()
            self._navigation.keep()
        self.health.concern("stuck", self._watch.stuck)
        self.health.concern("gap", self._navigation.unresolved)
        self.health.tick(ns)

    def _take_pose(self, message: PoseWithCovarianceStamped) -> None:
        start = self._navigation.start_state()
        speed = float(np.hypot(*start.velocity[:2]))
        self._navigation.place(placed(start, message, self._frame, speed))
        if self._navigation.navigator is not None:
            self._publish()

    def _take_whole(self, message: PointCloud2) -> None:
        self._fixes.add_whole(to_ns(message.header.stamp), read_whole_fix(message))
        self._settle()

    def _take_fix(self, message: NavSatFix) -> None:
        try:
            self._fixes.add_position(to_ns(message.header.stamp), message)
        except BadMessageError:
            self._answer()
            raise
        self._settle()

    def _settle(self) -> None:
        """Apply the fixes that need not wait, and answer each, even one that is dropped."""
        for ns, content in self._fixes.due(self._navigation.ns):
            self.guard(topics.FIX, self._corrections.apply, self._navigation.navigator, content)
            self._navigation.matched(ns)
            self._answer()

    def _answer(self) -> None:
        """Publish nav/* after a fix: a lock-step simulation waits for that."""
        self.answered += 1
        if self._navigation.navigator is not None:
            self._publish()
            self._navigation.keep()  # the fix does not come again

    def _publish(self) -> None:
        self.outputs.publish(*self._navigation.latest(), self._navigation.aided)


main = main_of(UkfFusionNode, topics.UKF_FUSION)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
