"""The static transforms of a vehicle, heard before a node begins."""

import time
from collections.abc import Callable
from contextlib import suppress

from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile

from isogal.errors import InputError
from isogal_ros import topics
from isogal_ros.messages.checks import BadMessageError
from isogal_ros.messages.mounting import Link, Tree, read_transforms
from isogal_ros.nodes.middleware import listening_node

_SEVERAL = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of a vehicle whose transforms several nodes publish, as tf2 has it."""


def static_transforms(context: Context, timeout: float, enough: Callable[[Tree], bool]) -> Tree:
    """Return what /tf_static says in a context, once that is enough, or a time (s of wall time)
    has passed; raises InputError where there are no messages of transforms."""
    topic = topics.TF_STATIC
    if topic is None:
        raise InputError("drivers: from_tf needs the package tf2_msgs, which is not installed")
    found: dict[str, Link] = {}

    def take(data: bytes) -> None:
        with suppress(BadMessageError):
            found.update(read_transforms(data))

    with listening_node("isogal_transforms", context) as node:
        node.create_subscription(topic.type, topic.name, take, _SEVERAL, raw=True)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        end = time.monotonic() + timeout
        while not enough(found) and time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
        executor.shutdown()
    return found
