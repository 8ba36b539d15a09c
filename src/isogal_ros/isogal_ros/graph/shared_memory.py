"""Fast DDS's shared memory files: a killed process leaves its own behind."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_FOLDER = Path("/dev/shm")
SETTLED = 1.0
"""s after which a file is what it will be."""


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
    """List the names of those that came since, are not being made just now, and that no other
    process has open."""
    return _unused({name for name in shared_memory() - before if _age(name) >= SETTLED})


def sweep_shared_memory(before: set[str]) -> None:
    """Delete those that came since and that no other process has open.

    What is younger than `SETTLED` may belong to a graph that is just starting, which makes a file,
    locks it and maps it one after the other: touched between, it finds the file locked or gone. A
    young one that nobody seems to have open is looked at again when it is old enough."""
    came = shared_memory() - before
    young = {name for name in came if _age(name) < SETTLED}
    _delete(came - young)
    if _unused(young):
        time.sleep(SETTLED)
        _delete(young)


def _delete(names: set[str]) -> None:
    for name in _unused(names):
        with suppress(OSError), _locked(name):  # another user's, or taken up again
            (_FOLDER / name).unlink()


def _unused(names: set[str]) -> set[str]:
    used = _open_files() if names else set()
    return {name for name in names if str(_FOLDER / name) not in used}


def _age(name: str) -> float:
    """Return for how long (s) a file is there in its size; 0 = it is gone."""
    try:
        return time.time() - (_FOLDER / name).stat().st_mtime  # mapped memory does not count
    except OSError:
        return 0.0


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
            # in this order: a file is opened, mapped, and then closed
            for entry in (process / "fd").iterdir():
                with suppress(OSError):  # closed meanwhile
                    found.add(str(entry.readlink()))
            lines = (process / "maps").read_text(errors="replace").splitlines()
            found.update(
                line[line.index(str(_FOLDER)) :] for line in lines if str(_FOLDER) in line
            )
        except OSError:
            continue
    return found
