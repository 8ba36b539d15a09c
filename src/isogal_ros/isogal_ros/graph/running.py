"""Running the graph: all nodes in this process, or one process for each node and for the recorder,
started, watched and ended together."""

import fcntl
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.process import BaseProcess
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import Executor
from rclpy.qos import QoSProfile

from isogal.compiled import tell_of_compiling
from isogal.files import make_folder
from isogal.threads import one_thread
from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.bus import Bus
from isogal_ros.graph.domain import DISCOVERY, DOMAIN, defaults, graph_domain, quiet_node
from isogal_ros.graph.forkserver import start_node
from isogal_ros.graph.plan import CLASSES, GraphError, Plan
from isogal_ros.nodes.base import GraphNode
from isogal_ros.nodes.health import figures_of
from isogal_ros.nodes.middleware import SHARED_MEMORY, delete_shared_memory
from isogal_ros.nodes.signals import Interrupt
from isogal_ros.nodes.spin import COMPILING, make_executor
from isogal_ros.parameters.values import parameter_file

PATIENCE = 15.0
"""s that a process gets to end after SIGINT, then after SIGTERM, before it is killed."""
RESPAWN_DELAY, MOST_RESTARTS = 1.0, 100
"""s after which a node that was killed is started again, and how often in one run."""
LOG_LINES = 5
"""Last lines of a node's output that its end is described with."""
SETTLED = 1.0
"""s after which Fast DDS has locked a shared memory file that it has made."""


@dataclass(frozen=True)
class Progress:
    """How far a run is."""

    simulated: float
    """s."""
    duration: float
    """s."""
    speed: float
    """Simulated seconds per second of wall time."""
    position_error: float
    """m; NaN = not known."""


AT_ONCE = 200
"""Messages of a graph in one process between looks at what else is to be done."""
LOOK_EVERY = 0.05
"""s of wall time between looks at the nodes and the progress: a step has some twenty messages."""
Report = Callable[[Progress], None]
"""Takes the progress, again and again."""


def progress_of(figures: Mapping[str, object]) -> Progress | None:
    """Return the progress that ins_sim_node's figures tell; None before the first step."""
    if "simulated" not in figures:
        return None
    names = ("simulated", "duration", "speed", "position error")
    return Progress(*(float(str(figures[name])) for name in names))


def run_in_process(plan: Plan, interrupt: Interrupt, report: Report = lambda _: None) -> float:
    """Run the graph on a bus until the route's end, or until interrupted; return the wall time (s)
    from the first step to the last.

    Raises
    ------
    InputError
        A parameter, map or route cannot be used, or the domain that is asked for.
    GraphError
        A node failed.
    """
    nodes = dict[str, GraphNode]()
    tell_of_compiling(lambda: print(f"isogal: {COMPILING}", file=sys.stderr, flush=True))
    with (
        graph_domain(plan.scenario, plan.domain) as domain,
        Bus(quiet=False, domain=domain) as bus,
    ):
        executor = make_executor(bus)
        try:
            for name in plan.names:
                # nothing runs beside anything: the recording has each step's answers behind it
                own = {"ahead": 1} if name == topics.INS_SIM else {}
                nodes[name] = bus.add(name, own | plan.values(name))
                executor.add_node(nodes[name])
            bus.open()
            wall = _spin(bus, executor, nodes, interrupt, report)
        finally:
            if topics.INS_SIM in nodes:
                nodes[topics.INS_SIM].finished = True  # no further step while all end
            bus.run()
            executor.shutdown()  # or it would keep the nodes' publishers
            for name in reversed(nodes):  # the recorder hears all to the end
                nodes[name].close()
                bus.run()
        _require_well(nodes)  # the recorder finishes its bag last
        return wall


