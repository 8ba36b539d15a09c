"""Subscriptions that lose nothing, but hear publishers that may lose something, or that publish
another type of message, too.

Drivers of sensors are often best effort (`rclpy.qos.qos_profile_sensor_data`). A reliable
subscription is not connected with such a publisher at all; a best effort one is with both kinds.
Nothing else of `topics.LOSSLESS` asks for more than a publisher may offer. A publisher of another
type is not connected either: what `messages.drivers` takes in a topic's place is subscribed to
where nobody publishes the topic's own type.

Where a topic is of one publisher (`Topic.single`), that is the first one heard, while it is there;
messages of others are dropped. Another one takes over when it is gone; so does at once one of a
node of the same name that has come since: of a process that was killed the middleware takes up to
20 s to notice that it is gone, and its successor is not to wait.

rclpy 7 gives a message's number and times, but not its publisher, and its events executor calls
nothing of ours before it takes a message. So where a topic has several publishers the messages are
taken here, by the function of rcl that rclpy calls itself; the executor, which asks a subscription
for its type of message first, then finds none left."""

import ctypes
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING

from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from isogal_ros import topics
from isogal_ros.messages.drivers import type_taken
from isogal_ros.topics import LOSSLESS, Message, Topic

if TYPE_CHECKING:
    from isogal_ros.nodes.base import GraphNode

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
        rcl.rcutils_uint8_array_init(
            ctypes.byref(self.data), ctypes.c_size_t(4096), ctypes.byref(allocator)
        )


@cache
def _library() -> _Library | None:
    """Return them; None where there is no such library: then no publisher is known."""
    try:
        return _Library()
    except (OSError, AttributeError):
        return None


def take_next(subscription: Subscription) -> tuple[bytes, bytes | None] | None:
    """Take the next message; return it, serialised, and what identifies its publisher (None = this
    middleware does not say), or None where there is no message."""
    library, handle = _library(), subscription.handle
    if library is None:
        return None
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
    """What a subscription becomes that is to say when a message is about to be taken."""

    before: Callable[[], None]
    """Called then."""

    @property
    def msg_type(self) -> type[Message]:
        """The class of its messages, which an executor asks for before each."""
        # one that was destroyed may have been told of a message that it had still to take
        with suppress(InvalidHandle):
            self.before()
        return self.__dict__["msg_type"]


Take = Callable[[bytes], None]
"""Takes a serialised message of a topic."""
_BEST_EFFORT = QoSProfile(
    history=HistoryPolicy.KEEP_ALL, depth=0, reliability=ReliabilityPolicy.BEST_EFFORT
)
_NAMELESS = "a node without a name yet"


