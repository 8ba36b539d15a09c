"""The user's cache folder, and locks of files in it and elsewhere."""

import contextlib
import fcntl
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path


def cache_folder() -> Path:
    """Return the cache folder: ``$ISOGAL_CACHE``, else ``$XDG_CACHE_HOME/isogal``, else
    ``~/.cache/isogal``."""
    if own := os.environ.get("ISOGAL_CACHE"):
        return Path(own)
    base = os.environ.get("XDG_CACHE_HOME")
    if base and Path(base).is_absolute():
        return Path(base) / "isogal"
    try:
        return Path.home() / ".cache" / "isogal"
    except RuntimeError:  # no home folder at all
        return Path(tempfile.gettempdir()) / f"isogal-{os.getuid()}"


@contextlib.contextmanager
def locked(path: Path, wait: bool) -> Iterator[bool]:
    """Hold the lock file of ``path``; gives whether it was got. The system frees it when the
    process ends, however it ends."""
    with path.with_name(f".{path.name}.lock").open("a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
        except BlockingIOError:
            yield False
            return
        yield True
