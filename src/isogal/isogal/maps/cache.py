"""Files that are made once and kept in the user's cache folder: several processes may ask for them
at once, and damaged ones are made again."""

import contextlib
import fcntl
import logging
import os
import tempfile
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from isogal.errors import InputError
from isogal.files import atomic_path

_LOG = logging.getLogger(__name__)
_MAGIC = b"ISOGAL1\n"
_ENTRY = 12  # bytes of the table for each part: length (8), CRC-32 (4)


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


def read_part(path: Path, index: int) -> bytes | None:
    """Return one part of a cache file, or None if the file is absent, cut short or damaged."""
    try:
        with path.open("rb") as file:
            head = file.read(len(_MAGIC) + 1)
            count = head[-1] if head[:-1] == _MAGIC else 0
            table = file.read(_ENTRY * count)
            if index >= count or len(table) < _ENTRY * count:
                return None
            entries = [table[i : i + _ENTRY] for i in range(0, len(table), _ENTRY)]
            lengths = [int.from_bytes(entry[:8], "big") for entry in entries]
            if path.stat().st_size != len(head) + len(table) + sum(lengths):
                return None
            file.seek(sum(lengths[:index]), os.SEEK_CUR)
            body = file.read(lengths[index])
    except OSError:
        return None
    return body if zlib.crc32(body) == int.from_bytes(entries[index][8:], "big") else None


def write_parts(path: Path, parts: Sequence[bytes]) -> None:
    """Write a cache file of at most 255 parts with their lengths and checksums; it appears whole
    or not at all."""
    table = b"".join(
        len(part).to_bytes(8, "big") + zlib.crc32(part).to_bytes(4, "big") for part in parts
    )
    with atomic_path(path) as temporary:
        temporary.write_bytes(b"".join((_MAGIC, bytes([len(parts)]), table, *parts)))


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


def read_or_make(
    makers: dict[Path, Callable[[], Sequence[bytes]]], index: int
) -> Iterator[tuple[Path, bytes]]:
    """Give one part of each of many cache files, making those that are absent or damaged, in any
    order.

    Processes that ask at the same time share the work: each takes what no other is making, then
    waits for the rest. Where the folder cannot be written, the parts are made and not kept.

    Parameters
    ----------
    makers : dict
        File, and the function that makes its parts: the same bytes in every process.
    index : int
        Which part is wanted.
    """
    waiting = list(makers)
    for wait in (False, True):
        left, waiting = waiting, []
        for path in left:
            body = read_part(path, index)
            if body is None:
                body = _make(path, makers[path], index, wait)
            if body is None:
                waiting.append(path)
            else:
                yield path, body


def _make(
    path: Path, maker: Callable[[], Sequence[bytes]], index: int, wait: bool
) -> bytes | None:
    """Make a cache file; None if another process is making it, unless told to wait for that."""
    parts: Sequence[bytes] | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with locked(path, wait) as mine:
            if not mine:
                return None
            body = read_part(path, index)  # another process may have finished it meanwhile
            if body is not None:
                return body
            parts = maker()
            write_parts(path, parts)
    except (OSError, InputError) as error:
        _LOG.warning("%s is not kept in the cache: %s", path.name, error)
    return (maker() if parts is None else parts)[index]
