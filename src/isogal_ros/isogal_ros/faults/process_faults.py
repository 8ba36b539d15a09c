"""Faults of processes: nodes that are killed, stopped for a while, or slow."""

import signal
import time
from dataclasses import dataclass
from typing import Literal

from isogal_ros import topics
from isogal_ros.bags.recorder import RECORDER
from isogal_ros.graph.processes import Processes
from isogal_ros.nodes.signals import Interrupt

PATIENCE = 300.0
"""s of wall time after which a run that does not arrive hangs."""


@dataclass(frozen=True)
class ProcessFault:
    """One fault of one node, or of several at once."""

    name: str
    nodes: tuple[str, ...]
    kind: Literal["kill", "stop", "slow"]
    lasts: float = 0.0
    """s of wall time that a node is stopped, or slow."""
    matters: bool = False
    """Whether it costs data, so that it must be told within two batches."""


def _faults() -> tuple[ProcessFault, ...]:
    answering = (topics.GRAVIMETER, topics.PMHT_MM, topics.UKF_FUSION)
    every = (RECORDER, *topics.NODES)
    killed = [
        ProcessFault(f"{name} killed", (name,), "kill", matters=name in answering)
        for name in every
    ]
    stopped = [ProcessFault(f"{name} stopped for 3 s", (name,), "stop", 3.0) for name in every]
    slow = [ProcessFault(f"{name} at half speed", (name,), "slow", 5.0) for name in every]
    pair = (topics.PMHT_MM, topics.UKF_FUSION)
    together = [
        ProcessFault("filter and matcher killed", pair, "kill", matters=True),
        ProcessFault("all that answer killed", answering, "kill", matters=True),
    ]
    return (*killed, *stopped, *slow, *together)


PROCESS_FAULTS = _faults()


class Meddler:
    """Does a fault to the processes of a run (`run_processes`), and ends a run that hangs.

    Parameters
    ----------
    fault : ProcessFault
    begin : float
        s of simulated time.
    interrupt : Interrupt
        Of the run.
    """

    def __init__(self, fault: ProcessFault, begin: float, interrupt: Interrupt) -> None:
        self._fault, self._begin, self._interrupt = fault, begin, interrupt
        self.limit = time.monotonic() + PATIENCE
        """Wall time (monotonic, s) after which a run hangs."""
        self._since: float | None = None
        self._stopped = False
        self.over = False
        """Whether the fault has been done."""
        self.begun_ns = 0
        """Wall time of the fault, ns; 0 = it did not come to it."""
        self.hung = False
        """Whether the run was ended because it did not arrive."""

    def __call__(self, processes: Processes, simulated: float) -> None:
        """Do what is due when the run is at a simulated time (s)."""
        now = time.monotonic()
        if now > self.limit and not self._interrupt:
            self.hung = True
            self._interrupt(signal.SIGINT)
        if self.over or simulated < self._begin:
            return
        if self._since is None:
            self._since, self.begun_ns = now, time.time_ns()
        if self._fault.kind == "kill":
            self._send(processes, signal.SIGKILL)
            self.over = True
        elif now - self._since >= self._fault.lasts:
            self._send(processes, signal.SIGCONT)
            self.over = True
        elif self._fault.kind == "slow" or not self._stopped:
            self._stopped = not self._stopped
            self._send(processes, signal.SIGSTOP if self._stopped else signal.SIGCONT)

    def _send(self, processes: Processes, number: signal.Signals) -> None:
        for name in self._fault.nodes:
            process = processes.running[name]
            if process.poll() is None:
                process.send_signal(number)
