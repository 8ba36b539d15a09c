"""The graph as processes: one per node and one for the recorder, started, watched and ended
together."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile

from isogal.files import make_folder
from isogal.threads import one_thread
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.domain import DOMAIN, defaults, graph_domain, local_context, names_of
from isogal_ros.graph.plan import CLASSES, GraphError, Outcome, Plan
from isogal_ros.graph.progress import Report, ReportTimer, progress_of
from isogal_ros.graph.shared_memory import shared_memory, sweep_shared_memory
from isogal_ros.nodes.base import PARENT
from isogal_ros.nodes.health import figures_of
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.nodes.spin import make_executor
from isogal_ros.parameters.values import parameter_file

PATIENCE = 15.0
"""s that a process gets to end after SIGINT, then after SIGTERM, before it is killed."""
RESPAWN_DELAY = 1.0
"""s after which a node that was killed is started again."""
MOST_RESTARTS = 100
"""Of one node in one run."""
LOG_LINES = 5
"""Last lines of a node's output that its end is described with."""


class Processes:
    """The processes of one graph, each with its output in a file.

    Parameters
    ----------
    plan : Plan
        Nodes and their parameters.
    folder : Path
        For the parameter file and the nodes' output.
    domain : int
        ROS domain.
    """

    def __init__(self, plan: Plan, folder: Path, domain: int) -> None:
        self.folder = folder
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        make_folder(folder)
        self.parameters = folder / "params.yaml"
        own = {name: plan.own(name) for name in plan.names}
        self.parameters.write_text(parameter_file(plan.scenario, own), encoding="utf-8")
        environment = os.environ | {DOMAIN: str(domain), PARENT: str(os.getpid())}
        environment |= defaults(environment)
        one_thread(environment)
        self._environment, self._respawns = environment, plan.checkpoint is not None
        self._again: dict[str, float] = {}
        self.restarts: dict[str, int] = {}
        """How often each node was started again."""
        for name in plan.names:
            self.running[name] = self._start(name)

    def _start(self, name: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", CLASSES[topics.kind_of(name)][0], "--ros-args"]
        command += ["--remap", f"__node:={name}", "--params-file", str(self.parameters)]
        # without log files of its own: what a node logs is in its output
        command += ["--disable-external-lib-logs"]
        with self.log(name).open("ab" if name in self.restarts else "wb") as log:
            # a session of its own: Ctrl-C in the terminal reaches this process only, which ends
            # the others in order
            return subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                env=self._environment,
                start_new_session=True,
            )

    def log(self, name: str) -> Path:
        """Return the file with a node's output."""
        return self.folder / f"{name}.log"

    def ended(self) -> dict[str, int]:
        """Return the exit code of each process that has ended."""
        codes = {name: process.poll() for name, process in self.running.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def arrived(self) -> bool:
        """Whether the simulator has ended; raises GraphError where a node ended before it, or with
        an error."""
        ended = self.ended()
        for name, code in ended.items():
            if name == topics.INS_SIM and code == 0:
                return True
            if not self._start_again(name, code):
                raise GraphError(self.describe(name, code))
        return False

    def _start_again(self, name: str, code: int) -> bool:
        """Start a node that was killed once more, after a while; return whether there is hope: a
        node that says that it failed would fail again."""
        if not self._respawns or code >= 0 or self.restarts.get(name, 0) >= MOST_RESTARTS:
            return False
        now = time.monotonic()
        if now >= self._again.setdefault(name, now + RESPAWN_DELAY):
            del self._again[name]
            self.restarts[name] = self.restarts.get(name, 0) + 1
            self.running[name] = self._start(name)
        return True

    def describe(self, name: str, code: int) -> str:
        """Say in one line how a node ended, with its last words."""
        how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        lines = self.log(name).read_text(errors="replace").strip().splitlines()[-LOG_LINES:]
        words = " | ".join(line.strip() for line in lines if line.strip())
        return f"{name} ended ({how}){': ' + words if words else ''}; log: {self.log(name)}"

    def stop(self, interrupt: Interrupt) -> None:
        """End all: the recorder last, so that it hears everything."""
        last = [name for name in self.running if name == RECORDER]
        self._end([name for name in self.running if name not in last], interrupt)
        self._end(last, interrupt)

    def _end(self, names: list[str], interrupt: Interrupt) -> None:
        asked = interrupt.count
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            alive = [self.running[name] for name in names if self.running[name].poll() is None]
            for process in alive:
                process.send_signal(number)
                process.send_signal(signal.SIGCONT)  # one that is stopped would not hear it
            deadline = time.monotonic() + PATIENCE
            # another interrupt ends the wait
            while alive and time.monotonic() < deadline and interrupt.count == asked:
                time.sleep(0.01)
                alive = [process for process in alive if process.poll() is None]
            asked = interrupt.count
        for name in names:
            self.running[name].wait()


class _Watcher(Node):
    """Listens to what the simulator says about the run."""

    def __init__(self, context: Any) -> None:
        super().__init__(
            "isogal_run",
            context=context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self.figures: dict[str, str] = {}
        self.create_subscription(
            DiagnosticArray, topics.DIAGNOSTICS.name, self._hear, QoSProfile(depth=10)
        )

    def _hear(self, array: DiagnosticArray) -> None:
        for item in array.status:
            if item.name.rpartition("/")[2] == topics.INS_SIM:
                self.figures = figures_of(item)


Meddle = Callable[[Processes, float], None]
"""Called again and again with the processes and the simulated time, s."""


def run_processes(
    plan: Plan,
    folder: Path,
    interrupt: Interrupt,
    report: Report,
    announce: Any = None,
    meddle: Meddle | None = None,
) -> Outcome:
    """Run the graph as processes until the route's end, or until interrupted.

    Parameters
    ----------
    folder : Path
        For parameters and logs.
    announce : callable, optional
        Called with the domain before the processes start.
    meddle : callable, optional
        Does faults to the processes.

    Raises
    ------
    InputError
        A domain that the user names is none, or must not be used.
    GraphError
        A node ended before its time, or with an error.
    """
    before = shared_memory()
    with graph_domain(names_of(plan.scenario), plan.domain) as domain:
        if announce is not None:
            announce(domain)
        processes = Processes(plan, folder, domain)
        try:
            wall = _watch(processes, domain, interrupt, report, meddle)
        finally:
            processes.stop(interrupt)
            if any(code < 0 for code in processes.ended().values()):
                sweep_shared_memory(before)
    failed = {name: code for name, code in processes.ended().items() if code != 0}
    if failed and not interrupt:
        raise GraphError(processes.describe(*next(iter(failed.items()))))
    return Outcome(bool(interrupt), wall)


def _watch(
    processes: Processes,
    domain: int,
    interrupt: Interrupt,
    report: Report,
    meddle: Meddle | None,
) -> float:
    """Watch until the simulator has ended; return the wall time from its first step on."""
    with local_context(domain) as context:
        watcher, executor = _Watcher(context), make_executor(context)
        executor.add_node(watcher)
        first: float | None = None
        now, timer = time.monotonic(), ReportTimer()
        try:
            while not interrupt:
                executor.spin_once(timeout_sec=0.1)
                now = time.monotonic()
                progress = progress_of(watcher.figures)
                if progress is not None:
                    # by the simulator's own count of time, which leaves out the processes' start
                    first = first or now - progress.simulated / max(progress.speed, 1e-9)
                    if timer.due():
                        report(progress)
                if meddle is not None:
                    meddle(processes, -1.0 if progress is None else progress.simulated)
                if processes.arrived():
                    break
            return now - first if first is not None else 0.0
        finally:
            executor.shutdown()
            watcher.destroy_node()
