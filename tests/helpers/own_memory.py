"""Shared memory files of one process and its children: other tests run, and kill, beside it."""

from contextlib import suppress
from pathlib import Path

import psutil

from isogal_ros.graph.running import SHARED_MEMORY


def own_memory(pid: int, itself: bool = True) -> set[Path]:
    """List the shared memory files that the children of a process have mapped, and the process
    itself, but for ports: graphs of other tests in the same domain share them."""
    found: set[Path] = set()
    with suppress(psutil.Error):  # it has just ended
        parent = psutil.Process(pid)
        for one in [*([parent] if itself else []), *parent.children(recursive=True)]:
            with suppress(psutil.Error):
                found |= {Path(item.path) for item in one.memory_maps()}
    own = {path for path in found if path.parent == SHARED_MEMORY}
    return {path for path in own if "fastrtps_" in path.name and "_port" not in path.name}


def left_of(own: set[Path]) -> set[Path]:
    """List those that are still there."""
    return {path for path in own if path.exists()}
