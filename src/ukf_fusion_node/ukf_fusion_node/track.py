"""The way so far on nav/path."""

import struct

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message

from isogal_ros import topics
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode

PATH_POSES = 200
"""Kept at most; then every other one is left out, and they come half as often. All go into each
message: without end it would grow, and with it what the middleware keeps for each message that a
slow listener has not taken."""
_CDR = 4
"""Bytes ahead of a serialised message: how it is represented."""
_STAMP, _COUNT = struct.Struct("=iI"), struct.Struct("=I")


class Track:
    """Publishes what is kept of the poses from the start on and, last, the newest.

    Each pose is serialised once, not with each message: CDR aligns numbers to eight bytes at most
    from where the message begins, and a PoseStamped ends with doubles, so that one that follows
    another has the same bytes as one alone. The first follows the message's header, and is
    serialised with that.

    Parameters
    ----------
    node : GraphNode
    """

    def __init__(self, node: GraphNode) -> None:
        self._interval = from_seconds(node.settings.path_interval)
        self._publisher, self._names = node.advertise(topics.NAV_PATH), node.frame_names
        self._pose = PoseStamped()
        self._head, self._count_at = b"", 0
        """The message with the first pose alone, and where it says how many there are."""
        self._poses: list[bytes] = []
        """Those that are kept after the first."""
        self._newest = self._kept = -1
        """Stamps of the newest pose and of the newest that is kept, ns."""

    def extend(self, ns: int, odometry: Odometry) -> None:
        """Take the odometry of a stamp, unless there was one before, and publish the poses where
        somebody listens."""
        keep = not self._head or ns - self._kept >= self._interval
        if ns <= self._newest or not (keep or self._publisher.get_subscription_count()):
            return
        self._newest = ns
        self._pose.header, self._pose.pose = odometry.header, odometry.pose.pose
        self._names.outward(self._pose)
        newest = self._add(self._pose, keep)
        if keep:
            self._kept = ns
        data = bytearray(b"".join((self._head, *self._poses, *newest)))
        _STAMP.pack_into(data, _CDR, *divmod(ns, 1_000_000_000))
        _COUNT.pack_into(data, self._count_at, 1 + len(self._poses) + len(newest))
        self._publisher.publish(bytes(data))

    def _add(self, pose: PoseStamped, keep: bool) -> list[bytes]:
        """Keep a pose, or return it serialised."""
        if not self._head:
            path = topics.NAV_PATH.type(header=pose.header)
            self._count_at = len(serialize_message(path)) - _COUNT.size
            path.poses = [pose]
            self._head = serialize_message(path)
            return []
        one = serialize_message(pose)[_CDR:]
        if not keep:
            return [one]
        if 1 + len(self._poses) >= PATH_POSES:
            del self._poses[::2]
            self._interval *= 2
        self._poses.append(one)
        return []
