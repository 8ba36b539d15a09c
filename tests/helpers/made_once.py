"""Files that several test workers need are made by the first that asks."""

import fcntl
from collections.abc import Callable
from pathlib import Path

import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Return a folder of this session, by its name, that `make` has filled: in one worker, for
    which the others wait. Where `make` raises, the next to ask begins anew."""
    base = factory.getbasetemp()
    shared = base.parent if "popen-gw" in base.name else base
    folder = shared / f"made-{name}"
    with Path(f"{folder}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            part = factory.mktemp(name)
            make(part)
            part.rename(folder)
    return folder
