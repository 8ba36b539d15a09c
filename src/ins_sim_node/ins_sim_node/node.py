"""The simulated vehicle: clock, IMU, ground truth and the unaided INS, in lock-step with the graph or at a wall-clock rate."""

import math
import sys
import time
from collections.abc import Sequence
from typing import Any, ClassVar

from diagnostic_msgs.msg import DiagnosticArray
from pydantic import Field
from rclpy.clock import Clock, ClockType
from rclpy.serialization import deserialize_message

from ins_sim_node.lock_step import LockStep
from ins_sim_node.simulation import simulate
from isogal_ros import topics
from isogal_ros.convert import BASE, MAP, fill_fix, fill_imu, fill_odom, map_frame
from isogal_ros.health import OK, figures_of
from isogal_ros.node import GraphNode, NodeSettings
from isogal_ros.spin import run_node
from isogal_ros.stamps import from_seconds, peek_ns, set_stamp, to_seconds

COMPARE_EVERY = 0.1
"""s of wall time between looks at the navigator's error."""


class InsSimSettings(NodeSettings):
    """Own parameters of ins_sim_node."""

    rate: float = Field(
        1.0, ge=0.0, le=10000.0, description="simulated seconds per second of wall time; 0 = as fast as the graph can"
    )
    lock_step: bool = Field(
        True, description="wait at each step until the graph has answered it, so that nothing is ever lost"
    )
    start_timeout: float = Field(
        300.0, gt=0.0, description="s of wall time to wait for the other nodes before the first step"
    )
    reply_timeout: float = Field(120.0, gt=0.0, description="s of wall time to wait for the answers to a step")
    exit_at_end: bool = Field(True, description="end the process after the last step")


