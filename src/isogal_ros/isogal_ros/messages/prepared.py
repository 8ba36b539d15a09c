"""Messages that are serialised once: of one after the other only stamp and numbers change.

rclpy takes a message apart field by field, which takes longer than all that the filter does with a
sample. Of the messages of every step the layout is fixed: in CDR (OMG DDS-XTypes 1.3, section 7.4)
their float64 follow one another as in memory, aligned to eight bytes.

`Reader` takes the first fields of a serialised message without making the rest of it."""

import struct
from collections.abc import Callable, Iterator
from functools import cache, reduce

import numpy as np
from numpy.typing import ArrayLike
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.serialization import deserialize_message, serialize_message

from isogal.arrays import Array
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.stamps import SECOND, set_stamp
from isogal_ros.topics import Message

_STAMP, _STAMP_AT = struct.Struct("=iI"), 4
"""Behind four bytes that say how the message is represented."""
_NOTHING = np.empty(0)


class Prepared:
    """A message whose stamp and numbers are written into what it is serialised to.

    Parameters
    ----------
    message : Message
        With all that stays as it is; its numbers are those to begin with.

    Raises
    ------
    ValueError
        Its numbers do not follow one another.
    """

    def __init__(self, message: Message) -> None:
        self.message = message
        """What `prepare` serialises."""
        self.ns = 0
        """Stamp."""
        self.numbers = numbers_of(message)
        """(N,) all float64 of the message, in the order of its fields."""
        first = next(iter(message.get_fields_and_field_types().values()))
        self._has_stamp = first in ("std_msgs/Header", "builtin_interfaces/Time")
        self._renamed = False
        self.prepare()

    def prepare(self) -> None:
        """Serialise what is not stamp or number anew."""
        marks: Array = np.arange(1.0, 1.0 + len(self.numbers))
        _write_object(self.message, marks)
        data = serialize_message(self.message)
        start = data.rfind(marks.tobytes())
        if start < 0:
            raise ValueError(f"{type(self.message).__name__}: numbers that do not follow another")
        self._head, self._tail = bytearray(data[:start]), data[start + marks.nbytes :]

    def rename(self, change: Callable[[Message], None]) -> None:
        """Let a function change the names of the message's frames, once."""
        if not self._renamed:
            self._renamed = True
            change(self.message)
            self.prepare()

    def serialised(self) -> bytes:
        """Return the message as it is now."""
        if self._has_stamp:
            _STAMP.pack_into(self._head, _STAMP_AT, *divmod(self.ns, SECOND))
        return b"".join((self._head, self.numbers.tobytes(), self._tail))

    def write(self, ns: int, numbers: Array) -> None:
        """Write a stamp, where the message has one, and all numbers; where it holds as many as
        one likes, they may become more or fewer."""
        more = len(numbers) != len(self.numbers)
        self.ns, self.numbers = ns, numbers
        if more:
            self.prepare()


def serialised(message: Message | Prepared) -> bytes:
    """Return a message as bytes."""
    if isinstance(message, Prepared):
        return message.serialised()
    return message if isinstance(message, bytes) else serialize_message(message)


def decoded(data: bytes, kind: type[Message]) -> Message:
    """Return a serialised message of a class; raises BadMessageError where it is cut off, or of
    another."""
    try:
        return deserialize_message(data, kind)
    except rclpy_implementation.RMWError:
        raise BadMessageError("cut off, or of another type") from None


def numbers_of(message: Message | Prepared) -> Array:
    """Return (N,) all float64 of a message, in the order of its fields."""
    if isinstance(message, Prepared):
        return message.numbers
    parts = (reduce(getattr, way, message) for way, _ in _fields(message))
    return np.concatenate([np.empty(0), *(np.atleast_1d(np.asarray(one, float)) for one in parts)])


def write(message: Message | Prepared, ns: int, *parts: ArrayLike) -> None:
    """Write a stamp into the header of a message, and all its float64: numbers and arrays in the
    order of its fields, row by row."""
    each = [np.array(part, dtype=float).ravel() for part in parts]
    numbers = each[0] if len(each) == 1 else np.concatenate([_NOTHING, *each])
    if isinstance(message, Prepared):
        message.write(ns, numbers)
        return
    _write_object(message, numbers)
    if hasattr(message, "header"):
        set_stamp(message.header.stamp, ns)


def _write_object(message: Message, numbers: Array) -> None:
    rest = numbers
    for way, kind in _fields(message):
        owner = reduce(getattr, way[:-1], message)
        if kind == "double":
            setattr(owner, way[-1], float(rest[0]))
            rest = rest[1:]
        elif kind == "sequence<double>":
            setattr(owner, way[-1], rest.tolist())
        else:
            size = len(getattr(owner, way[-1]))
            setattr(owner, way[-1], rest[:size].copy())
            rest = rest[size:]


def _fields(message: Message) -> Iterator[tuple[tuple[str, ...], str]]:
    """Yield the names that lead to each field of float64, or of an array of them, and what it
    is."""
    for name, kind in message.get_fields_and_field_types().items():
        if "double" in kind:
            yield (name,), kind
        elif "/" in kind and "sequence" not in kind:
            yield from (((name, *way), inner) for way, inner in _fields(getattr(message, name)))


_HEAD = 4
"""Bytes before a message, of which the second says the byte order."""


@cache
def _numbers(form: str) -> tuple[struct.Struct, int]:
    """Return what unpacks numbers of a format, and the size of one."""
    return struct.Struct(form), struct.calcsize(f"={form[-1]}")


class Reader:
    """Takes the fields of a serialised message one after the other; BadMessageError where it ends
    before them, or a text is none.

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
        try:
            return numbers.unpack_from(self._data, start)
        except struct.error:
            raise BadMessageError("cut off, or too few numbers") from None

    def stamp(self) -> int:
        """Return a stamp, ns."""
        seconds, rest = self.take("iI")
        return int(seconds) * SECOND + int(rest)

    def text(self) -> str:
        """Return a text."""
        length = int(self.take("I")[0])
        self._at += length
        try:
            return self._data[self._at - length : self._at - 1].decode()
        except UnicodeDecodeError:
            raise BadMessageError("a text is not in UTF-8") from None


def peek_ns(data: bytes) -> int:
    """Return the stamp of a serialised message that begins with a header or a stamp; raises
    BadMessageError where it is cut off."""
    return Reader(data).stamp()