class Listening:
    """A subscription of a node, which becomes best effort where a publisher is.

    Parameters
    ----------
    node : GraphNode
    topic : Topic
    take : callable
    single : bool, optional
        Whether to use one publisher only, of those by the middleware.
    """

    def __init__(self, node: "GraphNode", topic: Topic, take: Take, single: bool = False) -> None:
        self.node, self.topic, self.deliver = node, topic, take
        self._refused = False
        self.type: type[topics.Message] = topic.type
        """Of the messages that are taken: the topic's own, or one that a driver publishes."""
        self._is_down = False
        """Whether it waits for its subscription to be gone before it has another."""
        self._single = single
        self._there: dict[bytes, str] = {}
        """Publishers, connected or not: what identifies each, and its node's name."""
        self._used: bytes | None = None
        self._beside: set[bytes] = set()
        """Those that were there when the one that is used was first heard."""
        self.topic_name = str(node.resolve_topic_name(topic.name))
        """The resolved name."""
        self._subscription: Subscription | None = None
        """None = there is none at present, or the node hears only what is on its bus."""
        bus = node.bus
        if bus is not None:
            bus.join(self)
        if bus is None or (bus.is_open and not bus.publishers(topic.name)):
            self.open()

    def open(self) -> None:
        """Hear what comes by the middleware."""
        if self._subscription is None:
            self._subscription = self._subscribe(LOSSLESS)

    def _subscribe(self, profile: QoSProfile) -> Subscription:
        topic, events = self.topic, SubscriptionEventCallbacks(incompatible_qos=self._refuse)
        made = self.node.create_subscription(
            self.type, topic.name, self.deliver, profile, raw=True, event_callbacks=events
        )
        self._connected, self._settled = -1, False
        if self._single:
            made.__class__, made.before = Foretold, self._sort
        return made

    def _refresh(self) -> None:
        """See anew who publishes."""
        there = self.node.publishers_of(self.topic_name)
        self._there = {gid: name or _NAMELESS for gid, name in there.items()}

    def _sort(self) -> None:
        """Take the messages that wait, unless there is one publisher, which is known: then rclpy
        does that as well, and sooner."""
        connected = self.get_publisher_count()
        if connected != self._connected:
            self._connected, self._settled = connected, False
            self._refresh()
        if self._settled:
            return
        while (taken := take_next(self._subscription)) is not None:
            data, gid = taken
            why = None if gid is None else self._drop(gid, connected <= 1)
            self._settled = connected == 1
            if why is not None:
                self.node.health.drop(self.topic.name, why)
            else:
                self.deliver(data)

    def _drop(self, gid: bytes, alone: bool) -> str | None:
        """Return why a message of a publisher, which may be the only one now, is not to be used
        (None = it is)."""
        if gid == self._used:
            return None
        if gid not in self._there or not self._succeeds(gid):
            self._refresh()
        if not (alone or self._succeeds(gid)):
            other, used = (self._there.get(one or b"", _NAMELESS) for one in (gid, self._used))
            return f"of a second publisher, {other}: {used} is used"
        self._used, self._beside = gid, set(self._there)
        return None

    def _succeeds(self, gid: bytes) -> bool:
        """Whether a publisher takes the place of the one that is used."""
        if self._used not in self._there:
            return True
        may_be = self._there.get(gid, _NAMELESS) in (_NAMELESS, self._there[self._used])
        return may_be and gid not in self._beside

    def _refuse(self, _event: QoSRequestedIncompatibleQoSInfo) -> None:
        """Note that a publisher offers less than is asked for."""
        self._refused = True

    def get_publisher_count(self) -> int:
        """Return how many publishers are connected."""
        bus, made = self.node.bus, self._subscription
        on_bus = 0 if bus is None else bus.publishers(self.topic.name)
        return on_bus + (0 if made is None else int(made.get_publisher_count()))

    def adapt(self) -> None:
        """Take less where a publisher has offered less, or another type; a timer calls this."""
        if self._is_down:
            # a process has one type of a topic, and its executor holds what is destroyed for long
            with suppress(rclpy_implementation.RCLError):
                self._subscription, self._is_down = self._subscribe(LOSSLESS), False
        if self._subscription is None:
            return
        if self._retyped():
            return
        # one that is heard without loss is not to lose messages for another that is not used
        if not self._refused or (self._single and self.get_publisher_count()):
            return
        self._refused = False
        self.node.get_logger().warning(
            f"{self.topic.name}: a publisher is best effort, and is heard as such: what gets lost"
            " on its way is missing"
        )
        before, self._subscription = self._subscription, self._subscribe(_BEST_EFFORT)
        self.node.destroy_subscription(before)

    def _retyped(self) -> bool:
        """Listen to another type of message that the topic takes, where only that is published."""
        if self.get_publisher_count():
            return False
        infos = self.node.get_publishers_info_by_topic(self.topic_name)
        kind = type_taken(self.topic, [info.topic_type for info in infos])
        if kind in (None, self.type):
            return False
        self.node.get_logger().warning(
            f"{self.topic.name}: published as {topics.type_name(kind)}, which is taken for"
            f" {topics.type_name(self.topic.type)}"
        )
        self.node.destroy_subscription(self._subscription)
        self._subscription, self.type, self._is_down = None, kind, True
        return True
