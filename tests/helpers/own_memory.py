"""Shared memory files of one process and its children: other tests run, and kill, beside it."""

from pathlib import Path

import psutil

from isogal_ros.graph.shared_memory import abandoned_memory

SHARED = "/dev/shm/"


def own_memory(pid: int, itself: bool = True) -> set[str]:
    """List the names of the shared memory files that the children of a process have mapped, and
    the process itself."""
    found: set[str] = set()
    try:
        parent = psutil.Process(pid)
        family = [*([parent] if itself else []), *parent.children(recursive=True)]
    except psutil.Error:
        return found
    for process in family:
        try:
            maps = Path(f"/proc/{process.pid}/maps").read_text(errors="replace")
        except OSError:  # it has just ended
            continue
        found.update(
            line.partition(SHARED)[2] for line in maps.splitlines() if SHARED + "fast" in line
        )
    return found


def left_of(own: set[str], before: set[str]) -> set[str]:
    """List those of the names that came since `before` and that nobody has open any more: some are
    shared with the graphs of other tests."""
    return own & abandoned_memory(before)