def _spin(
    bus: Bus,
    executor: Executor,
    nodes: Mapping[str, GraphNode],
    interrupt: Interrupt,
    report: Report,
) -> float:
    """Run nodes until the simulator has ended; return the wall time from its first step on."""
    simulator, begun = nodes[topics.INS_SIM], time.monotonic()
    looked = begun
    while not (interrupt or simulator.finished):
        # what comes by the middleware, and timers, between messages of the graph
        executor.spin_once(timeout_sec=0.0 if bus.run(AT_ONCE) else 0.2)
        if (now := time.monotonic()) < looked + LOOK_EVERY:
            continue
        looked = now
        bus.look()
        _require_well(nodes)
        if (progress := progress_of(simulator.health.figures)) is not None:
            report(progress)
    return time.monotonic() - (simulator.begun if simulator.step >= 0 else begun)


def _require_well(nodes: Mapping[str, GraphNode]) -> None:
    """Raise GraphError where a node has failed."""
    for name, node in nodes.items():
        if node.exit_code:
            raise GraphError(f"{name}: {node.failure}")


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
    namespace : str
        Of the nodes; empty = none.
    """

    def __init__(self, plan: Plan, folder: Path, domain: int, namespace: str = "") -> None:
        self._folder, self._namespace = folder, namespace
        self._restarts = MOST_RESTARTS if plan.checkpoint is not None else 0
        """How many are left."""
        make_folder(folder)
        own = {name: plan.own(name) for name in plan.names}
        text = parameter_file(plan.scenario, own)
        (folder / "params.yaml").write_text(text, encoding="utf-8")
        self._environment = os.environ | {DOMAIN: str(domain)}
        self._environment |= defaults(self._environment)
        one_thread(self._environment)
        for name in plan.names:
            self._log(name).write_bytes(b"")  # in place of an earlier run's
        self.running = {name: self._start(name) for name in plan.names}

    def _start(self, name: str) -> BaseProcess:
        arguments = ["--ros-args", "--remap", f"__node:={name}"]
        arguments += ["--params-file", str(self._folder / "params.yaml")]
        if self._namespace:
            arguments += ["--remap", f"__ns:=/{self._namespace}"]
        # without log files of its own: what a node logs is in its output
        arguments += ["--disable-external-lib-logs"]
        module, _ = CLASSES[topics.kind_of(name)]
        return start_node(name, module, arguments, self._environment, self._log(name))

    def _log(self, name: str) -> Path:
        return self._folder / f"{name}.log"

    def ended(self) -> dict[str, int]:
        """Return the exit code of each process that has ended."""
        codes = {name: process.exitcode for name, process in self.running.items()}
        return {name: code for name, code in codes.items() if code is not None}

    def compile(self) -> bool:
        """Whether a process has said that it compiles functions."""
        said = (self._log(name).read_text(errors="replace") for name in self.running)
        return any(COMPILING in text for text in said)

    def arrived(self) -> bool:
        """Whether the simulator has ended; raises GraphError where a node ended before it, or with
        an error."""
        for name, code in self.ended().items():
            if name == topics.INS_SIM and code == 0:
                return True
            # one that says that it failed would fail again
            if not self._restarts or code >= 0:
                raise GraphError(self.describe(name, code))
            self._restarts -= 1
            time.sleep(RESPAWN_DELAY)
            self.running[name] = self._start(name)
        return False

    def describe(self, name: str, code: int) -> str:
        """Say in one line how a node ended, with its last words."""
        how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        lines = self._log(name).read_text(errors="replace").strip().splitlines()[-LOG_LINES:]
        words = " | ".join(line.strip() for line in lines if line.strip())
        return f"{name} ended ({how}){': ' + words if words else ''}; log: {self._log(name)}"

    def stop(self, interrupt: Interrupt) -> None:
        """End all: the recorder last, so that it hears everything."""
        last = {name for name in self.running if name == RECORDER}
        for names in (self.running.keys() - last, last):
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
                asked, deadline = interrupt.count, time.monotonic() + PATIENCE
                alive = names - self.ended().keys()
                for pid in filter(None, (self.running[name].pid for name in alive)):
                    with suppress(ProcessLookupError):
                        os.kill(pid, number)
                        os.kill(pid, signal.SIGCONT)  # one that is stopped would not hear it
                # another interrupt ends the wait
                while alive and time.monotonic() < deadline and interrupt.count == asked:
                    time.sleep(0.01)
                    alive -= self.ended().keys()
            for name in names:
                self.running[name].join()


def run_processes(
    plan: Plan,
    folder: Path,
    interrupt: Interrupt,
    report: Report = lambda _: None,
) -> float:
    """Run the graph as processes until the route's end, or until interrupted, and say in which
    domain; return the wall time (s) from the first step to the last.

    Parameters
    ----------
    plan : Plan
    folder : Path
        For parameters and logs.
    interrupt : Interrupt
    report : callable
        Takes the progress.

    Raises
    ------
    InputError
        A domain that the user names is none, or must not be used.
    GraphError
        A node ended before its time, or with an error.
    """
    before = shared_memory()
    with graph_domain(plan.scenario, plan.domain) as domain:
        environment = " ".join(f"{name}={value}" for name, value in DISCOVERY.items())
        print(
            f"The nodes are in ROS domain {domain}. To watch them, where ros2 is installed:\n"
            f"  {DOMAIN}={domain} {environment} ros2 topic echo /nav/fix",
            file=sys.stderr,
            flush=True,
        )
        processes = Processes(plan, folder, domain)
        try:
            wall = _watch(processes, domain, interrupt, report)
        finally:
            processes.stop(interrupt)
            sweep_shared_memory(before)  # of a node that did not come to its own end
    failed = {name: code for name, code in processes.ended().items() if code != 0}
    if failed and not interrupt:
        raise GraphError(processes.describe(*next(iter(failed.items()))))
    return wall


def _watch(processes: Processes, domain: int, interrupt: Interrupt, report: Report) -> float:
    """Watch until the simulator has ended; return the wall time from its first step on."""
    figures: dict[str, str] = {}

    def hear(array: DiagnosticArray) -> None:
        for item in array.status:
            if item.name.rpartition("/")[2] == topics.INS_SIM:
                figures.update(figures_of(item))

    with quiet_node("isogal_run", domain) as watcher:
        watcher.create_subscription(
            DiagnosticArray, topics.DIAGNOSTICS.name, hear, QoSProfile(depth=10)
        )
        executor = make_executor(watcher.context)
        executor.add_node(watcher)
        first, now, told = None, time.monotonic(), False
        try:
            while not interrupt:
                executor.spin_once(timeout_sec=0.1)
                if time.monotonic() < now + LOOK_EVERY:
                    continue
                now, progress = time.monotonic(), progress_of(figures)
                if progress is not None:
                    # by the simulator's own count of time, which leaves out the processes' start
                    first = first or now - progress.simulated / max(progress.speed, 1e-9)
                    report(progress)
                elif not told and processes.compile():
                    told = True
                    print(f"isogal: {COMPILING}", file=sys.stderr, flush=True)
                # where all were told to end, nodes may do so before this process
                if not interrupt and processes.arrived():
                    break
            return now - first if first is not None else 0.0
        finally:
            executor.shutdown()


def shared_memory() -> set[str]:
    """List the names of Fast DDS's shared memory files."""
    return {entry.name for entry in SHARED_MEMORY.glob("*fastrtps_*")}


def sweep_shared_memory(before: set[str]) -> None:
    """Delete the shared memory files that came since and that no process uses: one that is killed
    leaves its own behind."""
    came = shared_memory() - before
    if came:
        time.sleep(SETTLED)  # a graph that is just starting makes a file, then locks it
    for base in {
        name.removeprefix("sem.").removesuffix("_mutex").removesuffix("_el") for name in came
    }:
        # what has a file with its name and _el is locked by who uses it
        with suppress(OSError), (SHARED_MEMORY / f"{base}_el").open("rb") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            delete_shared_memory(base, SHARED_MEMORY)
