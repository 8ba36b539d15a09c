"""Running nodes: one node per process for `ros2 run` and launch files, or several in one
process."""

import gc
import os
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

import rclpy
from rclpy.context import Context
from rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from isogal.compiled import tell_of_compiling
from isogal.errors import InputError
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.middleware import leave_shared_memory, set_profiles
from isogal_ros.nodes.signals import INTERRUPTED, Interrupt, interrupts

USAGE = "parameters are --ros-args -p KEY:=VALUE or --params-file FILE"
"""What a node takes on its command line."""
COMPILING = (
    "functions are being compiled for this machine, which takes up to a minute; later starts use"
    " what is kept"
)
"""What the first start says."""
REFUSED = 2
"""Exit code where the input cannot be used."""
DRAIN = 10.0
"""s that a node which has nothing left to do may take what is under way."""
QUIET = 0.3
"""s without a message after which none is under way."""


def make_executor(context: Context | None = None) -> Executor:
    """Return the events executor, which is three to five times as fast, or the plain one where
    rclpy has none.

    The events executor's ``spin()`` neither dispatches nor ends on SIGINT in some builds;
    `Spinning` does both. It holds what its nodes have until it is shut down: of nodes
    that are destroyed before, others see the publishers for as long as the executor is there."""
    try:
        from rclpy.experimental.events_executor import EventsExecutor
    except ImportError:
        return SingleThreadedExecutor(context=context)
    return EventsExecutor(context=context)


class Spinning:
    """Spins an executor until it is told to stop: `spin_once` comes back to Python after each
    message, which takes as long as all else of rclpy's part in taking it.

    To the executor it is the future that it waits for: one of rclpy has a lock, at which a signal
    handler would wait for what it has interrupted.

    Parameters
    ----------
    executor : Executor
    """

    def __init__(self, executor: Executor) -> None:
        self._executor, self._is_done = executor, False
        self._end: Callable[[object], None] = lambda _: None

    def done(self) -> bool:
        """Whether it was told to stop."""
        return self._is_done

    def add_done_callback(self, end: Callable[[object], None]) -> None:
        """Take what ends the call of `spin` that begins."""
        self._end = end
        if self._is_done:
            end(self)

    def remove_done_callback(self, _end: Callable[[object], None]) -> None:
        """Do nothing: `spin` forgets it."""

    def stop(self) -> None:
        """Let `spin` return."""
        self._is_done = True
        self._end(self)

    def spin(self, seconds: float) -> None:
        """Deal with what comes; return when told to, or once nothing waits after some time."""
        try:
            self._executor.spin_until_future_complete(self, timeout_sec=seconds)
        finally:
            self._end = lambda _: None


def drain(node: GraphNode, executor: Executor, limit: float) -> None:
    """Let a node that counts its messages (`GraphNode.received`) take those that are under way.

    Parameters
    ----------
    executor : Executor
        That the node is on.
    limit : float
        s that it lasts at most.
    """
    count, begun = node.received(), time.monotonic()
    changed = begun
    while (
        count is not None and (now := time.monotonic()) - changed < QUIET and now - begun < limit
    ):
        executor.spin_once(timeout_sec=0.05)
        if node.received() != count:
            count, changed = node.received(), now


def run_node(name: str, make: Callable[[], GraphNode], args: Sequence[str] | None = None) -> int:
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
    gc.freeze()  # what is imported is there to stay
    gc.enable()
    words = sys.argv[1:] if args is None else list(args)
    try:
        if unknown := remove_ros_args([name, *words])[1:]:
            return _refuse(name, f"unknown argument '{unknown[0]}'; {USAGE}")
        set_profiles()
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except rclpy_implementation.RCLError as error:
        why = str(error).partition(", at /")[0]  # where in the sources of rcl
        return _refuse(name, why.removeprefix("failed to initialize rcl: "))
    with interrupts() as interrupt:
        try:
            return _run(name, make, interrupt)
        except InputError as error:
            return _refuse(name, str(error))
        except KeyboardInterrupt:
            return INTERRUPTED
        finally:
            interrupt.ends_at_once = False
            rclpy.try_shutdown()


def _refuse(name: str, why: str) -> int:
    """Print in one line what is wrong with the input; return the exit code that says so."""
    print(f"{name}: {' '.join(why.split()).removeprefix(f'{name}: ')}", file=sys.stderr)
    return REFUSED


def main_of(kind: Callable[[str], GraphNode], name: str) -> Callable[..., None]:
    """Return the entry point of a console script that runs one node (see `run_node`)."""

    def main(args: Sequence[str] | None = None) -> None:
        made = []  # not to be destroyed before the process ends

        def make() -> GraphNode:
            made.append(kind(name))
            made[0].process_ends = True
            return made[0]

        code = run_node(name, make, args)
        if code == REFUSED:
            sys.exit(code)
        # all is written and said, and the middleware is not taken down (`GraphNode.destroy_node`)
        leave_shared_memory()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)

    return main


def _run(name: str, make: Callable[[], GraphNode], interrupt: Interrupt) -> int:
    # while the node is being made there is nothing to end in good order
    interrupt.ends_at_once = True
    tell_of_compiling(
        lambda: print(f"{name}: {COMPILING}", file=sys.stderr, flush=True)  # no node logs yet
    )
    node = make()
    interrupt.ends_at_once = False
    if interrupt:
        node.destroy_node()
        return INTERRUPTED
    executor = make_executor()
    executor.add_node(node)
    spinning = Spinning(executor)
    node.told, interrupt.told = spinning.stop, spinning.stop
    with suppress(ExternalShutdownException):
        while not (interrupt or node.finished) and rclpy.ok():
            spinning.spin(0.2)
    # the signal to end is followed by a harder one: half of the time for what is under way, half
    # for what was published
    patience = node.settings.closing_time
    limit = 0.5 * patience if interrupt else DRAIN
    drain(node, executor, limit)
    executor.shutdown()
    node.close(0.5 * patience)
    return int(node.exit_code)
