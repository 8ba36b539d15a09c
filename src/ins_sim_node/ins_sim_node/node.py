"""The simulated vehicle: clock, IMU, ground truth and the unaided INS, in lock-step with the graph
or at a wall-clock rate."""

import math
import time
from collections.abc import Sequence
from typing import Any, ClassVar

from rclpy.clock import Clock, ClockType

from ins_sim_node.answers import Answers
from ins_sim_node.lock_step import LockStep
from ins_sim_node.outputs import Outputs
from ins_sim_node.pace import Pace
from ins_sim_node.peers import Peers
from ins_sim_node.settings import InsSimSettings
from ins_sim_node.start import Start
from ins_sim_node.successors import Successors, Survival
from isogal.fields.simulated_vehicle import simulate_vehicle
from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode, NodeSettings
from isogal_ros.nodes.health import OK
from isogal_ros.nodes.spin import main_of


class InsSimNode(GraphNode):
    """Publishes one step after the other; with lock_step the next one only when the graph has
    answered."""

    sections: ClassVar[Sequence[str]] = (
        "seed", "field", "fields", "route", "imu", "initial_error", "gravimeter", "magnetometer",
        "altimeter", "map", "map_error", "gravity", "height", "velocity", "matcher", "fusion",
        "truth",
    )  # fmt: skip
    settings_model: ClassVar[type[NodeSettings]] = InsSimSettings
    mutable: ClassVar[Sequence[str]] = ("rate",)
    settings: InsSimSettings

    def setup(self) -> None:
        """Simulate the run and make publishers and subscriptions."""
        self.vehicle = simulate_vehicle(self.scenario, self.settings.run)
        self.rate = self.settings.rate
        self._survival = Survival(self)
        self.step = self._survival.step
        """Index of the last step published; -1 = none, 0 = the start, which has no IMU sample."""
        self.running = False
        self.begun = self._moved = time.monotonic()
        """When the first step was published; when the last one was."""
        self._outputs = Outputs(self, self.vehicle)
        peers = Peers(self, self.settings.peers)
        self._start = Start(self, peers)
        self._answers: LockStep | None = None
        self._successors: Successors | None = None
        if self.settings.lock_step:
            self._diagnostics = self.listen(topics.DIAGNOSTICS, peers.hear)
            answers = Answers(self, self._outputs, self.resume)
            self._answers = answers.lock_step
            self._successors = Successors(self, answers)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._pace = Pace(self, steady, self._paced)
        self.create_timer(0.05, self._watch, clock=steady)

    def changed(self, values: dict[str, Any]) -> None:
        """Take a new rate."""
        self.rate = float(values.get("rate", self.rate))
        if self.running:
            self._set_pace()

    def on_activate(self, state: Any) -> Any:
        """Go on; waiting begins anew."""
        self._moved = time.monotonic()
        return super().on_activate(state)

    def close(self, timeout: float = 1.0) -> None:
        """Forget the checkpoint only now: a successor must not begin the route again."""
        super().close(timeout)
        if self.step >= len(self.vehicle):
            self._survival.forget()

    def _watch(self) -> None:
        """Begin when all is ready; fail where the graph does not come up or has stopped
        answering."""
        if not self.active:
            return
        waited = time.monotonic() - self._moved
        if not self.running:
            if self._start.may_begin(waited):
                self._begin()
        elif self._successors is not None and not self.finished:
            self._successors.watch(waited)

    def _begin(self) -> None:
        self.begun = self._moved = time.monotonic()
        self.get_logger().info(f"begun: {self.vehicle.trajectory.time[-1]:.0f} s to go")
        if self._successors is not None:
            self._diagnostics.end()
            self._successors.begin()
        self.running = True
        self.advance()
        self._set_pace()

    def resume(self) -> None:
        """Go on after a step that is answered, or not waited for any longer."""
        if self.rate == 0.0:
            self.advance()

    def _set_pace(self) -> None:
        """Go by the wall clock, or as fast as answers come; without lock-step there are no answers
        to go by."""
        if self.rate > 0.0:
            self._pace.set(self.rate * self.scenario.navigation_rate)
        elif self._answers is None:
            self._pace.set(math.inf)
        else:
            self._pace.clear()
            self._paced()

    def _paced(self) -> None:
        if self._answers is None or self._answers.complete:
            self.advance()

    def advance(self) -> None:
        """Publish the next step, or end."""
        if self.finished or not self.active:
            return
        if self.step >= len(self.vehicle):
            self.health.state(OK, "finished")
            if self._pace.end():
                self.get_logger().info(self._outputs.arrived(time.monotonic() - self.begun))
            self.finished = self.settings.exit_at_end
            return
        self.step += 1
        self._survival.keep(self.step)
        self._moved = time.monotonic()
        ns = from_seconds(self.vehicle.trajectory.time[self.step])
        if self._answers is not None:
            self._answers.begin(self.step, ns)
        self._outputs.publish(self.step, ns)
        self.health.figures |= self._outputs.progress(ns, self._moved - self.begun)
        self.health.state(OK, "running")
        self.health.tick(ns)


main = main_of(InsSimNode, topics.INS_SIM)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
