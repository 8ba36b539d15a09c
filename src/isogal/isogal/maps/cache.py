"""Files that are made once and kept in the user's cache folder: several processes may ask for them
at once, and damaged ones are made again."""

import contextlib
import fcntl
import functools
import logging
import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from isogal.errors import InputError
from isogal.files import atomic_path

_LOG = logging.getLogger(__name__)

Numbers = NDArray[np.int32]
"""What is kept: whole numbers, of any shape."""
Arrays = Mapping[str, Any]
Maker = Callable[[], Arrays]
"""Makes the arrays of a cache file, by their names."""


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


def read_array(path: Path, name: str) -> Numbers | None:
    """Return one array of a cache file, or None if the file is absent, cut short or damaged."""
    try:
        with np.load(path) as file:
            return np.asarray(file[name])  # its checksum is compared as it is read
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile):
        return None


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


def read_or_make(makers: dict[Path, Maker], name: str) -> Iterator[tuple[Path, Numbers]]:
    """Give one array of each of many cache files, making those that are absent or damaged, in any
    order.

    Where the folder cannot be written, the arrays are made and not kept.

    Parameters
    ----------
    makers : dict
        File (``.npz``), and the function that makes its arrays: the same in every process.
    name : str
        Which array is wanted.
    """
    # each process in another order, so that they share the work
    for path in sorted(makers, key=lambda path: hash((os.getpid(), path))):
        array = read_array(path, name)
        yield path, _made(path, makers[path], name) if array is None else array


@functools.cache  # once
def _say_not_kept(folder: Path, why: str) -> None:
    _LOG.warning("isogal: the cache %s cannot be written (%s): goes on without", folder, why)


def _made(path: Path, maker: Maker, name: str) -> Numbers:
    """Return an array of a cache file, which is made if it is absent or damaged."""
    arrays: Arrays | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with locked(path, wait=True):  # until another process that is making it has finished
            array = read_array(path, name)
            if array is not None:
                return array
            arrays = maker()
            with atomic_path(path) as temporary:
                np.savez(temporary, **arrays)
    except (OSError, InputError) as error:
        of_system = error.__context__ if isinstance(error, InputError) else error
        _say_not_kept(path.parent, getattr(of_system, "strerror", str(error)))
    return np.asarray((maker() if arrays is None else arrays)[name])
