"""Messages with what identifies their publishers.

rclpy 7 gives a message's number and times, but not its publisher, and its events executor calls
nothing of ours before it takes a message. So where a topic has several publishers the messages are
taken here, by the function of rcl that rclpy calls itself; the executor, which asks a subscription
for its type of message first, then finds none left."""

import ctypes
from collections.abc import Callable
from contextlib import suppress
from functools import cache

from rclpy.exceptions import InvalidHandle
from rclpy.subscription import Subscription

from isogal_ros.topics import Message

_NOTHING = 401
"""RCL_RET_SUBSCRIPTION_TAKE_FAILED: no message waits."""


class _Allocator(ctypes.Structure):
    _fields_ = [(name, ctypes.c_void_p) for name in ("a", "b", "c", "d", "e")]


class _Bytes(ctypes.Structure):
    """``rcutils_uint8_array_t``."""

    _fields_ = [
        ("buffer", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", _Allocator),
    ]


class _Info(ctypes.Structure):
    """``rmw_message_info_t``, and room for what a later version may have besides."""

    _fields_ = [
        ("times_and_numbers", ctypes.c_uint64 * 4),
        ("implementation", ctypes.c_void_p),
        ("gid", ctypes.c_uint8 * 16),
        ("rest", ctypes.c_uint8 * 64),
    ]


class _Library:
    """Functions of rcl and rmw, and a buffer for messages."""

    def __init__(self) -> None:
        rcl = ctypes.CDLL("librcl.so")  # with all that it is linked with
        self.take = rcl.rcl_take_serialized_message
        self.take.argtypes = [ctypes.c_void_p] * 4
        self.forget_error = rcl.rcutils_reset_error
        rcl.rmw_get_implementation_identifier.restype = ctypes.c_void_p
        self.implementation = rcl.rmw_get_implementation_identifier()
        rcl.rcutils_get_default_allocator.restype = _Allocator
        self.data, self.info = _Bytes(), _Info()
        allocator = rcl.rcutils_get_default_allocator()
        made = rcl.rcutils_uint8_array_init(
            ctypes.byref(self.data), ctypes.c_size_t(4096), ctypes.byref(allocator)
        )
        if made != 0:
            raise MemoryError("no memory for messages")


@cache
def _library() -> _Library | None:
    try:
        return _Library()
    except (OSError, AttributeError):
        return None


def take_next(subscription: Subscription) -> tuple[bytes, bytes | None] | None:
    """Take the next message; return it, serialised, and what identifies its publisher (None = this
    middleware does not say), or None where there is no message."""
    library = _library()
    if library is None:
        return None
    handle = subscription.handle
    with handle:
        status = library.take(
            handle.pointer, ctypes.byref(library.data), ctypes.byref(library.info), None
        )
    if status != 0:
        library.forget_error()
        if status != _NOTHING:
            raise RuntimeError(f"{subscription.topic_name}: no message taken, error {status}")
        return None
    data = ctypes.string_at(library.data.buffer, library.data.length)
    # the address of a text: where it is not where it should be, nor is the rest
    known = library.info.implementation == library.implementation
    return data, bytes(library.info.gid) if known else None


class Foretold(Subscription):
    """A subscription that says when a message is about to be taken."""

    @property
    def msg_type(self) -> type[Message]:
        """The class of its messages, which an executor asks for before each."""
        before: Callable[[], None] | None = self.__dict__.get("before")
        if before is not None:
            # one that was destroyed may have been told of a message that it had still to take
            with suppress(InvalidHandle):
                before()
        kind: type[Message] = self.__dict__["msg_type"]
        return kind

    @msg_type.setter
    def msg_type(self, kind: type[Message]) -> None:
        self.__dict__["msg_type"] = kind


def foretell(subscription: Subscription, before: Callable[[], None]) -> None:
    """Let a function be called whenever a message of a subscription is about to be taken."""
    subscription.__class__ = Foretold
    subscription.__dict__["before"] = before
