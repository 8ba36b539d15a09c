"""MCAP files that were compressed as a whole (``.mcap.zstd``, as ``ros2 bag record
--compression-mode file`` leaves them)."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from isogal.errors import InputError

LARGEST = 8 * 1024**3
"""Bytes after which unpacking ends: a small file may say that it holds any number."""
_BLOCK = 1024 * 1024


@contextmanager
def opened(file: Path) -> Iterator[BinaryIO]:
    """Open an MCAP file for reading, unpacked into a temporary file where it is compressed.

    Raises
    ------
    InputError
        It cannot be unpacked, or is larger than `LARGEST`.
    """
    if file.suffix != ".zstd":
        with file.open("rb") as stream:
            yield stream
        return
    with tempfile.TemporaryFile() as whole:
        _unpack(file, whole)
        whole.seek(0)
        yield whole


def _unpack(file: Path, whole: object) -> None:
    import zstandard

    size = 0
    try:
        with file.open("rb") as stream:
            for block in zstandard.ZstdDecompressor().read_to_iter(stream, write_size=_BLOCK):
                size += len(block)
                if size > LARGEST:
                    raise InputError(f"{file}: more than {LARGEST} bytes when unpacked")
                whole.write(block)  # type: ignore[attr-defined]
    except zstandard.ZstdError as error:
        if size == 0:
            raise InputError(f"{file}: not compressed by zstd: {error}") from None
