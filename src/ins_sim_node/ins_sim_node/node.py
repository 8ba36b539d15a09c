"""The simulated vehicle: clock, IMU, ground truth and the unaided INS, in lock-step with the graph
or at a wall-clock rate."""

import time
from collections.abc import Sequence
from typing import ClassVar

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.timer import Timer

from ins_sim_node.lock_step import LockStep
from ins_sim_node.outputs import Outputs
from ins_sim_node.settings import InsSimSettings
from isogal.fields.simulated_vehicle import simulate_vehicle
from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.checkpoint import Checkpoint
from isogal_ros.nodes.health import OK
from isogal_ros.nodes.settings import NodeSettings
from isogal_ros.nodes.spin import main_of
from isogal_ros.parameters.values import Values

UNLOCKED_START = 2.0
"""s of wall time that a simulation without lock-step leaves others to come up."""


class InsSimNode(GraphNode[InsSimSettings]):
    """Publishes one step after the other; with lock_step the next one only when the graph has
    answered, or with the last where no answer can change what the filter does with it."""

    sections: ClassVar[Sequence[str]] = (
        "seed", "field", "fields", "route", "imu", "ins", "initial_error", "gravimeter",
        "magnetometer", "altimeter", "readings", "map", "map_error", "gravity", "height",
        "velocity", "heights", "velocities", "gnss", "positions", "headings", "matcher", "fusion",
        "truth",
    )  # fmt: skip
    settings_model: ClassVar[type[NodeSettings]] = InsSimSettings
    mutable: ClassVar[Sequence[str]] = ("rate",)

    def setup(self) -> None:
        """Simulate the run and make publishers and subscriptions."""
        self.vehicle = simulate_vehicle(self.scenario, self.scenario.true, self.settings.run)
        self.rate = self.settings.rate
        self._checkpoint = Checkpoint(self)
        found = self._checkpoint.found
        # its own checkpoint is how far it is: all else it simulates anew
        self.step = -1 if found is None else int(found.content)
        """Index of the last step published; -1 = none, 0 = the start, which has no IMU sample."""
        if self.step >= 0:
            self.get_logger().info(f"goes on after step {self.step}")
        self.running = self._arrived = False
        self.begun = self._moved = time.monotonic()
        """When the first step was published; when the last one was."""
        self._outputs = Outputs(self, self.vehicle)
        self.lock_step: LockStep | None = None
        self._ahead = 1
        """Steps that may be published at once."""
        if self.settings.lock_step:
            self.lock_step = LockStep(self, self._outputs.compare, self._go_on)
            # the filter does not wait for another sensor's reading once later samples are there,
            # and a node that is killed loses what is under way
            aided = self.vehicle.aids or self.scenario.height.measured
            if not (aided or self._checkpoint.is_kept):
                self._ahead = max(1, self.settings.ahead // self.vehicle.samples.shape[1])
        self._steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer: Timer | None = None
        """Comes at each step that goes by the wall clock."""
        self.create_timer(0.05, self._watch, clock=self._steady)

    def changed(self, values: Values) -> None:
        """Take a new rate."""
        rate = values.get("rate")
        if isinstance(rate, float):
            self.rate = rate
        if self.running:
            self._set_pace()

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Go on; waiting begins anew."""
        self._moved = time.monotonic()
        return super().on_activate(state)

    def close(self, timeout: float = 1.0) -> None:
        """Forget the checkpoint only now: a successor must not begin the route again."""
        super().close(timeout)
        if self.step >= len(self.vehicle):
            self._checkpoint.forget()

    def _watch(self) -> None:
        """Begin when all is ready; fail where the graph does not come up or has stopped
        answering."""
        if not self.active:
            return
        waited = time.monotonic() - self._moved
        if self.running:
            if self.lock_step is not None and not self.finished:
                self.lock_step.watch(waited)
            return
        not_ready = self.lock_step.not_ready if self.lock_step is not None else ()
        if self.settings.lock_step:
            ready = self.ready and not not_ready
        else:
            ready = self.ready or waited > UNLOCKED_START
        if ready:
            self._begin()
        elif waited > self.settings.start_timeout:
            reasons = [f"{name} is not ready" for name in sorted(not_ready)]
            reasons += [f"listeners of {text}" for text in self.missing_listeners()]
            timeout = self.settings.start_timeout
            self.fail(f"cannot begin after {timeout:g} s: {'; '.join(reasons)}")

    def _begin(self) -> None:
        self.begun = self._moved = time.monotonic()
        self.get_logger().info(f"begun: {self.vehicle.trajectory.time[-1]:.0f} s to go")
        if self.lock_step is not None:
            self.lock_step.start()
        self.running = True
        self.advance()
        self._set_pace()

    def _go_on(self) -> None:
        """Go on after a step that is answered, or not waited for any longer."""
        if self.rate == 0.0:
            self.advance()

    def _set_pace(self) -> None:
        """Go by the wall clock, or as fast as answers come; without lock-step there are no answers
        to go by."""
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        if self.rate > 0.0 or self.lock_step is None:
            period = 1.0 / (self.rate * self.scenario.navigation_rate) if self.rate > 0.0 else 0.0
            self._timer = self.create_timer(period, self._due, clock=self._steady)
        else:
            self._due()

    def _due(self) -> None:
        if self.lock_step is None or self.lock_step.complete:
            self.advance()

    def advance(self) -> None:
        """Publish the next step or steps, or end."""
        if self.finished or not self.active:
            return
        if self.step >= len(self.vehicle):
            self._arrive()
            return
        first = self.step + 1
        steps = 1
        if self.lock_step is not None and self.rate == 0.0:
            steps = self.lock_step.without_reading(first, self._ahead)
        self.step = min(first + steps - 1, len(self.vehicle))
        self._checkpoint.save(0, self.step)  # before it is published: it is never published twice
        self._moved = time.monotonic()
        stamps = [from_seconds(t) for t in self.vehicle.trajectory.time[first : self.step + 1]]
        ns = stamps[-1]
        if self.lock_step is not None:
            self.lock_step.begin(self.step, ns)
        for step, stamp in enumerate(stamps, first):
            self._outputs.publish(step, stamp)
        self.health.figures |= self._outputs.progress(ns, self._moved - self.begun)
        self.health.state(OK, "running")
        self.health.stamp = ns

    def _arrive(self) -> None:
        self.health.state(OK, "finished")
        if self._timer is not None:
            self._timer.cancel()
        if not self._arrived:
            self._arrived = True
            self.get_logger().info(self._outputs.arrived(time.monotonic() - self.begun))
        self.finished = self.settings.exit_at_end


main = main_of(InsSimNode, topics.INS_SIM)
"""Entry point of the console script."""

if __name__ == "__main__":
    main()
