"""When the next step may come: by the wall clock, or as fast as answers come."""

from collections.abc import Callable
from typing import Any

from rclpy.clock import Clock
from rclpy.node import Node


class Pace:
    """A timer on the wall clock whose rate may change.

    Parameters
    ----------
    node : Node
        Owns the timer.
    clock : Clock
        Steady.
    due : callable
        Called each time a step is due.
    """

    def __init__(self, node: Node, clock: Clock, due: Callable[[], None]) -> None:
        self._node, self._clock, self._due = node, clock, due
        self._timer: Any = None
        self._ended = False

    def set(self, steps_per_second: float) -> None:
        """Call `due` at a rate from now on; without a pause where the rate is infinite."""
        self.clear()
        self._timer = self._node.create_timer(1.0 / steps_per_second, self._due, clock=self._clock)

    def clear(self) -> None:
        """Stop calling `due`."""
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
            self._timer = None

    def end(self) -> bool:
        """Stop calling `due`; may be called from `due` itself. Return whether that is new."""
        first, self._ended = not self._ended, True
        if self._timer is not None:
            self._timer.cancel()
        return first
