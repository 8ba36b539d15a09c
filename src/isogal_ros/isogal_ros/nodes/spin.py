"""Running nodes: one node per process for `ros2 run` and launch files, or several in one
process."""

import signal
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from isogal.errors import InputError

INTERRUPTED = 130
"""Exit code of a process that was interrupted before it had begun."""


def make_executor(context: Context | None = None) -> Any:
    """Return the events executor, which is three to five times as fast, or the plain one where
    rclpy has none.

    The events executor's ``spin()`` neither dispatches nor ends on SIGINT in some builds;
    ``spin_once`` in a loop does both."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


class Interrupt:
    """True once SIGINT or SIGTERM came."""

    def __init__(self) -> None:
        self.count = 0

    def __bool__(self) -> bool:
        return self.count > 0

    def __call__(self, _number: int, _frame: Any = None) -> None:
        """Handle a signal."""
        self.count += 1


@contextmanager
def interrupts() -> Iterator[Interrupt]:
    """Note SIGINT and SIGTERM instead of ending at once, so that what was published arrives before
    the process ends."""
    interrupt = Interrupt()
    old = {number: signal.signal(number, interrupt) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interrupt
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


def drain(node: Any, executor: Any, quiet: float = 0.3, limit: float = 10.0) -> None:
    """Let a node that counts its messages (`GraphNode.received`) take those that are under way,
    until none has come for `quiet` s, for at most `limit` s."""
    if node.received() is None:
        return
    count, changed = node.received(), time.monotonic()
    begun = changed
    while (now := time.monotonic()) - changed < quiet and now - begun < limit:
        executor.spin_once(timeout_sec=0.05)
        if node.received() != count:
            count, changed = node.received(), time.monotonic()


def run_node(name: str, make: Callable[[], Any], args: Sequence[str] | None = None) -> int:
    """Run one node until it is finished or interrupted; return the exit code of its process.

    Parameters
    ----------
    name : str
        Put before the line that a bad parameter ends the process with.
    make : callable
        Returns the node, a `GraphNode`.
    args : sequence of str, optional
        ROS arguments (``--ros-args ...``); None = those of the command line.
    """
    rclpy.init(
        args=None if args is None else list(args), signal_handler_options=SignalHandlerOptions.NO
    )
    try:
        # while the node is being made there is nothing to end in good order: signals end it at
        # once
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        node = make()
        with interrupts() as interrupt:
            executor = make_executor()
            executor.add_node(node)
            with suppress(ExternalShutdownException):
                while not (interrupt or node.finished) and rclpy.ok():
                    executor.spin_once(timeout_sec=0.2)
            drain(node, executor)
            executor.remove_node(node)
            node.close()
            return int(node.exit_code)
    except InputError as error:
        print(f"{name}: {str(error).removeprefix(f'{name}: ')}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return INTERRUPTED
    finally:
        rclpy.try_shutdown()
