"""Reading the first fields of a serialised message without making the rest of it (CDR: OMG
DDS-XTypes 1.3, section 7.4)."""

import struct
from functools import cache

_HEAD = 4
"""Bytes before a message, of which the second says the byte order."""


@cache
def _numbers(form: str) -> tuple[struct.Struct, int]:
    """Return what unpacks numbers of a format, and the size of one."""
    return struct.Struct(form), struct.calcsize(f"={form[-1]}")


class Reader:
    """Takes the fields of a serialised message one after the other; `struct.error` where it ends
    before them, UnicodeDecodeError where a text is none.

    Parameters
    ----------
    data : bytes
    """

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data, _HEAD
        self._order = "<" if data[1:2] == b"\1" else ">"

    def take(self, form: str) -> tuple[float, ...]:
        """Return numbers of one size, by their format as in `struct`: they are aligned to their
        size from where the message begins."""
        numbers, size = _numbers(self._order + form)
        start = _HEAD + -(-(self._at - _HEAD) // size) * size
        self._at = start + numbers.size
        return numbers.unpack_from(self._data, start)

    def text(self) -> str:
        """Return a text."""
        length = int(self.take("I")[0])
        self._at += length
        return self._data[self._at - length : self._at - 1].decode()
