"""The way so far on nav/path."""

import struct

from geometry_msgs.msg import PoseStamped
from rclpy.serialization import serialize_message

from isogal.arrays import Array
from isogal_ros import topics
from isogal_ros.messages.frames import MAP
from isogal_ros.messages.prepared import Prepared, write
from isogal_ros.messages.stamps import from_seconds
from isogal_ros.nodes.base import GraphNode
from ukf_fusion_node.settings import UkfFusionSettings

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

    def __init__(self, node: GraphNode[UkfFusionSettings]) -> None:
        self._interval = from_seconds(node.settings.path_interval)
        self._publisher, pose = node.advertise(topics.NAV_PATH), PoseStamped()
        pose.header.frame_id = MAP
        node.frame_names.outward(pose)
        self._pose = Prepared(pose)
        self._head, self._count_at = b"", 0
        """The message with the first pose alone, and where it says how many there are."""
        self._poses: list[bytes] = []
        """Those that are kept after the first."""
        self._newest = self._kept = -1
        """Stamps of the newest pose and of the newest that is kept, ns."""

    def extend(self, ns: int, pose: Array) -> None:
        """Take the pose (7,) of a stamp's odometry, unless there was one before, and publish the
        poses where somebody listens."""
        keep = not self._head or ns - self._kept >= self._interval
        if ns <= self._newest or not (keep or self._publisher.get_subscription_count()):
            return
        self._newest = ns
        newest = self._add(ns, pose, keep)
        if keep:
            self._kept = ns
        data = bytearray(b"".join((self._head, *self._poses, *newest)))
        _STAMP.pack_into(data, _CDR, *divmod(ns, 1_000_000_000))
        _COUNT.pack_into(data, self._count_at, 1 + len(self._poses) + len(newest))
        self._publisher.publish(bytes(data))

    def _add(self, ns: int, pose: Array, keep: bool) -> list[bytes]:
        """Keep a pose, or return it serialised."""
        if not self._head:
            first = self._pose.message
            write(first, ns, pose)
            path = topics.NAV_PATH.type(header=first.header)
            self._count_at = len(serialize_message(path)) - _COUNT.size
            path.poses = [first]
            self._head = serialize_message(path)
            return []
        write(self._pose, ns, pose)
        one = self._pose.serialised()[_CDR:]
        if not keep:
            return [one]
        if 1 + len(self._poses) >= PATH_POSES:
            del self._poses[::2]
            self._interval *= 2
        self._poses.append(one)
        return []
