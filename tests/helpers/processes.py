"""Nodes as processes, started and ended as launch does."""

import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from helpers.commands import PATIENCE, wait_for

LAUNCH_WAITS = 5.0
"""s between SIGINT and SIGTERM, and between SIGTERM and SIGKILL, of launch 3.4."""


def start_node(
    name: str,
    *parameters: str,
    log: Path,
    files: Sequence[str] = (),
    arguments: Sequence[str] = (),
    environment: Mapping[str, str] | None = None,
) -> subprocess.Popen:
    """Start a node by its console script, as ``ros2 run`` does, in this process's environment with
    some more; what it says goes into a file."""
    words = [word for parameter in parameters for word in ("-p", parameter)]
    words += [word for file in files for word in ("--params-file", file)]
    program = Path(sys.executable).parent / name
    with log.open("ab") as stream:
        return subprocess.Popen(
            [str(program), "--ros-args", "-r", f"__node:={name}", *words, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=stream,
            stderr=stream,
            env=os.environ | dict(environment or {}),
        )


def catches(pid: int, number: int) -> bool:
    """Whether a process has a handler for a signal."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return False
    masks = [line.split()[1] for line in lines if line.startswith("SigCgt:")]
    return bool(masks) and bool(int(masks[0], 16) >> (number - 1) & 1)


def is_up(process: subprocess.Popen) -> bool:
    """Whether a node's first lines have run."""
    return catches(process.pid, signal.SIGTERM)


def end_as_launch_does(processes: Sequence[subprocess.Popen]) -> list[int]:
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


def until(condition, what: str, *processes: subprocess.Popen) -> None:
    """Wait for a condition while processes run."""

    def met() -> bool:
        ended = [process.args for process in processes if process.poll() is not None]
        assert not ended, f"{ended} ended while waiting for {what}"
        return bool(condition())

    wait_for(met, what)


def end_all(processes: Sequence[subprocess.Popen]) -> None:
    """Kill what is left."""
    for process in processes:
        if process.poll() is None:
            os.kill(process.pid, signal.SIGKILL)
        process.wait()
