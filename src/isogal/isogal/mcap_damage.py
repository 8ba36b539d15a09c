"""MCAP files from outside: what a damaged one raises, and how much a chunk may hold."""

import struct
from typing import Any

LARGEST_CHUNK = 1024**3
"""Bytes of a chunk when unpacked; a chunk of a few kilobytes may say that it holds any number."""

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
