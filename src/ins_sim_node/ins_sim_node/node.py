"""The simulated vehicle: clock, IMU, ground truth and the unaided INS, in lock-step with the graph
or at a wall-clock rate."""

import math
import sys
import time
from collections.abc import Sequence
from typing import Any, ClassVar

from rclpy.clock import Clock, ClockType

from ins_sim_node.lock_step import LockStep
from ins_sim_node.outputs import Outputs
from ins_sim_node.pace import Pace
from ins_sim_node.peers import Peers
from ins_sim_node.settings import InsSimSettings
from ins_sim_node.simulation import simulate
from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds, peek_ns, to_seconds
from isogal_ros.nodes.base import GraphNode, NodeSettings
from isogal_ros.nodes.health import OK
from isogal_ros.nodes.spin import run_node

UNLOCKED_START = 2.0
"""s of wall time that a simulation without lock-step leaves others to come up."""


class InsSimNode(GraphNode):
    """Publishes one step after the other; with lock_step the next one only when the graph has
    answered."""

    sections: ClassVar[Sequence[str]] = (
        "seed",
        "field",
        "route",
        "imu",
        "initial_error",
        "gravimeter",
        "matcher",
    )
    settings_model: ClassVar[type[NodeSettings]] = InsSimSettings
    mutable: ClassVar[Sequence[str]] = ("rate",)
    settings: InsSimSettings

    def setup(self) -> None:
        """Simulate the run and make publishers and subscriptions."""
        self.simulation = simulate(self.scenario, self.settings.run)
        self.rate = self.settings.rate
        self.step = -1
        """Index of the last step published; -1 = none, 0 = the start, which has no IMU sample."""
        self.begun = time.monotonic()
        """When the first step was published."""
        self._outputs = Outputs(self, self.simulation)
        self._peers = Peers(self, self.settings.peers)
        self._moved = self.begun
        self.lock_step = LockStep(self.scenario)
        if self.settings.lock_step:
            self._others_say = self.listen(topics.DIAGNOSTICS, self._peers.hear)
            self.listen(topics.NAV_ODOM, self._hear_nav, raw=True)
            self.listen(
                topics.FIX,
                lambda data: self._answered(self.lock_step.fix(peek_ns(data))),
                raw=True,
            )
            reading = topics.readings(self.scenario.measured_field)
            self.listen(
                reading,
                lambda data: self._answered(self.lock_step.reading(peek_ns(data))),
                raw=True,
            )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._pace = Pace(self, steady, self._paced)
        self.create_timer(0.05, self._watch, clock=steady)

    def changed(self, values: dict[str, Any]) -> None:
        """Take a new rate."""
        if "rate" in values:
            self.rate = float(values["rate"])
            if self.step >= 0:
                self._set_pace()

    def _watch(self) -> None:
        """Begin when all is ready; notice when the graph does not come up, or has stopped
        answering."""
        waited, settings = time.monotonic() - self._moved, self.settings
        if self.step >= 0:
            if (
                settings.lock_step
                and not self.finished
                and waited > settings.reply_timeout
                and not self.lock_step.complete
            ):
                at = f"{to_seconds(self.lock_step.ns):.3f} s"
                self.fail(
                    f"no answer to the step at {at} within {settings.reply_timeout:g} s:"
                    f" {self.lock_step.missing()}"
                )
        elif (
            (self.ready and not self._peers.missing)
            if settings.lock_step
            else (self.ready or waited > UNLOCKED_START)
        ):
            self._begin()
        elif waited > settings.start_timeout:
            reasons = [f"{name} is not ready" for name in sorted(self._peers.missing)]
            reasons += [f"listeners of {text}" for text in self.missing_listeners()]
            self.fail(f"cannot begin after {settings.start_timeout:g} s: {'; '.join(reasons)}")

    def _begin(self) -> None:
        self.begun = self._moved = time.monotonic()
        if self.settings.lock_step:
            self.destroy_subscription(self._others_say)
        self._advance()
        self._set_pace()

    def _hear_nav(self, data: bytes) -> None:
        ns = peek_ns(data)
        if ns == self.lock_step.ns:
            self._outputs.compare(data)
        self._answered(self.lock_step.nav(ns))

    def _answered(self, complete: bool) -> None:
        if complete and self.rate == 0.0:
            self._advance()

    def _set_pace(self) -> None:
        """Go by the wall clock, or as fast as answers come; without lock-step there are no answers
        to go by."""
        if self.rate > 0.0:
            self._pace.set(self.rate * self.scenario.imu.rate)
        elif not self.settings.lock_step:
            self._pace.set(math.inf)
        else:
            self._pace.clear()
            self._paced()

    def _paced(self) -> None:
        if not self.settings.lock_step or self.lock_step.complete:
            self._advance()

    def _advance(self) -> None:
        """Publish the next step, or end."""
        if self.finished:
            return
        if self.step >= len(self.simulation):
            self.health.state(OK, "finished")
            self._pace.end()
            self.finished = self.settings.exit_at_end
            return
        self.step += 1
        self._moved = time.monotonic()
        ns = from_seconds(self.simulation.trajectory.time[self.step])
        self.lock_step.begin(self.step, ns)
        self._outputs.publish(self.step, ns)
        elapsed = self._moved - self.begun
        self.health.figures |= {
            "simulated": to_seconds(ns),
            "duration": float(self.simulation.trajectory.time[-1]),
            "speed": to_seconds(ns) / elapsed if elapsed > 0.0 else 0.0,
            "position error": self._outputs.error,
        }
        self.health.state(OK, "running")
        self.health.tick(ns)


def main(args: Sequence[str] | None = None) -> None:
    """Entry point of the console script."""
    sys.exit(run_node(topics.INS_SIM, lambda: InsSimNode(topics.INS_SIM), args))


if __name__ == "__main__":
    main()