class InsSimNode(GraphNode):
    """Publishes one step after the other; with lock_step the next one only when the graph has answered."""

    sections: ClassVar[Sequence[str]] = ("seed", "route", "imu", "initial_error", "gravimeter", "matcher")
    settings_model: ClassVar[type[NodeSettings]] = InsSimSettings
    mutable: ClassVar[Sequence[str]] = ("rate",)
    settings: InsSimSettings

    def setup(self) -> None:
        """Simulate the run and make publishers and subscriptions."""
        self.simulation = simulate(self.scenario, self.settings.run)
        self.frame = map_frame(self.scenario)
        self.rate = self.settings.rate
        self.step = -1
        """Index of the last step published; -1 = none, 0 = the start, which has no IMU sample."""
        self.position_error = float("nan")
        """m, of the navigator, as of the last diagnostics."""
        self._clock_out = self.advertise(topics.CLOCK)
        self._imu = self.advertise(topics.IMU)
        self._truth_fix, self._truth_odom = self.advertise(topics.TRUTH_FIX), self.advertise(topics.TRUTH_ODOM)
        self._ins_fix = self.advertise(topics.INS_FIX)
        self._compared = 0.0
        self._others: set[str] = set()
        self.begun = time.monotonic()
        self._moved = self.begun
        self._messages()
        if self.settings.lock_step:
            self.lock_step = LockStep(self.scenario)
            self._others_say = self.listen(topics.DIAGNOSTICS, self._hear_others)
            self.listen(topics.NAV_ODOM, self._hear_nav, raw=True)
            self.listen(topics.FIX, lambda data: self._answered(self.lock_step.fix(peek_ns(data))), raw=True)
            reading = topics.readings(self.scenario.gravimeter.quantity)
            self.listen(reading, lambda data: self._answered(self.lock_step.reading(peek_ns(data))), raw=True)
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._pace: Any = None
        self.create_timer(0.05, self._watch, clock=self._steady)

    def changed(self, values: dict[str, Any]) -> None:
        """Take a new rate."""
        if "rate" in values:
            self.rate = float(values["rate"])
            if self.step >= 0:
                self._set_pace()

    def _messages(self) -> None:
        """Make the messages once; each step overwrites them."""
        self._m_clock = topics.CLOCK.type()
        self._m_imu, self._m_truth, self._m_ins = topics.IMU.type(), topics.TRUTH_FIX.type(), topics.INS_FIX.type()
        self._m_odom = topics.TRUTH_ODOM.type(child_frame_id=BASE)
        self._m_odom.header.frame_id = MAP
        for message in (self._m_imu, self._m_truth, self._m_ins):
            message.header.frame_id = BASE
        for message in (self._m_truth, self._m_ins):
            message.status.service = 0
        self._m_imu.orientation_covariance[0] = -1.0  # no orientation

    def _hear_others(self, array: DiagnosticArray) -> None:
        if self.step >= 0:
            return
        space = self.get_namespace().strip("/")
        for item in array.status:
            node_space, _, name = item.name.rpartition("/")
            if node_space == space and name in self.settings.peers and figures_of(item).get("ready") == "True":
                self._others.add(name)

    def _watch(self) -> None:
        """Begin when all is ready; notice when the graph has stopped answering."""
        waited = time.monotonic() - self._moved
        if self.step < 0:
            missing = (
                [name for name in self.settings.peers if name not in self._others and name != self.get_name()]
                if self.settings.lock_step
                else []
            )
            if self.ready and not missing:
                self.begun = self._moved = time.monotonic()
                if self.settings.lock_step:
                    self.destroy_subscription(self._others_say)
                self._set_pace()
                self._advance()
            elif not self.settings.lock_step and waited > 2.0:
                self.begun = time.monotonic()
                self._set_pace()
                self._advance()
            elif waited > self.settings.start_timeout:
                reasons = [f"{name} is not ready" for name in missing] + [
                    f"listeners of {text}" for text in self.missing_listeners()
                ]
                self.fail(f"cannot begin after {self.settings.start_timeout:g} s: {'; '.join(reasons)}")
        elif (
            self.settings.lock_step
            and not self.finished
            and waited > self.settings.reply_timeout
            and not self.lock_step.complete
        ):
            self.fail(
                f"no answer to the step at {self._seconds():.3f} s within {self.settings.reply_timeout:g} s: {self.lock_step.missing()}"
            )

    def _seconds(self) -> float:
        return float(self.simulation.trajectory.time[max(self.step, 0)])

    def _hear_nav(self, data: bytes) -> None:
        ns = peek_ns(data)
        # only for display: not worth decoding every message of a fast run
        if ns == self.lock_step.ns and (now := time.monotonic()) - self._compared > COMPARE_EVERY:
            self._compared = now
            point = deserialize_message(data, topics.NAV_ODOM.type).pose.pose.position
            truth = self._m_odom.pose.pose.position
            self.position_error = math.hypot(point.x - truth.x, point.y - truth.y)
        self._answered(self.lock_step.nav(ns))

    def _answered(self, complete: bool) -> None:
        if complete and self.rate == 0.0 and not self.finished:
            self._advance()

    def _set_pace(self) -> None:
        if self._pace is not None:
            self.destroy_timer(self._pace)
            self._pace = None
        if self.rate > 0.0:
            self._pace = self.create_timer(1.0 / (self.rate * self.scenario.imu.rate), self._paced, clock=self._steady)
        elif not self.settings.lock_step:
            self._pace = self.create_timer(0.0, self._paced, clock=self._steady)
        elif self.step >= 0 and self.lock_step.complete:
            self._advance()

    def _paced(self) -> None:
        if not self.finished and (not self.settings.lock_step or self.lock_step.complete):
            self._advance()

    def _advance(self) -> None:
        """Publish the next step, or end."""
        if self.step >= len(self.simulation):
            self._end()
            return
        self.step += 1
        self._moved = time.monotonic()
        k, run, truth = self.step, self.simulation, self.simulation.trajectory
        ns = from_seconds(truth.time[k])
        if self.settings.lock_step:
            self.lock_step.begin(k, ns)
        set_stamp(self._m_clock.clock, ns)
        fill_fix(self._m_truth, ns, *run.states[k, :3].tolist())
        fill_odom(self._m_odom, ns, self.frame, run.states[k], run.turn_rate[k])
        fill_fix(self._m_ins, ns, run.unaided[k, 0], run.unaided[k, 1], truth.height[k])
        self._clock_out.publish(self._m_clock)
        self._truth_odom.publish(self._m_odom)
        self._ins_fix.publish(self._m_ins)
        self._truth_fix.publish(self._m_truth)
        if k > 0:
            fill_imu(self._m_imu, ns, run.imu.specific_force[0, k - 1], run.imu.angular_rate[0, k - 1])
            self._imu.publish(self._m_imu)
        self._report(ns)
        if k == 0 and self.rate == 0.0 and self.settings.lock_step:
            self._advance()  # nobody answers the start

    def _report(self, ns: int) -> None:
        elapsed = time.monotonic() - self.begun
        self.health.figures |= {
            "simulated": to_seconds(ns),
            "duration": float(self.simulation.trajectory.time[-1]),
            "speed": to_seconds(ns) / elapsed if elapsed > 0.0 else 0.0,
            "position error": self.position_error,
        }
        if self.step == 0:
            self.health.state(OK, "running")
        self.health.tick(ns)

    def _end(self) -> None:
        self.health.state(OK, "finished")
        if self._pace is not None:
            self._pace.cancel()
        self.finished = self.settings.exit_at_end


def main(args: Sequence[str] | None = None) -> None:
    """Entry point of the console script."""
    sys.exit(run_node(topics.INS_SIM, lambda: InsSimNode(topics.INS_SIM)))


if __name__ == "__main__":
    main()
