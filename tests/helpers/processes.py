"""Nodes as processes, started and ended as launch does."""

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from helpers.commands import PATIENCE, wait_for
from isogal_ros.graph import forkserver
from isogal_ros.graph.plan import CLASSES

LAUNCH_WAITS = 5.0
"""s between SIGINT and SIGTERM, and between SIGTERM and SIGKILL, of launch 3.4."""


def start_node(name: str, *parameters: str, log: Path) -> subprocess.Popen:
    """Start a node by its console script, as ``ros2 run`` does, in this process's environment;
    what it says goes into a file."""
    program = Path(sys.executable).parent / name
    with log.open("ab") as stream:
        return subprocess.Popen(
            [str(program), *ros_arguments(name, parameters)],
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
        )


class Forked:
    """A node that is forked from an interpreter which has imported what nodes need, as those of
    ``isogal run`` are, with what `subprocess.Popen` has for it."""

    def __init__(
        self, name: str, arguments: Sequence[str], environment: Mapping[str, str], log: Path
    ) -> None:
        self.args = [name, *arguments]
        self._process = forkserver.start_node(name, CLASSES[name][0], arguments, environment, log)
        self.pid: int = self._process.pid

    def poll(self) -> int | None:
        """Return the exit code, minus the number of a signal; None = it runs."""
        return self._process.exitcode

    def wait(self, timeout: float | None = None) -> int:
        """Return the exit code once it has ended."""
        self._process.join(timeout)
        code = self.poll()
        if code is None:
            raise subprocess.TimeoutExpired(self.args, timeout or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        """Send it a signal, while it runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)


Process = subprocess.Popen | Forked


def ros_arguments(
    name: str, parameters: Sequence[str] = (), files: Sequence[str] = ()
) -> list[str]:
    """The command line of a node."""
    words = [word for parameter in parameters for word in ("-p", parameter)]
    words += [word for file in files for word in ("--params-file", file)]
    return ["--ros-args", "-r", f"__node:={name}", *words]


def catches(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return False
    masks = [line.split()[1] for line in lines if line.startswith("SigCgt:")]
    return bool(masks) and bool(int(masks[0], 16) >> (number - 1) & 1)


def is_up(process: Process) -> bool:
    """Whether a node's first lines have run."""
    return catches(process.pid, signal.SIGTERM)


def end_as_launch_does(processes: Sequence[Process]) -> list[int]:
    """SIGINT to all, SIGTERM 5 s later, SIGKILL 5 s later; return the exit codes."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        for process in processes:
            if process.poll() is None:
                process.send_signal(number)
        for process in processes:
            try:
                process.wait(LAUNCH_WAITS)
            except subprocess.TimeoutExpired:
                continue
    return [process.wait(PATIENCE) for process in processes]


def until(condition, what: str, *processes: Process) -> None:
    """Wait for a condition while processes run."""

    def met() -> bool:
        ended = [process.args for process in processes if process.poll() is not None]
        assert not ended, f"{ended} ended while waiting for {what}"
        return bool(condition())

    wait_for(met, what)


def end_all(processes: Sequence[Process]) -> None:
    """Kill what is left."""
    for process in processes:
        if process.poll() is None:
            os.kill(process.pid, signal.SIGKILL)
        process.wait()
