"""MCAP files from outside: those of a bag in their order, unpacked and read record by record; what
a damaged one raises, and how much one may hold."""

import re
import struct
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from isogal.errors import InputError

LARGEST = 8 * 1024**3
"""Bytes after which unpacking a compressed file ends: a small one may say that it holds any
number."""
LARGEST_CHUNK = 1024**3
"""Bytes of a chunk when unpacked; a chunk of a few kilobytes may say that it holds any number."""
SUFFIXES = (".mcap", ".mcap.zstd")
"""The latter are compressed as a whole, as ``ros2 bag record --compression-mode file`` leaves
them."""
_NUMBER = re.compile(r"_(\d+)\.mcap(\.zstd)?$")

_RAISED = (
    struct.error,
    EOFError,
    LookupError,
    ValueError,  # a checksum that does not fit, text that is not UTF-8
    TypeError,
    OverflowError,  # a length of more than 63 bits
    MemoryError,
    OSError,
    RuntimeError,  # lz4
)
_ELSEWHERE = ("McapError", "ZstdError")
"""By name, of packages that need not be installed."""


def is_damage(error: BaseException) -> bool:
    """Whether an exception, raised while records are read, says that the file is damaged."""
    names = {kind.__name__ for kind in type(error).__mro__}
    return isinstance(error, _RAISED) or not names.isdisjoint(_ELSEWHERE)


def unpacked(record: Any) -> list[Any]:
    """Return the records in a chunk, their checksum compared; of any other record itself.

    Raises
    ------
    Exception
        One of which `is_damage` is true: the chunk is damaged, or holds more than `LARGEST_CHUNK`.
    """
    from mcap.records import Chunk
    from mcap.stream_reader import breakup_chunk

    if not isinstance(record, Chunk):
        return [record]
    size = record.uncompressed_size
    if record.compression == "zstd":
        import zstandard

        # the frame's own word, which the unpacking believes before the chunk's
        size = max(size, zstandard.frame_content_size(record.data))
    if size > LARGEST_CHUNK:
        raise ValueError(f"a chunk of {size} bytes; allowed: {LARGEST_CHUNK}")
    return list(breakup_chunk(record, validate_crc=True))


def records_of(stream: BinaryIO, start: int = 0) -> Iterator[tuple[int, list[Any]]]:
    """Yield where each record of an MCAP file ends, from a place on, and what it holds: the
    records of a chunk (`unpacked`), or itself."""
    from mcap.stream_reader import StreamReader

    stream.seek(start)
    for record in StreamReader(stream, skip_magic=start > 0, emit_chunks=True).records:
        yield stream.tell(), unpacked(record)


@contextmanager
def opened(file: Path) -> Iterator[BinaryIO]:
    """Open an MCAP file for reading, unpacked into a temporary file where it is compressed; raises
    InputError where it cannot be unpacked, or is larger than `LARGEST`."""
    if file.suffix != ".zstd":
        with file.open("rb") as stream:
            yield stream
        return
    with tempfile.TemporaryFile() as whole:
        _unpack(file, whole)
        whole.seek(0)
        yield whole


def _unpack(file: Path, whole: BinaryIO) -> None:
    import zstandard

    try:
        with file.open("rb") as stream:
            for block in zstandard.ZstdDecompressor().read_to_iter(stream, write_size=1024**2):
                whole.write(block)
                if whole.tell() > LARGEST:
                    raise InputError(f"{file}: more than {LARGEST} bytes when unpacked")
    except zstandard.ZstdError as error:
        if whole.tell() == 0:
            raise InputError(f"{file}: not compressed by zstd, or damaged") from error


def parts(folder: Path) -> list[Path]:
    """Return the MCAP files of a folder, by their number (``<bag>_0.mcap``, ``<bag>_1.mcap``), in
    which order they were written."""
    if not folder.is_dir():
        return []
    return sorted((file for file in folder.iterdir() if file.name.endswith(SUFFIXES)), key=_order)


def numbered(files: list[Path]) -> bool:
    """Whether files are the parts of one bag: numbered from 0 on, with one name."""
    names = {_NUMBER.sub("", file.name) for file in files}
    return len(names) == 1 and [_order(file)[0] for file in files] == list(range(len(files)))


def _order(file: Path) -> tuple[int, str]:
    found = _NUMBER.search(file.name)
    return (int(found.group(1)) if found else -1, file.name)
