"""Fast DDS's shared memory files: a killed process leaves its own behind."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_FOLDER = Path("/dev/shm")


def shared_memory() -> set[str]:
    """List the names of Fast DDS's shared memory files."""
    if not _FOLDER.is_dir():
        return set()
    return {
        entry.name
        for entry in _FOLDER.iterdir()
        if "fastrtps_" in entry.name or "fastdds_" in entry.name
    }


def abandoned_memory(before: set[str]) -> set[str]:
    """List the names of those that came since and that no other process has open."""
    left = shared_memory() - before
    used = _open_files() if left else set()
    return {name for name in left if str(_FOLDER / name) not in used}


def sweep_shared_memory(before: set[str]) -> None:
    """Delete those that came since and that no other process has open."""
    for name in abandoned_memory(before):
        with suppress(OSError), _locked(name):  # another user's, or taken up again
            (_FOLDER / name).unlink()


@contextmanager
def _locked(name: str) -> Iterator[None]:
    """Hold the lock that Fast DDS takes on a file that it uses, so that nobody takes the file up
    while it is deleted; raises OSError where somebody has it."""
    base = name.removeprefix("sem.").removesuffix("_mutex").removesuffix("_el")
    try:
        descriptor = os.open(_FOLDER / f"{base}_el", os.O_RDONLY)
    except FileNotFoundError:
        yield
        return
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    finally:
        os.close(descriptor)


def _open_files() -> set[str]:
    """List the shared memory files that other processes have mapped or open, as far as this user
    may see; what this process still has mapped it no longer needs."""
    found: set[str] = set()
    for process in Path("/proc").glob("[0-9]*"):
        if int(process.name) == os.getpid():
            continue
        try:
            lines = (process / "maps").read_text(errors="replace").splitlines()
            found.update(
                line[line.index(str(_FOLDER)) :] for line in lines if str(_FOLDER) in line
            )
            found.update(str(entry.readlink()) for entry in (process / "fd").iterdir())
        except OSError:
            continue
    return found
