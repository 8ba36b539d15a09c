"""What a node does once a second of wall time, whether data come or not."""

import ctypes
import time
from multiprocessing import parent_process
from typing import TYPE_CHECKING

from isogal_ros.nodes.health import ERROR
from isogal_ros.nodes.middleware import LEASE

if TYPE_CHECKING:
    from isogal_ros.nodes.base import GraphNode

TOLD = 60.0
"""s of wall time for which the node says that it stood still."""
FREE_EVERY = 5.0
"""s of wall time between givings back of memory."""


class Heartbeat:
    """Gives memory back; says where the process stood still so long that others, where a node has
    any (`isogal_ros.graph.bus`), took it for gone; ends the node with the process that started it.

    Parameters
    ----------
    node : GraphNode
    """

    def __init__(self, node: "GraphNode") -> None:
        self._node, self._parent = node, parent_process()  # of `isogal run`
        self._freed = time.monotonic()
        self._beaten: float | None = None
        self._text, self._until = "", 0.0
        """That it stood still, and until when it says so."""

    def beat(self) -> None:
        """Do what is due."""
        node, health, now = self._node, self._node.health, time.monotonic()
        stood, self._beaten = now - (self._beaten or now), now
        if stood > LEASE and (node.bus is None or not node.bus.alone):
            health.count("stood still")
            took = "others took it for gone, what they said is lost"
            self._text, self._until = f"stood still for {stood:.0f} s; {took}", now + TOLD
        health.concern("standing still", self._text if now <= self._until else None, ERROR)
        if now - self._freed >= FREE_EVERY:
            self._freed = now
            give_memory_back()
        if self._parent is not None and not self._parent.is_alive():
            node.get_logger().error("the process that started this node is gone")
            node.finished = True


def give_memory_back() -> None:
    """Give memory that is free back to the system, where the C library is glibc.

    A listener that stops for a while leaves megabytes of messages with the node that writes to it.
    The middleware frees them when they have been taken (`nodes/fastdds.xml`), but the C library
    keeps what lies below the last block in use."""
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if trim is not None:
        trim(ctypes.c_size_t(0))
