"""Shared memory files of one process and its children: other tests run, and kill, beside it."""

import re
from contextlib import suppress
from pathlib import Path

import psutil

from isogal_ros.graph.running import SHARED_MEMORY


def own_memory(pid: int, itself: bool = True) -> set[Path]:
    """List the shared memory files that the children of a process have mapped, and the process
    itself, but for ports: graphs of other tests in the same domain share them."""
    with suppress(psutil.Error):  # it has just ended
        children = [one.pid for one in psutil.Process(pid).children(recursive=True)]
        found = set[Path]().union(*map(_mapped, [*([pid] if itself else []), *children]))
        return {path for path in found if "_port" not in path.name}
    return set()


def _mapped(pid: int) -> set[Path]:
    """List the shared memory files of the middleware that a process has mapped. Their names are
    all that is asked for: with the sizes that psutil tells, a look takes ten times as long."""
    try:
        text = Path(f"/proc/{pid}/maps").read_text()
    except OSError:  # it has just ended
        return set()
    return {Path(one) for one in re.findall(rf"{SHARED_MEMORY}/\S*fastrtps_\S*", text)}


def left_of(own: set[Path]) -> set[Path]:
    """List those that are still there."""
    return {path for path in own if path.exists()}
