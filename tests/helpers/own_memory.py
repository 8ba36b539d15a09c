"""Shared memory files of one process and its children: other tests run, and kill, beside it."""

import os
from pathlib import Path

import psutil

from isogal_ros.graph.shared_memory import abandoned_memory

SHARED = "/dev/shm/"


def own_memory(pid: int, itself: bool = True) -> set[str]:
    """List the names of the shared memory files that the children of a process have mapped, and
    the process itself."""
    try:
        parent = psutil.Process(pid)
        family = [*([parent] if itself else []), *parent.children(recursive=True)]
    except psutil.Error:
        return set()
    return set().union(*(mapped(process.pid) for process in family))


def mapped(pid: int) -> set[str]:
    """List those that one process has mapped."""
    try:
        lines = Path(f"/proc/{pid}/maps").read_text(errors="replace").splitlines()
    except OSError:  # it has just ended
        return set()
    return {line.partition(SHARED)[2] for line in lines if SHARED + "fast" in line}


def left_of(own: set[str], before: set[str]) -> set[str]:
    """List those of the names that came since `before` and that nobody has open any more, but for
    ports: graphs of other tests in the same domain share them and take them up again."""
    left = own & abandoned_memory(before) - mapped(os.getpid())
    return {name for name in left if "_port" not in name}
