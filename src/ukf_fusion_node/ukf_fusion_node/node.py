"""The navigator: an unscented filter that integrates the IMU and takes fixes of any age."""

from collections import deque
from collections.abc import Sequence
from typing import ClassVar

from geometry_msgs.msg import PoseWithCovarianceStamped

from isogal.arrays import Array
from isogal.fusion.inertial_navigator import InertialNavigator
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.imu import read_imu, require_noise
from isogal_ros.messages.ins_solution import inertial_topics
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.messages.stamps import to_ns
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.settings import NodeSettings
from isogal_ros.nodes.spin import main_of
from ukf_fusion_node.aids import Aids
from ukf_fusion_node.fixes import Fixes
from ukf_fusion_node.navigation import Navigation
from ukf_fusion_node.outputs import Outputs, Smoothed
from ukf_fusion_node.settings import UkfFusionSettings
from ukf_fusion_node.solution import Solutions


class UkfFusionNode(GraphNode[UkfFusionSettings]):
    """Advances with each IMU sample, or with each step that the samples of a fast IMU make, and
    publishes nav/* of its newest stamp after each and after each fix; within such a step nav/odom
    alone. What would change the state of a step already left behind so waits for the next."""

    sections: ClassVar[Sequence[str]] = (
        "seed", "field", "fields", "route", "imu", "ins", "initial_error", "gravimeter",
        "readings", "map", "gravity", "height", "velocity", "heights", "velocities", "gnss",
        "positions", "headings", "magnetometer", "matcher", "fusion", "integrity", "truth",
    )  # fmt: skip
    settings_model: ClassVar[type[NodeSettings]] = UkfFusionSettings

    def setup(self) -> None:
        """Start the filter and make publishers and subscriptions."""
        self.samples = 0
        """IMU samples received, those that were dropped included."""
        self.answered = 0
        """Fixes that were applied or dropped."""
        self._navigation = Navigation(self)
        self._aids = Aids(self, self._go_on)
        self._held: deque[tuple[int, topics.Message]] = deque()
        """Stamps (ns) and samples (serialised), or solutions, that wait for other sensors."""
        self.outputs, self._smoothed = Outputs(self), Smoothed(self)
        self._solutions: Solutions | None = None
        self._inertial = inertial_topics(self.scenario.ins)[-1]
        if self.scenario.ins.gives_solution:
            preintegrated = self._navigation.model.preintegrated
            self._solutions = Solutions(self, preintegrated, self._hold)
        else:
            self.listen(topics.IMU, lambda data: self._hold(peek_ns(data), data), raw=True)
        self.listen(topics.INITIAL_POSE, self._take_pose)
        self._fixes = Fixes(self, self._navigation, lambda: self._within, self._answer)
        self._pose: PoseWithCovarianceStamped | None = None
        """That waits for the end of a step, or until its stamp is reached."""
        self.offer_reset(self._reset)

    @property
    def navigator(self) -> InertialNavigator | None:
        """The filter with its history; None = it has not begun, or is being aligned."""
        return self._navigation.navigator if self._navigation.aligned else None

    def _reset(self) -> str:
        for part in (self._smoothed, self._aids, self._fixes):
            part.begin_anew()
        self._held.clear()
        self.outputs.newest, self._pose = -1, None
        return self._navigation.reset()

    def _hold(self, ns: int, message: topics.Message) -> None:
        self._held.append((ns, message))
        self._go_on()

    def _go_on(self) -> None:
        """Take the IMU samples that need not wait for other sensors."""
        self._aids.apply(self._navigation.navigator, self._navigation.ns)
        while self._held and not self._aids.are_due(self._held[0][0], self._held[-1][0]):
            self.guard(self._inertial, self._take_inertial, *self._held.popleft())

    def _take_inertial(self, ns: int, message: topics.Message) -> None:
        self.samples += 1
        if ns == 0 and self.samples > 1:  # the first of a recording may begin there
            raise BadMessageError("stamp is zero: not set")
        if self._solutions is not None:
            felt = self._solutions.samples(ns, message, self._navigation)
            if self._navigation.navigator is None:
                self._begins(ns, self._solutions.last)
                return
            for sample in felt:
                self._take_sample(*sample)
            return
        force, rate, declared = read_imu(message, self.settings.imu_frame)
        # before anything is concluded from it: an old sample says nothing of those of now
        self._navigation.require_later(ns)
        used = require_noise(declared) if self.scenario.imu.declared_noise else None
        self._take_sample(ns, force, rate, declared=used)

    def _begins(self, ns: int, solution: Array | None = None) -> bool:
        if self._navigation.begin(ns, solution):
            self._publish()
        if self._navigation.navigator is None:
            self._aids.pass_by(ns)
        self.health.stamp = ns
        return self._navigation.navigator is not None

    def _take_sample(
        self,
        ns: int,
        force: Array,
        rate: Array,
        interval: float | None = None,
        declared: Array | None = None,
    ) -> None:
        self._navigation.check(ns, force, rate, stepped=interval is not None)
        if self._navigation.navigator is None and not self._begins(ns):
            return
        for _ in self._navigation.sample(ns, force, rate, interval, declared):
            self._step()
        if (between := self._navigation.between()) is not None:
            self.outputs.publish_odometry(*between)
        self._navigation.tell_unresolved()
        self.health.stamp = ns

    def _step(self) -> None:
        """Publish what a step has led to, then use what has waited for its end."""
        self._aids.apply(self._navigation.navigator, self._navigation.ns)
        self._publish()
        self._fixes.settle()
        if self._pose is not None:
            pose, self._pose = self._pose, None
            self.guard(topics.INITIAL_POSE, self._take_pose, pose)
        self._smoothed.publish(self._navigation.ns, self.navigator)
        self._navigation.keep()

    @property
    def _within(self) -> bool:
        """Whether odometry has been published of a time after the newest step."""
        begun = self._navigation.navigator is not None
        return begun and self.outputs.newest > self._navigation.reached

    def _take_pose(self, message: PoseWithCovarianceStamped) -> None:
        ns = to_ns(message.header.stamp)
        if self._within or self._navigation.awaits(ns):
            self._pose = message
            return
        self._navigation.place(ns, message)
        if self._navigation.navigator is not None:
            self._publish()

    def _answer(self) -> None:
        """Publish nav/* after a fix: a lock-step simulation waits for that."""
        self.answered += 1
        if self._navigation.navigator is not None and not self._within:
            self._publish()
            self._navigation.keep()  # the fix does not come again

    def _publish(self) -> None:
        navigation = self._navigation
        ns, state, rate = navigation.latest()
        self.outputs.publish(ns, state, rate, navigation.passage, navigation.aligned)
        if self._solutions is not None:
            self._solutions.publish_error(ns, state)


main = main_of(UkfFusionNode, topics.UKF_FUSION)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
