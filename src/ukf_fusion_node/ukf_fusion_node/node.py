"""The navigator: an unscented filter that integrates the IMU and takes fixes of any age."""

import sys
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from isogal.fusion.buffered import BufferedNavigator
from isogal.fusion.model import FilterModel
from isogal.fusion.navigator import FilterDivergenceError
from isogal.fusion.state import FilterState
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.imu import read_imu
from isogal_ros.messages.stamps import from_seconds, to_ns, to_seconds
from isogal_ros.messages.whole_fix import read_whole_fix
from isogal_ros.nodes.base import GraphNode, NodeSettings
from isogal_ros.nodes.health import ERROR, OK, WARN
from isogal_ros.nodes.spin import run_node
from ukf_fusion_node.corrections import Corrections
from ukf_fusion_node.fixes import FixQueue
from ukf_fusion_node.outputs import Outputs
from ukf_fusion_node.settings import UkfFusionSettings
from ukf_fusion_node.start import initial_state


class UkfFusionNode(GraphNode):
    """Advances with each IMU sample, and publishes nav/* of its newest stamp after each sample and
    each fix."""

    sections: ClassVar[Sequence[str]] = (
        "seed", "route", "imu", "initial_error", "fusion", "truth",
    )  # fmt: skip
    settings_model: ClassVar[type[NodeSettings]] = UkfFusionSettings
    settings: UkfFusionSettings

    def setup(self) -> None:
        """Start the filter and make publishers and subscriptions."""
        self.samples = 0
        """IMU samples received, those that were dropped included."""
        self.answered = 0
        """Fixes that were applied or dropped."""
        self._gaps = 0
        self._corrections = Corrections(self.health)
        self._start = initial_state(self.scenario, self.settings)
        self._model = FilterModel.from_scenario(self.scenario)
        self._navigator: BufferedNavigator | None = None
        self._ns = -1
        self._rate = np.zeros(3)
        self._warm_up()
        self._outputs = Outputs(self)
        self.listen(topics.IMU, self._take_imu)
        self.listen(topics.FIX, self._take_fix)
        whole = self.listen(topics.INFORMATION, self._take_whole)
        ahead = from_seconds(self.settings.max_gap)
        self._fixes = FixQueue(whole.get_publisher_count, ahead)

    def _warm_up(self) -> None:
        """Compile, or load, the filter's kernels before the first sample comes."""
        navigator = BufferedNavigator(self._model, FilterState.start(self._start, self._model))
        latitude, longitude, height = self._start.position[0].tolist()
        navigator.propagate(self._model.dt, np.array([0.0, 0.0, -9.8]), np.zeros(3), height)
        navigator.update_position(self._model.dt, latitude, longitude, np.eye(2) * 1e6)

    def _take_imu(self, message: Any) -> None:
        self.samples += 1
        ns = to_ns(message.header.stamp)
        force, rate = read_imu(message, self.settings.imu_frame)
        if self._navigator is None:
            # the first sample's interval begins where the start is known
            self._ns = ns - from_seconds(self._model.dt)
            state = FilterState.start(self._start, self._model)
            self._navigator = BufferedNavigator(
                self._model, state, to_seconds(self._ns), self.settings.horizon
            )
            self._publish()
        elif ns <= self._ns:
            raise BadMessageError(
                f"stamp {to_seconds(ns):.3f} s is not later than {to_seconds(self._ns):.3f} s"
            )
        else:
            self._note_gap(to_seconds(ns - self._ns))
        try:
            self._navigator.propagate(to_seconds(ns), force, rate, self.scenario.route.height)
        except FilterDivergenceError as error:
            self.health.state(ERROR, str(error))
            raise BadMessageError(str(error)) from None
        self._ns, self._rate = ns, rate
        self._publish()
        if self._fixes:
            self._settle()
        self.health.tick(ns)

    def _note_gap(self, interval: float) -> None:
        missing = round(interval / self._model.dt) - 1
        if missing < 1:
            self.health.state(OK, "navigating")
            return
        self._gaps += missing
        self.health.figures["IMU samples missing"] = self._gaps
        end = to_seconds(self._ns) + interval
        level = ERROR if interval > self.settings.max_gap else WARN
        self.health.state(
            level, f"{missing} IMU samples missing before {end:.3f} s, bridged with the next one"
        )

    def _take_whole(self, message: Any) -> None:
        self._fixes.add_whole(to_ns(message.header.stamp), read_whole_fix(message))
        self._settle()

    def _take_fix(self, message: Any) -> None:
        try:
            self._fixes.add_position(to_ns(message.header.stamp), message)
        except BadMessageError:
            self._answer()
            raise
        self._settle()

    def _settle(self) -> None:
        """Apply the fixes that need not wait, and answer each, even one that is dropped."""
        for _, content in self._fixes.due(self._ns):
            try:
                self._corrections.apply(self._navigator, content)
            except BadMessageError as error:
                self.health.drop(topics.FIX.name, str(error))
            except Exception as error:
                self.health.drop(topics.FIX.name, f"{type(error).__name__}: {error}")
                self.get_logger().error(f"{topics.FIX.name}: {type(error).__name__}: {error}")
            self._answer()

    def _answer(self) -> None:
        """Publish nav/* after a fix: a lock-step simulation waits for that."""
        self.answered += 1
        if self._navigator is not None:
            self._publish()

    def _publish(self) -> None:
        assert self._navigator is not None
        self._outputs.publish(self._ns, self._navigator.state, self._rate)


def main(args: Sequence[str] | None = None) -> None:
    """Entry point of the console script."""
    sys.exit(run_node(topics.UKF_FUSION, lambda: UkfFusionNode(topics.UKF_FUSION), args))


if __name__ == "__main__":
    main()
