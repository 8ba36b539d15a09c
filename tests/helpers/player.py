"""Plays sensor topics of a recording, as ``ros2 bag play`` would, which the wheels do not have."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from types import TracebackType

import rclpy
from rclpy.node import Node

from helpers.commands import PATIENCE
from isogal_ros import topics
from isogal_ros.bags.reader import BagReader
from isogal_ros.bags.record import wanted_messages
from isogal_ros.messages.prepared import peek_ns
from isogal_ros.nodes.spin import make_executor

LISTENERS = 2
"""Of each sensor: its node and the recorder."""


class Player:
    """A node that publishes what a bag has on some topics. At each stamp of a recorded fix it
    waits until the fix has come and is applied: a vehicle takes its time, too."""

    def __init__(self, bag: Path, wanted: Sequence[topics.Topic], namespace: str) -> None:
        self.bag, self.wanted, self.namespace = bag, wanted, namespace
        self.answers: Counter[int] = Counter()
        """Messages on nav/odom by stamp; two where a fix has been applied."""

    def __enter__(self) -> "Player":
        self.context = rclpy.Context()
        rclpy.init(context=self.context)
        self.node = Node(
            "player", context=self.context, use_global_arguments=False, namespace=self.namespace
        )
        self.executor = make_executor(self.context)
        self.executor.add_node(self.node)
        self.publishers = {
            topic: self.node.create_publisher(topic.type, topic.name, topics.LOSSLESS)
            for topic in self.wanted
        }
        self.odometry = self.node.create_subscription(
            topics.NAV_ODOM.type, topics.NAV_ODOM.name, self._count, topics.LOSSLESS, raw=True
        )
        return self

    def _count(self, data: bytes) -> None:
        self.answers[peek_ns(data)] += 1

    def play(self, stops: Sequence[int], ready: Callable[[], bool]) -> None:
        """Publish all once the nodes are ready, and wait for a fix at some stamps (ns)."""
        publishers = self.publishers.values()
        self._wait(lambda: all(p.get_subscription_count() >= LISTENERS for p in publishers))
        self._wait(lambda: self._heard() and ready())
        left = list(stops)
        for topic, data in wanted_messages(BagReader(self.bag), self.wanted):
            if left and peek_ns(data) > left[0]:
                stamp = left.pop(0)
                self._wait(lambda stamp=stamp: self.answers[stamp] >= 2)
            self.publishers[topic].publish(data)
        self._wait(lambda: all(self.answers[stamp] >= 2 for stamp in stops))
        time.sleep(0.5)  # for the recorder

    def _heard(self) -> bool:
        """Whether somebody navigates: by the graph's discovery, which may miss endpoints for good
        in a process with many participants before it, or as matched."""
        seen = self.node.count_publishers(topics.NAV_ODOM.name)
        return seen > 0 or self.odometry.get_publisher_count() > 0

    def _wait(self, condition) -> None:
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end
            self.executor.spin_once(timeout_sec=0.05)

    def __exit__(
        self, _kind: type | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)
