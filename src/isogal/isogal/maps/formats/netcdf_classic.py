"""Check of the header of a classic NetCDF file (CDF-1, -2, -5) before the C library reads it.

The library trusts the counts in a header: a damaged one costs minutes and gigabytes, and data
missing at the end of a file read as zeros. Layout: NetCDF Classic Format Specification (Unidata),
sec. "Format"."""

import math
from pathlib import Path
from typing import BinaryIO

from isogal.errors import InputError

_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 4, 6: 8, 7: 1, 8: 2, 9: 4, 10: 8, 11: 8}
"""Bytes of each nc_type."""
_DIMENSION, _VARIABLE, _ATTRIBUTE = 10, 11, 12
_MOST = 1 << 16
"""Dimensions, variables or attributes in one list."""


def check_classic(path: Path, where: str) -> None:
    """Refuse a classic file whose header does not fit its size; pass whatever is not a classic
    file.

    Raises
    ------
    InputError
        The header is damaged, or the file ends before the data that the header describes.
    """
    with path.open("rb") as file:
        magic = file.read(4)
        if magic[:3] != b"CDF" or magic[3:] not in (b"\x01", b"\x02", b"\x05"):
            return
        try:
            end = _Header(file, path.stat().st_size, magic[3]).end_of_data()
        except _DamagedError as error:
            raise InputError(
                f"{where}: cannot be read as NetCDF: damaged header ({error})"
            ) from None
    if end > path.stat().st_size:
        raise InputError(
            f"{where}: has {path.stat().st_size} bytes, its header describes {end}; cut short?"
        )


class _DamagedError(Exception):
    pass


class _Header:
    def __init__(self, file: BinaryIO, size: int, version: int) -> None:
        self.file, self.size = file, size
        self.count_bytes = 8 if version == 5 else 4
        self.offset_bytes = 4 if version == 1 else 8

    def end_of_data(self) -> int:
        """Return where the data of the last variable without a record dimension end."""
        self.number(self.count_bytes)  # records
        lengths = [self.dimension() for _ in range(self.entries(_DIMENSION))]
        self.attributes()
        return max((self.variable(lengths) for _ in range(self.entries(_VARIABLE))), default=0)

    def dimension(self) -> int:
        self.name()
        return self.number(self.count_bytes)

    def attributes(self) -> None:
        for _ in range(self.entries(_ATTRIBUTE)):
            self.name()
            size = self.item_size()
            self.skip(self.number(self.count_bytes) * size)

    def variable(self, lengths: list[int]) -> int:
        self.name()
        dims = self.number(self.count_bytes)
        if dims > 1024:
            raise _DamagedError(f"a variable with {dims} dimensions")
        indices = [self.number(self.count_bytes) for _ in range(dims)]
        if any(index >= len(lengths) for index in indices):
            raise _DamagedError("a variable with an unknown dimension")
        self.attributes()
        size = self.item_size()
        self.number(self.count_bytes)  # vsize: redundant, and wrong for large variables
        begin = self.number(self.offset_bytes)
        shape = [lengths[index] for index in indices]
        return begin if shape[:1] == [0] else begin + size * math.prod(shape)

    def item_size(self) -> int:
        kind = self.number(4)
        if kind not in _SIZES:
            raise _DamagedError(f"data type {kind}")
        return _SIZES[kind]

    def entries(self, tag: int) -> int:
        found, count = self.number(4), self.number(self.count_bytes)
        if found != tag and (found, count) != (0, 0):
            raise _DamagedError(f"a list begins with {found}")
        if count > _MOST:
            raise _DamagedError(f"a list of {count} entries")
        return count

    def name(self) -> None:
        self.skip(self.number(self.count_bytes))

    def number(self, size: int) -> int:
        raw = self.file.read(size)
        if len(raw) < size:
            raise _DamagedError("it goes on beyond the end of the file")
        return int.from_bytes(raw, "big")

    def skip(self, size: int) -> None:
        size += -size % 4
        if self.file.tell() + size > self.size:
            raise _DamagedError("it goes on beyond the end of the file")
        self.file.seek(size, 1)
